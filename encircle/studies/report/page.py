"""HTML parts of the report's page: one file that loads nothing and has no scripts.

Text that is given to these functions is escaped here and nowhere else; ``content`` is what they
return. The page is readable as plain HTML, on a phone and on paper, where collapsed parts are
printed open.
"""

import base64
from collections.abc import Iterable, Sequence
from html import escape as html_escape
from pathlib import Path

from encircle.protocol.process.log import printable_lines

STYLE = """
:root { color-scheme: light; --ink: #1a1a1a; --soft: #4a4a4a; --line: #c9c9c9; --tint: #f3f5f7; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); line-height: 1.5;
  font-family: system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main { max-width: 58rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0 0 .5rem; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 .75rem; padding-bottom: .25rem;
  border-bottom: 1px solid var(--line); }
h3 { font-size: 1rem; margin: 1.5rem 0 .25rem; }
h1, h2, h3, p, li, td, th, figcaption { overflow-wrap: break-word; }
p, ul { max-width: 46rem; }
.soft, figcaption { color: var(--soft); }
li { margin: .3rem 0; }
.figures { display: flex; flex-wrap: wrap; gap: 1.75rem 1.5rem; align-items: flex-start; }
figure { margin: 0; min-width: 0; flex: 0 1 27rem; }
figure.wide { flex-basis: 100%; }
figure img { display: block; max-width: 100%; height: auto; }
figcaption { font-size: .875rem; margin-top: .5rem; max-width: 46rem; }
.scroll { overflow-x: auto; margin: .75rem 0 1.25rem; }
.scroll:focus-visible, summary:focus-visible { outline: 2px solid #0072b2; outline-offset: 2px; }
table { border-collapse: collapse; font-size: .875rem; }
caption { text-align: left; color: var(--soft); padding-bottom: .4rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .75rem .3rem 0;
  border-bottom: 1px solid var(--line); }
th { font-weight: 600; }
thead th { vertical-align: bottom; border-bottom: 2px solid #767676; }
tbody th { font-weight: 400; max-width: 18rem; }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
.words th { font-weight: 600; white-space: nowrap; }
details { margin: .5rem 0; }
a { color: #0b5cad; }
a:focus-visible { outline: 2px solid #0072b2; outline-offset: 2px; }
summary { cursor: pointer; padding: .25rem 0; }
pre { background: var(--tint); border: 1px solid var(--line); border-radius: 4px; padding: .75rem;
  white-space: pre-wrap; overflow-wrap: anywhere; font-size: .8125rem; }
code { font-family: ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", monospace; }
@media (max-width: 40rem) { h1 { font-size: 1.4rem; } figure { flex-basis: 100%; } }
@media print {
  @page { margin: 15mm; }
  body { font-size: 10pt; }
  main { max-width: none; padding: 0; }
  h2, h3 { break-after: avoid; }
  figure, tr { break-inside: avoid; }
  .scroll { overflow: visible; }
  table { font-size: 8pt; }
  th, td { padding-right: 1.5mm; }
  td.number { white-space: normal; }
  details::details-content { display: block; content-visibility: visible; }
}
"""


def escape(text: str) -> str:
    """Text as a page shows it, without tags, control characters or changes of direction."""
    return html_escape(printable_lines(text))


def document(title: str, content: Iterable[str]) -> str:
    """A whole page."""
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>",
            f"<style>{STYLE}</style>",
            "</head>",
            "<body>",
            "<main>",
            *content,
            "</main>",
            "</body>",
            "</html>",
            "",
        ]
    )


def heading(text: str, level: int = 2) -> str:
    """A heading."""
    return f"<h{level}>{escape(text)}</h{level}>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph; ``kind`` is its class."""
    return f"<p{_class(kind)}>{escape(text)}</p>"


def bullets(texts: Iterable[str]) -> str:
    """A list."""
    return "<ul>\n" + "\n".join(f"<li>{escape(text)}</li>" for text in texts) + "\n</ul>"


def links(items: Iterable[tuple[str, str, str]]) -> str:
    """A list of links to files beside the page: path, text, and what is said of it.

    An item without a path is text alone.
    """
    lines = []
    for path, text, note in items:
        shown = f'<a href="{escape(path)}">{escape(text)}</a>' if path else escape(text)
        lines.append(f"<li>{shown}: {escape(note)}</li>")
    return "<ul>\n" + "\n".join(lines) + "\n</ul>"


def preformatted(text: str) -> str:
    """Text as it is, a command or a file."""
    return f"<pre><code>{escape(text)}</code></pre>"


def collapsible(summary: str, content: Iterable[str]) -> str:
    """Content that is shown when the reader clicks on its summary."""
    inside = "\n".join(content)
    return f"<details>\n<summary>{escape(summary)}</summary>\n{inside}\n</details>"


def table(
    caption: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    name_columns: int = 1,
    kind: str = "number",
    text_columns: int = 0,
) -> str:
    """A table whose rows begin with ``name_columns`` cells that name the row.

    ``kind``: ``number``, or ``words`` if the cells hold sentences. The last ``text_columns``
    cells always hold sentences.
    """
    body = []
    for row in rows:
        names = "".join(f'<th scope="row">{escape(text)}</th>' for text in row[:name_columns])
        kinds = [
            *(kind for _ in row[name_columns + text_columns :]),
            *("words" for _ in range(text_columns)),
        ]
        cells = "".join(
            f'<td class="{kind_of}">{escape(text)}</td>'
            for kind_of, text in zip(kinds, row[name_columns:], strict=True)
        )
        body.append(f"<tr>{names}{cells}</tr>")
    columns = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    # A region that scrolls needs keyboard focus, and a name for screen readers.
    return "\n".join(
        [
            f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(caption)}">',
            f'<table class="{kind}">',
            f"<caption>{escape(caption)}</caption>",
            f"<thead><tr>{columns}</tr></thead>",
            "<tbody>",
            *body,
            "</tbody>",
            "</table>",
            "</div>",
        ]
    )


def figure(number: int, image: Path, alt: str, caption: str, wide: bool) -> str:
    """A figure with its image inside the page; ``image``: a PNG."""
    content = image.read_bytes()
    width, height = (int.from_bytes(content[at : at + 4], "big") for at in (16, 20))
    coded = base64.b64encode(content).decode("ascii")
    return "\n".join(
        [
            f'<figure id="figure-{number}"{_class("wide" if wide else "")}>',
            f'<img src="data:image/png;base64,{coded}" width="{width}" height="{height}"'
            f' alt="{escape(alt)}">',
            f"<figcaption><strong>Figure {number}.</strong> {escape(caption)}</figcaption>",
            "</figure>",
        ]
    )


def figures(content: Iterable[str]) -> str:
    """Figures side by side if the page is wide enough."""
    return '<div class="figures">\n' + "\n".join(content) + "\n</div>"


def _class(kind: str) -> str:
    return f' class="{escape(kind)}"' if kind else ""
