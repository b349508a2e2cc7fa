"""What is missing of a study is run, and how far that is, is shown."""

import warnings
from typing import Any

from encircle.progress import Progress
from encircle.protocol.process.interrupts import Interrupted, signals_held
from encircle.studies.command.report_record import ReportRequest
from encircle.studies.command.request import Request
from encircle.studies.study import Study
from encircle.studies.workers import StudyFailed
from encircle.world.loading.remarks import ScenarioRemark


def run_missing(request: Request, report: ReportRequest) -> tuple[Study, int]:
    """Run what is missing; returns the study and how many runs these were."""
    study = Study(report.plan, report.directory)
    how = {"link": request.link, "workers": request.workers, "cluster": request.cluster}
    return study, run_shown(study, **how)


def run_shown(study: Study, **how: Any) -> int:
    """``study.run(**how)``, showing how far it is; one that is interrupted has failed so.

    Remarks on its scenarios are not told: they have been, or nobody can act on them.
    """
    runs = 0
    with signals_held(), Progress(study.plan.name) as progress:

        def tell(done: int, of: int) -> None:
            nonlocal runs
            runs = done
            progress(done, of)

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ScenarioRemark)
                return study.run(progress=tell, **how)
        except Interrupted as error:
            raise StudyFailed(
                f"{error}; {runs} of {study.plan.runs} runs are done, the same command goes on from"
                " here"
            ) from None
