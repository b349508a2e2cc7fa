"""What is missing of a study is run, and how far that is, is shown."""

import warnings

from encircle.progress import Progress, Tell
from encircle.protocol.process.interrupts import Interrupted, signals_held
from encircle.studies.command.report_record import ReportRequest
from encircle.studies.command.request import Request
from encircle.studies.study import Study
from encircle.studies.workers import StudyFailed
from encircle.world.loading.remarks import ScenarioRemark


def run_missing(request: Request, report: ReportRequest) -> tuple[Study, int]:
    """Run what is missing; returns the study and how many runs these were."""
    study = Study(report.plan, report.directory)
    with signals_held(), Progress(report.plan.name) as progress:
        return study, _run(study, request, progress)


def _run(study: Study, request: Request, progress: Tell) -> int:
    runs = 0

    def tell(done: int, of: int) -> None:
        nonlocal runs
        runs = done
        progress(done, of)

    try:
        with warnings.catch_warnings():
            # They have been told in lines of their own.
            warnings.simplefilter("ignore", ScenarioRemark)
            return study.run(
                link=request.link, workers=request.workers, cluster=request.cluster, progress=tell
            )
    except Interrupted as error:
        raise StudyFailed(
            f"{error}; {runs} of {study.plan.runs} runs are done, the same command goes on from"
            " here"
        ) from None
