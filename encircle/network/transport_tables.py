"""Tables of a transport report: what the real network and the channel model did to each link.

The report is made by ``encircle.world.network.transport``; here it is printed on a console.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from encircle.protocol.process.log import printable

LINKS_SHOWN_MAX = 24
UNKNOWN_SHOWN_MIN = 3
TEXT_COLUMNS = ("from", "to", "carries", "clock of", "remark")


def print_transport_report(
    report: dict[str, Any], console: Console, shown_max: int | None = None
) -> None:
    """Print a report's tables of actual and injected loss and delay and of clocks.

    ``report``: as ``encircle.world.network.transport.report`` returns it. ``shown_max``: links
    per table, all by default.
    """
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
    # Reasons are long, so they stand below the table and not in a column.
    refused = Counter(link["delay_refused"] for link in links if link["delay_refused"])
    for reason, number in refused.items():
        message = f"no delay for {number} of {len(links)} links: {reason}"
        console.print(plain_text(message), highlight=False)
    for link in links:
        # When a run ends, one or two observations are always under way.
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
    clocks: list[tuple[str, ...]] = [
        (
            clock["robot"],
            *(_ms(clock[name]) for name in ("offset_s", "error_s", "round_trip_s_median")),
            "" if clock["steady"] else "set anew in mid-run",
        )
        for clock in report["clocks"]
    ]
    heads: tuple[str, ...] = ("clock of", "ahead ms", "+- ms", "round trip ms", "remark")
    if not any(remark for *_, remark in clocks):
        heads, clocks = heads[:-1], [row[:-1] for row in clocks]
    _table(console, "clocks, compared with the world's", heads, clocks, shown_max)
    if report["incomplete_from_tick"] is not None:
        tick = report["incomplete_from_tick"]
        console.print(f"actual and clocks: from tick {tick} on nothing was written down")


def plain_text(text: str) -> Text:
    """Text that Rich shows unchanged; in a plain string Rich would interpret markup."""
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
        table.add_column(head, justify="left" if head in TEXT_COLUMNS else "right")
    for row in rows[:shown_max]:
        table.add_row(*map(plain_text, row))
    console.print(table)
    if shown_max is not None and len(rows) > shown_max:
        console.print(f"and {len(rows) - shown_max} more: encircle transport RUN")


def _is_late(link: dict[str, Any], report: dict[str, Any]) -> bool:
    """Whether the channel model delayed packets of a link beyond the next tick."""
    return float(link["delay_s_max"] or 0.0) > 1.5 * float(report["tick_s"])


def _ms(value_s: float | None) -> str:
    return "-" if value_s is None else f"{value_s * 1e3:.2f}"
