"""Encircle: hunt a moving target with robots that share nothing but messages.

>>> import encircle
>>> hunt = encircle.run("sim1", link="memory")
>>> hunt.captured
True
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from encircle.hunts import Hunt, resume, run
from world.remarks import ScenarioRemark
from world.scenario import Scenario, ScenarioError, load, shipped

if TYPE_CHECKING:
    from encircle.studies.study import Study

__all__ = [
    "Hunt",
    "Scenario",
    "ScenarioError",
    "ScenarioRemark",
    "load",
    "resume",
    "run",
    "shipped",
    "study",
]


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
    from encircle.studies.plan import load_plan
    from encircle.studies.study import Study

    return Study(load_plan(source, overrides, seeds), out)
