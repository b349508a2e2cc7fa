"""Replays of a study's telling runs: run once more in memory, recorded, and written as pages.

A table has no recordings; it has scenario and seed of every run, and with them the run comes out
the same. Its digest is compared with the table's, so that what is shown is what was counted.
"""

import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from pathlib import Path

from encircle.protocol.plugins import error_line
from encircle.protocol.process.interrupts import check, signals_held
from encircle.protocol.process.log import bounded_log
from encircle.runner.memory import RunEndedByPlugin, run_in_memory
from encircle.scene.builder import BeliefsLeftOut
from encircle.studies.plan import Plan
from encircle.studies.report.sentences import levels_text
from encircle.studies.running import RUN
from encircle.studies.telling_runs import Replay, TellingRun
from encircle.whole_files import made_whole
from encircle.world.arena.engine import build
from encircle.world.recording.recording import Recording

FOLDER = "replays"
FEW_S_MAX = 5.0
"""Of few runs those are shown that together took no longer to run."""


def write_replays(
    plan: Plan,
    runs: Sequence[TellingRun],
    directory: Path,
    wall_s_max: float | None = None,
    tell: Callable[[int, int], None] = lambda _done, _of: None,
) -> list[Replay]:
    """Write the pages that are not there yet; raises ``Interrupted`` after Ctrl-C.

    ``wall_s_max``: what they may take together, in s; a run that would take more than is left of it
    is left out.
    """
    replays, left_s = [], wall_s_max
    for done, run in enumerate(runs):
        tell(done, len(runs))
        if left_s is not None:
            if run.wall_s > left_s:
                replays.append(Replay(run, "", "it takes long: --replays all shows it"))
                continue
            left_s -= run.wall_s
        with signals_held(), redirect_stdout(sys.stderr):
            replays.append(_replay(plan, run, directory))
    tell(len(runs), len(runs))
    return replays


def _replay(plan: Plan, run: TellingRun, directory: Path) -> Replay:
    name = f"{FOLDER}/{run.name}.html"
    path = directory / name
    if path.exists():
        # The directory is of one configuration and code: it is the same run.
        return Replay(run, name)
    try:
        recording, digest = recorded_again(plan, run)
    except Exception as error:
        # As of a team that cannot be placed: the report has more to show than this.
        return Replay(run, "", f"it cannot be shown: {error_line(error)}")
    if digest != run.digest and not run.failure:
        return Replay(run, "", f"run again it came to digest {digest}, not to {run.digest}")
    from encircle.viewer.html_export import export

    path.parent.mkdir(exist_ok=True)
    with made_whole(path) as unfinished, warnings.catch_warnings():
        # Of a robot whose policy fails the page says so itself.
        warnings.simplefilter("ignore", BeliefsLeftOut)
        export(recording, unfinished)
    return Replay(run, name)


def recorded_again(plan: Plan, run: TellingRun) -> tuple[Recording, str]:
    """A run's recording and digest; of one that fails, as far as it comes."""
    scenario = plan.scenario_of(run.cell)
    where = [plan.title or plan.name, levels_text(plan, plan.levels(run.cell))]
    titled = scenario.model_copy(update={"title": ": ".join(text for text in where if text)})
    messages: list[tuple[int, str, bytes]] = []

    def record(tick: int, key: str, payload: bytes) -> None:
        messages.append((tick, key.removeprefix(f"encircle/{RUN}/"), payload))

    try:
        result = run_in_memory(
            build(titled, run.seed), RUN, bounded_log(), record, lambda _world: check()
        )
    except RunEndedByPlugin as error:
        result = error.result
    recording = Recording(Path(run.name), titled, run.seed, RUN, tuple(messages), not run.failure)
    return recording, result.digest
