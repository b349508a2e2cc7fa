"""Encircle: hunt a moving target with robots that share nothing but messages.

>>> import encircle
>>> hunt = encircle.run("sim1", link="memory")
>>> hunt.captured
True
"""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from encircle.agents.policies.interface import Decision, Peer, Policy, View
    from encircle.protocol.process.interrupts import Interrupted
    from encircle.runner.hunts import Hunt, resume, run
    from encircle.runner.interventions import Interventions
    from encircle.runner.launch import Timeouts
    from encircle.runner.testimony import RunFailed
    from encircle.studies.plan import StudyError
    from encircle.studies.study import Study
    from encircle.studies.workers import StudyFailed
    from encircle.world.coordinator.result import Result
    from encircle.world.loading.files import shipped
    from encircle.world.loading.interventions import InterventionRefused
    from encircle.world.loading.load import load
    from encircle.world.loading.remarks import ScenarioRemark, remarks_on
    from encircle.world.recording.run_directory import RunDirectoryError
    from encircle.world.scenario.errors import ScenarioError
    from encircle.world.scenario.model import Scenario
    from encircle.world.targets.behaviours import Behaviour, TargetView

__all__ = [
    "Behaviour",
    "Decision",
    "Hunt",
    "Interrupted",
    "InterventionRefused",
    "Interventions",
    "Peer",
    "Policy",
    "Result",
    "RunDirectoryError",
    "RunFailed",
    "Scenario",
    "ScenarioError",
    "ScenarioRemark",
    "Study",
    "StudyError",
    "StudyFailed",
    "TargetView",
    "Timeouts",
    "View",
    "load",
    "remarks_on",
    "resume",
    "run",
    "shipped",
    "study",
]
_MODULE_OF = {
    **dict.fromkeys(("Decision", "Peer", "Policy", "View"), "encircle.agents.policies.interface"),
    **dict.fromkeys(("Hunt", "resume", "run"), "encircle.runner.hunts"),
    "RunFailed": "encircle.runner.testimony",
    "Timeouts": "encircle.runner.launch",
    **dict.fromkeys(("ScenarioRemark", "remarks_on"), "encircle.world.loading.remarks"),
    **dict.fromkeys(("Behaviour", "TargetView"), "encircle.world.targets.behaviours"),
    "Interrupted": "encircle.protocol.process.interrupts",
    "InterventionRefused": "encircle.world.loading.interventions",
    "Interventions": "encircle.runner.interventions",
    "Result": "encircle.world.coordinator.result",
    "RunDirectoryError": "encircle.world.recording.run_directory",
    "Scenario": "encircle.world.scenario.model",
    "ScenarioError": "encircle.world.scenario.errors",
    "Study": "encircle.studies.study",
    "StudyError": "encircle.studies.plan",
    "StudyFailed": "encircle.studies.workers",
    "load": "encircle.world.loading.load",
    "shipped": "encircle.world.loading.files",
}


def __getattr__(name: str) -> Any:
    """Fetch a name when it is used first: the command line must be there before numpy is."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    """All names, for completion, also those that have not been used yet."""
    return sorted({*globals(), *__all__})


def study(
    source: str | Path | Mapping[str, Any],
    out: str | Path | None = None,
    *,
    overrides: Sequence[str] = (),
    seeds: int | str | None = None,
) -> "Study":
    """A study by its shipped name, from a TOML file or from a mapping.

    ``out``: directory of its table, ``runs/study-NAME`` by default; ``overrides``: ``key=value``
    changes of its base scenario; ``seeds``: how many, or which (``"1001-1200"``), instead of its
    own. Nothing is run before ``run`` or ``table`` is called. Raises ``StudyError`` listing every
    problem, ``MissingExtra`` without the packages of studies.
    """
    # Imported late: a hunt needs no tables.
    from encircle.extras import needing

    with needing("encircle.study", "studies"):
        from encircle.studies.plan_files import load_plan
        from encircle.studies.study import Study

    return Study(load_plan(source, overrides, seeds), out)
