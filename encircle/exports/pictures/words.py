"""The words around the arena: title, what the radio does, and what happens."""

from collections.abc import Iterator, Sequence

from encircle.exports.pictures.canvas import shortened
from encircle.exports.pictures.moment import Moment, clock_text
from encircle.exports.pictures.sheet import Sheet
from encircle.scene.counts import counted
from encircle.scene.frame import Frame

EVENT_S = 2.0
"""How long the words of an event stay, in s of the run."""
QUIET_KINDS = ("contact", "capture", "unsure")
"""Events that get no words: they are seen, or told otherwise."""
EVENTS_MAX = 3
"""How many events are told at a time, the newest ones."""
TITLE, CAPTURE = 1.35, 1.3
"""Sizes of words, in sizes of most."""


def draw_frame_words(sheet: Sheet) -> None:
    """Title and team above the arena, the channel below it."""
    canvas, stage, colours, size = sheet.canvas, sheet.stage, sheet.colours, sheet.letters
    left, top, right, bottom = sheet.layout.title
    room, y = right - left, (top + bottom) / 2.0
    title = shortened(stage.title or stage.run, 0.62 * room, TITLE * size, True)
    canvas.text(title, (left, y), TITLE * size, colours["ink"], bold=True)
    policies = ", ".join(dict.fromkeys(stage.policies))
    team = f"{counted(len(stage.robots), 'robot')}, {policies}, seed {stage.seed}"
    canvas.text(shortened(team, 0.36 * room, size), (right, y), size, colours["muted"], "right")
    left, top, right, bottom = sheet.layout.caption
    channel = shortened("; ".join(stage.channel), right - left, size)
    canvas.text(channel, (left, (top + bottom) / 2.0), size, colours["ink"])


def draw_news(
    sheet: Sheet, frames: Sequence[Frame], moment: Moment, believer: int | None, known: bool
) -> None:
    """In the arena's corner: the capture, whose belief is shown, and what happened lately.

    ``known``: whether it is known what the believer believes.
    """
    left, top, _, _ = sheet.layout.arena
    size, ink = sheet.letters, sheet.colours["ink"]
    x, y = left + 0.8 * size, top + 1.3 * size
    if moment.frame.captured:
        tick = moment.frame.tick
        text = f"captured at {clock_text(sheet.stage, tick)}, tick {tick}"
        sheet.canvas.text(text, (x, y), CAPTURE * size, ink, bold=True, halo=True)
        y += 2.0 * size
    lines = [*_belief_words(sheet, believer, known), *_events(sheet, frames, moment)]
    for text in lines:
        sheet.canvas.text(text, (x, y), size, ink, halo=True)
        y += 1.6 * size


def _belief_words(sheet: Sheet, believer: int | None, known: bool) -> Iterator[str]:
    if believer is not None:
        name = sheet.stage.robots[believer]
        yield (
            f"as {name} believes it; pale: as it is; packets: to {name}"
            if known
            else f"what {name} believes is not known at this tick"
        )


def _events(sheet: Sheet, frames: Sequence[Frame], moment: Moment) -> list[str]:
    span = round(EVENT_S / sheet.stage.tick_s)
    lately = frames[max(0, moment.row - span) : moment.row + 1]
    events = [e.text for frame in lately for e in frame.events if e.kind not in QUIET_KINDS]
    return events[-EVENTS_MAX:]
