"""The plan in a bundle: nothing that it names is opened on the reader's machine, and no code run.

A plan can name two kinds of file. A recorded trace of the channel is data: it is in the bundle, and
taken from there. A policy, target behaviour or measure in a file (``my_robots.py:chase``) is code:
the process that reads a plan never imports it (``encircle.bundles.stand_ins``), so that code from a
bundle runs in worker processes alone, and only if that was asked for. Plug-ins that are installed
here are the reader's own.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import PrivateAttr, ValidationError

from encircle.bundles.bundle_file import PLAN, POLICIES_FOLDER, TRACES_FOLDER, BundleError, sha256
from encircle.bundles.stand_ins import load_with_stand_ins
from encircle.bundles.table_text import ROWS_MAX
from encircle.measures import registry as measures
from encircle.measures.registry import is_shipped, split_name
from encircle.protocol.plugin_files import is_in_file
from encircle.protocol.plugins import MEASURES_GROUP, STRATEGIES, TARGETS, error_line
from encircle.strict_json import strict_json
from encircle.studies.plan import CELLS_MAX, Plan
from encircle.studies.plan_problems import cell_count, plan_problems
from encircle.world.loading.consistency import POLICIES
from encircle.world.loading.files import override, read
from encircle.world.loading.trace_files import trace_tables
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario
from encircle.world.targets.behaviours import REGISTRY as BEHAVIOURS

REGISTRIES = {STRATEGIES: POLICIES, TARGETS: BEHAVIOURS, MEASURES_GROUP: measures.REGISTRY}
DIGITS = 16


class BundlePlan(Plan):
    """A plan that takes traces from where it is told, and imports no file.

    ``_traces``: where the files of traces are, by the names that the plan has for them.
    """

    _traces: Mapping[str, Path] = PrivateAttr(default_factory=dict)

    def scenario_of(self, cell: int) -> Scenario:
        """The scenario of a cell; ``ScenarioError`` if it is not valid, or names a foreign file."""
        tree = _tree(self, cell)
        for key, table in trace_tables(tree):
            if "file" in table:
                path = self._traces.get(str(table["file"]))
                if path is None:
                    raise ScenarioError(f"{key}.file = {table['file']!r}: is not in the bundle")
                table["file"] = str(path)
        return load_with_stand_ins(tree, is_away)

    def needed(self, cell: int) -> set[tuple[str, str]]:
        """Group and name of what a run of this cell needs and what this process has not."""
        scenario = self.scenario_of(cell)
        used = {(TARGETS, scenario.target.behaviour)}
        used |= {(STRATEGIES, scenario.strategy_of(robot)) for robot in scenario.ids}
        used |= {(MEASURES_GROUP, split_name(n)[0]) for n in self.measures if not is_shipped(n)}
        return {(group, name) for group, name in used if is_away(group, name)}


def is_away(group: str, name: str) -> bool:
    """Whether what has that name is in a file, or not installed."""
    return is_in_file(name) or name not in REGISTRIES[group].names()


def read_plan(content: bytes, traces: Mapping[str, Path]) -> BundlePlan:
    """The plan of a bundle, checked; ``BundleError`` if it cannot be one."""
    try:
        plan = BundlePlan.model_validate(strict_json(content))
        plan._traces = traces
        if not isinstance(plan.scenario, dict):
            raise BundleError(f"{PLAN}: scenario = {plan.scenario!r}: must be a table")
        cells, runs = cell_count(plan), cell_count(plan) * len(plan.seed_list)
        if cells > CELLS_MAX or runs > ROWS_MAX:
            raise BundleError(f"{PLAN}: {runs} runs, a bundle can have {ROWS_MAX}")
        problems = plan_problems(_without_measures_away(plan))
    except BundleError:
        raise
    except ValidationError as error:
        first = error.errors()[0]
        raise BundleError(f"{PLAN}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    except Exception as error:
        # It is a stranger's, and may be anything.
        raise BundleError(f"{PLAN} cannot be understood: {error_line(error)}") from None
    if problems:
        raise BundleError("\n".join([f"{PLAN} is no plan here:", *(f"  {p}" for p in problems)]))
    return plan


def plan_text(plan: Plan) -> str:
    """A plan as JSON, from which ``read_plan`` reads it."""
    # Unsorted: the report lists the keys of arms in the order in which they were written.
    return json.dumps(plan.model_dump(mode="json"), indent=1) + "\n"


def trace_names(plan: Plan) -> set[str]:
    """The files of traces that a plan names, as it names them."""
    tables = (
        table for cell in range(len(plan.cells)) for _, table in trace_tables(_tree(plan, cell))
    )
    return {str(table["file"]) for table in tables if "file" in table}


def trace_member(name: str, content: bytes) -> str:
    """The member that a trace of the channel has in a bundle."""
    return f"{TRACES_FOLDER}{sha256(content)[:DIGITS]}{Path(name).suffix.lower()}"


def policy_member(name: str) -> str:
    """The member that the file of ``path/file.py:function`` has in a bundle."""
    return POLICIES_FOLDER + name.rpartition(":")[0]


def _tree(plan: Plan, cell: int) -> dict[str, Any]:
    """The scenario of a cell as tables, which nobody has checked."""
    tree = read(plan.scenario)[1]
    for change in plan.changes_of(cell):
        override(tree, change)
    return tree


def _without_measures_away(plan: BundlePlan) -> BundlePlan:
    """The plan without the measures that could be looked at only by importing them."""
    kept = tuple(
        name
        for name in plan.measures
        if is_shipped(name) or not is_away(MEASURES_GROUP, split_name(name)[0])
    )
    if kept == plan.measures:
        return plan
    fields = {name: getattr(plan, name) for name in type(plan).model_fields}
    other = BundlePlan.model_construct(**{**fields, "measures": kept})
    other._traces = plan._traces
    return other
