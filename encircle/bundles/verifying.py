"""``encircle verify``: a bundle held against itself, computed again, and run again in part."""

import os
import secrets
from collections.abc import Callable
from pathlib import Path

from encircle.bundles.contents import opened
from encircle.bundles.findings import Verification
from encircle.bundles.report_checks import check_report
from encircle.bundles.reruns import check_by_running, versions_text
from encircle.protocol.process.interrupts import check, signals_held

ROWS = 20
SEED_BITS = 32


def verify(
    path: Path,
    rows: int | None = ROWS,
    seed: int | None = None,
    *,
    runs_files: bool = False,
    workers: int | None = None,
    tell: Callable[[int, int], None] = lambda _done, _of: None,
) -> Verification:
    """Verify a bundle; ``BundleError`` if it cannot be read at all.

    ``rows``: how many rows are run once more, None for all of them. ``seed``: draws which; nobody
    can know it before if it is left out. ``runs_files``: whether policies that came in the bundle,
    which are code, may be run. ``tell`` gets how many runs are done, and of how many.
    """
    found = Verification()
    with signals_held(), opened(path, found) as contents:
        check()
        if contents is not None:
            found.numbers["study"] = contents.plan.name
            check_report(contents, found)
            check()
            drawn = secrets.randbits(SEED_BITS) if seed is None else seed
            check_by_running(
                contents, found, rows, drawn, runs_files, workers or os.cpu_count() or 1, tell
            )
            if others := versions_text(contents):
                found.unchecked.append(f"the versions that computed it: {others}")
    return found
