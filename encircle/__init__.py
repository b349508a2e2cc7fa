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
    from encircle.runner.hunts import Hunt, resume, run
    from encircle.runner.launch import Timeouts
    from encircle.studies.study import Study
    from encircle.world.loading.files import shipped
    from encircle.world.loading.load import load
    from encircle.world.loading.remarks import ScenarioRemark
    from encircle.world.scenario.errors import ScenarioError
    from encircle.world.scenario.model import Scenario

__all__ = [
    "Hunt",
    "Scenario",
    "ScenarioError",
    "ScenarioRemark",
    "Timeouts",
    "load",
    "resume",
    "run",
    "shipped",
    "study",
]
_MODULE_OF = {
    **dict.fromkeys(("Hunt", "resume", "run"), "encircle.runner.hunts"),
    "Timeouts": "encircle.runner.launch",
    "Scenario": "encircle.world.scenario.model",
    "ScenarioError": "encircle.world.scenario.errors",
    "ScenarioRemark": "encircle.world.loading.remarks",
    "load": "encircle.world.loading.load",
    "shipped": "encircle.world.loading.files",
}


def __getattr__(name: str) -> Any:
    """Fetch a name when it is used: the command line must be there before numpy is."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def study(
    source: str | Path | Mapping[str, Any],
    out: str | Path | None = None,
    *,
    overrides: Sequence[str] = (),
    seeds: int | None = None,
) -> "Study":
    """A study by its shipped name, from a TOML file or from a mapping.

    ``out``: directory of its table, ``runs/study-NAME`` by default; ``overrides``: ``key=value``
    changes of its base scenario; ``seeds``: how many instead of its own. Nothing is run before
    ``run`` or ``table`` is called. Raises ``StudyError`` listing every problem.
    """
    # Imported late: a hunt needs no tables.
    from encircle.studies.plan_files import load_plan
    from encircle.studies.study import Study

    return Study(load_plan(source, overrides, seeds), out)
