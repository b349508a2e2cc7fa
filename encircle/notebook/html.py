"""Tables and frames of HTML for notebooks, in whatever colours the notebook has.

Words have the colour of the notebook's text, and lines a grey that is seen on light and dark
ground. Every text is escaped. Styles stand at the elements: a notebook that is shown elsewhere, as
on the web, keeps nothing else.
"""

from collections.abc import Iterable, Sequence
from html import escape

from encircle.protocol.process.log import printable

LINE = "rgba(128,128,128,0.45)"
_CELL = f"text-align:left;vertical-align:top;padding:2px 10px 2px 0;border-bottom:1px solid {LINE}"
_NUMBER = _CELL.replace("text-align:left", "text-align:right")


def framed(title: str, parts: Iterable[str], note: str = "") -> str:
    """A heading, parts of HTML beside each other, and a line of small print below."""
    beside = "".join(f'<div style="margin:0 24px 8px 0">{part}</div>' for part in parts if part)
    small = f'<div style="font-size:90%;opacity:0.75">{text(note)}</div>' if note else ""
    return (
        f'<div style="margin:4px 0"><div style="font-weight:bold;margin-bottom:6px">{text(title)}'
        f'</div><div style="display:flex;flex-wrap:wrap;align-items:flex-start">{beside}</div>'
        f"{small}</div>"
    )


def facts(rows: Iterable[tuple[str, str]]) -> str:
    """A table of names and what they stand for."""
    lines = "".join(
        f'<tr style="background:none"><th scope="row" style="{_CELL};font-weight:normal;'
        f'opacity:0.75">{text(name)}</th><td style="{_CELL}">{text(value)}</td></tr>'
        for name, value in rows
    )
    return f'<table style="border-collapse:collapse;margin:0">{lines}</table>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], names: int) -> str:
    """A table with a head; the first ``names`` columns are names, the others numbers."""
    styles = [_CELL if k < names else _NUMBER for k in range(len(head))]
    top = "".join(
        f'<th scope="col" style="{style}">{text(title)}</th>'
        for title, style in zip(head, styles, strict=True)
    )
    lines = "".join(
        '<tr style="background:none">'
        + "".join(
            f'<td style="{style}">{text(cell)}</td>'
            for cell, style in zip(row, styles, strict=True)
        )
        + "</tr>"
        for row in rows
    )
    return (
        f'<table style="border-collapse:collapse;margin:0"><thead><tr>{top}</tr></thead>'
        f"<tbody>{lines}</tbody></table>"
    )


def text(words: object) -> str:
    """A text as HTML, in visible characters."""
    return escape(printable(str(words)), quote=True)
