"""The tables of message fields in docs/protocol.md, written from the declarations.

    python -m encircle.protocol.describe            is the page current? exit status 1 if not
    python -m encircle.protocol.describe --write    make it so

A table stands between two comments, of which the first names the kind of message. Whatever else is
on the page is written by hand.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

from encircle.protocol.codec import BYTES_MAX
from encircle.protocol.process.log import say, say_error
from encircle.protocol.wire.declaration import DeclaredField, declared_fields

PAGE = Path("docs/protocol.md")
_HEADER = "| field | type | unit | meaning |\n|---|---|---|---|\n"
_BEGIN = "<!-- fields of {}, from protocol/messages.py: python -m encircle.protocol.describe -->\n"
_END = "<!-- end of fields -->\n"


def table(kind: type[Any]) -> str:
    """The rows of a kind of message as a Markdown table."""
    return _HEADER + "".join(map(_row, declared_fields(kind)))


def _row(field: DeclaredField) -> str:
    meaning = field.meaning
    if field.may_be_left_out:
        meaning += f"; may be left out, and is then {json.dumps(field.default)}"
    return f"| `{field.name}` | {field.type.text} | {field.unit} | {meaning} |\n"


def current(page: str) -> str:
    """The page with its tables as the declarations have them; ``ValueError`` for one without."""
    for kind in BYTES_MAX:
        begin = _BEGIN.format(kind.__name__)
        section = re.compile(f"({re.escape(begin)}).*?({re.escape(_END)})", re.DOTALL)
        rows = table(kind).replace("\\", r"\\")
        page, places = section.subn(rf"\g<1>{rows}\g<2>", page)
        if places != 1:
            raise ValueError(f"{places} places for the fields of {kind.__name__}, 1 is needed")
    return page


def main(arguments: list[str]) -> int:
    """Check the page, or write it; the exit status."""
    if arguments not in ([], ["--write"]):
        say_error("usage: python -m encircle.protocol.describe [--write]")
        return 2
    try:
        text = PAGE.read_text(encoding="utf-8")
        described = current(text)
    except (OSError, ValueError) as error:
        say_error(f"{PAGE}: {error}")
        return 1
    if described == text:
        say(f"{PAGE} is current")
        return 0
    if not arguments:
        say_error(f"{PAGE} is not current: run python -m encircle.protocol.describe --write")
        return 1
    PAGE.write_text(described, encoding="utf-8")
    say(f"{PAGE} is written")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
