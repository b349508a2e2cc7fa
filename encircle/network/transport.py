"""What the network did in a recorded run by the clock: the ledger read back, shown as tables."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from encircle.protocol.codec import decode
from encircle.protocol.errors import MalformedMessage, ProtocolError, WrongSender
from encircle.protocol.messages import Command, Observation, Pose, Radio, Setup
from encircle.protocol.process.log import printable
from encircle.world.network.message_ledger import MessageLedger
from encircle.world.recording.recording import Recording, RecordingError

ROWS_MAX = 20_000_000
SHOWN_MAX = 24
UNKNOWN_SHOWN_MIN = 3
KINDS: dict[str, Any] = {
    "setup": Setup,
    "observation": Observation,
    "pose": Pose,
    "command": Command,
    "radio": Radio,
}
TEXTS = ("from", "to", "carries", "clock of", "")


def ledger_of(recording: Recording) -> MessageLedger:
    """The ledger of a recorded run; ``RecordingError`` if it was not one by the clock."""
    scenario, run = recording.scenario, recording.run
    if scenario.clock != "wall":
        raise RecordingError(
            f"{recording.path}: clock = {scenario.clock!r}: in lock-step no clock is involved,"
            " so there is nothing to measure; run with --set clock=wall"
        )
    ledger = MessageLedger(scenario.ids, scenario.tick_s, scenario.radio == "direct", ROWS_MAX)
    for (tick, topic, payload), at_us in zip(recording.messages, recording.logged_us, strict=True):
        robot, channel = topic.split("/")[-2:]
        if channel in ("setup", "observation", "pose", "command") and robot not in scenario.ids:
            raise RecordingError(f"{topic} of tick {tick}: the team is {', '.join(scenario.ids)}")
        try:
            _write(ledger, robot, channel, payload, run, at_us)
        except ProtocolError as error:
            raise RecordingError(f"{topic} of tick {tick}: {error}") from None
    return ledger


def _write(
    ledger: MessageLedger, robot: str, channel: str, payload: bytes, run: str, at_us: int
) -> None:
    kind = KINDS.get(channel)
    if kind is None:
        return
    message = decode(kind, payload, run)
    if getattr(message, "robot", robot) != robot:
        raise WrongSender(f"it is of {message.robot}")
    if kind is Radio and len(message.fates) != len(ledger.robots):
        raise MalformedMessage("it is of another team")
    match message:
        case Setup():
            ledger.joined(robot, message.first_tick)
        case Observation(sent_us=int(sent_us)):
            ledger.asked(robot, message.tick, sent_us)
        case Pose():
            ledger.packet(message, at_us)
        case Command():
            ledger.answered(message, at_us)
        case Radio():
            ledger.fates_drawn(message)


def show(report: dict[str, Any], console: Console, shown_max: int | None = None) -> None:
    """Show the tables of a report (``world.network.transport``), at most ``shown_max`` links."""
    links = report["links"]
    _table(
        console,
        "actual: what the network did, with one-way delays",
        ("from", "to", "carries", "sent", "lost", "median ms", "99 % ms", "+- ms"),
        [
            (
                *(link["sender"], link["receiver"], link["carries"]),
                *(f"{link['sent']}", f"{link['lost']}"),
                *(_ms(link[f"delay_s_{name}"]) for name in ("median", "p99", "error")),
            )
            for link in links
        ],
        shown_max,
    )
    # Below: in a column of their own they would leave no room for the figures.
    refused = Counter(link["delay_refused"] for link in links if link["delay_refused"])
    for reason, number in refused.items():
        message = f"no delay for {number} of {len(links)} links: {reason}"
        console.print(visible(message), highlight=False)
    for link in links:
        # One or two are always under way when a run ends.
        if link["unknown"] > UNKNOWN_SHOWN_MIN:
            console.print(
                f"whether {link['unknown']} more observations came to {link['receiver']} is not"
                " known: it answered none after them",
                highlight=False,
            )
    injected = report["injected"]
    if any(link["lost"] or link["copied"] or _is_late(link, report) for link in injected):
        sent = [
            (
                *(link["sender"], link["receiver"], f"{link['sent']}"),
                ", ".join(f"{n} by {cause}" for cause, n in link["lost"].items()) or "0",
                *(_ms(link["delay_s_mean"]), _ms(link["delay_s_max"])),
            )
            for link in injected
        ]
        over = ("from", "to", "sent", "lost", "mean ms", "longest ms")
        title = "injected: what the modelled radio did, with delays in whole ticks"
        _table(console, title, over, sent, shown_max)
    clocks = [
        (
            clock["robot"],
            *(_ms(clock[name]) for name in ("offset_s", "error_s", "round_trip_s_median")),
            "" if clock["steady"] else "set anew in mid-run",
        )
        for clock in report["clocks"]
    ]
    heads = ("clock of", "ahead ms", "+- ms", "round trip ms", "")
    _table(console, "clocks, compared with the world's", heads, clocks, shown_max)
    if report["incomplete_from_tick"] is not None:
        tick = report["incomplete_from_tick"]
        console.print(f"actual and clocks: from tick {tick} on nothing was written down")


def visible(text: str) -> Text:
    """Text for Rich to show as it is: in a plain string it would look for marks of its own."""
    return Text(printable(text))


def _table(
    console: Console,
    title: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    shown_max: int | None,
) -> None:
    table = Table(title=title, title_justify="left")
    for head in heads:
        table.add_column(head, justify="left" if head in TEXTS else "right")
    for row in rows[:shown_max]:
        table.add_row(*map(visible, row))
    console.print(table)
    if shown_max is not None and len(rows) > shown_max:
        console.print(f"and {len(rows) - shown_max} more: encircle transport RUN")


def _is_late(link: dict[str, Any], report: dict[str, Any]) -> bool:
    """Whether the modelled radio has held anything back: without, all is there a tick later."""
    return float(link["delay_s_max"] or 0.0) > 1.5 * float(report["tick_s"])


def _ms(value_s: float | None) -> str:
    return "-" if value_s is None else f"{value_s * 1e3:.2f}"
