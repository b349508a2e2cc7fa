"""The tables of message fields in docs/protocol.md, written from the declarations.

    python -m encircle.protocol.describe            is the page current? exit status 1 if not
    python -m encircle.protocol.describe --write    make it so

The first comment of a table names the kind of message.
"""

import json
import sys
from pathlib import Path
from typing import Any

from encircle.protocol.codec import BYTES_MAX
from encircle.protocol.programs.generated_pages import check_or_write, with_parts
from encircle.protocol.wire.declaration import DeclaredField, declared_fields

PAGE = Path("docs/protocol.md")
_HEADER = "| field | type | unit | meaning |\n|---|---|---|---|\n"
_COMMAND = "python -m encircle.protocol.describe"
_BEGIN = f"<!-- fields of {{}}, from protocol/messages.py: {_COMMAND} -->\n"
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
    return with_parts(page, {_BEGIN.format(k.__name__): table(k) for k in BYTES_MAX}, _END)


def main(arguments: list[str]) -> int:
    """Check the page, or write it; the exit status."""
    return check_or_write(PAGE, current, _COMMAND, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
