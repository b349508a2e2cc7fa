"""Tasks of a study, some runs of one cell each, and the rows that come of them for the table.

A task is executed in a worker process, on this machine or another. It contains all that it needs,
the scenario included. This module is what goes to a worker and comes back, without the hunt itself:
who hands tasks out need not wait for that.
"""

import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from encircle.studies import sources
from encircle.studies.sources import Names

FAILED, TRACEBACK = "failed", "trace"
"""Keys of a row: why the run failed, empty if it did not; its traceback, which goes into a file."""
Row = dict[str, Any]


class Task(NamedTuple):
    """Some seeds of one cell.

    ``scenario``: the cell's scenario as JSON. ``measure_names``: measures to compute.
    ``plugins``: all plug-ins that the study uses, in any cell.
    """

    cell: int
    levels: Mapping[str, Any]
    scenario: str
    seeds: tuple[int, ...]
    measure_names: tuple[str, ...]
    plugins: Names = ()


@lru_cache(maxsize=64)
def code_and_versions(plugins: Names) -> tuple[str, str]:
    """``sources.code`` and, as JSON, ``sources.versions`` of this process, at the first call.

    Modules that a process has imported stay as they were, even if their files change later.
    """
    return sources.code(plugins), json.dumps(sources.versions(plugins))
