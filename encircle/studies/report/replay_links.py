"""Links from a report to the replays of its telling runs."""

from collections.abc import Sequence

from encircle.studies.plan import Plan
from encircle.studies.report import page
from encircle.studies.report.sentences import levels_text
from encircle.studies.telling_runs import Replay

SHOWN_MAX = 8


def replay_sections(plan: Plan, replays: Sequence[Replay]) -> list[str]:
    """Parts of the page: each telling run with a link to its replay; empty without any."""
    if not replays:
        return []
    note = (
        "Each opens in a browser, without a server: the arena, packets with their fates, what each"
        " robot believes, ages and curves. The runs were run once more for this from scenario and"
        " seed, and came to the digests of the table."
    )
    items = [_item(plan, replay) for replay in replays]
    parts = [page.heading("Runs to look at"), page.paragraph(note, "soft")]
    if len(items) <= SHOWN_MAX:
        return [*parts, page.links(items)]
    return [*parts, page.collapsible(f"{len(items)} runs", [page.links(items)])]


def _item(plan: Plan, replay: Replay) -> tuple[str, str, str]:
    run = replay.run
    at = levels_text(plan, plan.levels(run.cell))
    where = f"{f'{at}, ' if at else ''}seed {run.seed}"
    time_s = run.ticks * plan.scenario_of(run.cell).tick_s
    if run.failure:
        outcome = "failed"
    elif run.captured:
        outcome = f"captured after {time_s:.1f} s"
    else:
        outcome = f"not captured within {time_s:.1f} s"
    note = f"{' and '.join(run.reasons)}, {outcome}"
    return replay.page, where, f"{note}; {replay.problem}" if replay.problem else note
