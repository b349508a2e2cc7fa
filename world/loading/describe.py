"""The tables of docs/scenario.md, written from the declarations of a scenario's keys.

    python -m encircle.world.loading.describe            is the page current? exit status 1 if not
    python -m encircle.world.loading.describe --write    make it so

The first comment of a table names what it is of. The page must have every table of a scenario, the
parameters of every target behaviour, those of the robots and those of every policy.
"""

import inspect
import sys
from collections.abc import Sequence
from pathlib import Path
from pkgutil import resolve_name

from encircle.protocol.parameters import SET_BY_ROBOT_KEYS
from encircle.protocol.plugins import SHIPPED_POLICIES
from encircle.protocol.programs.generated_pages import check_or_write, with_parts
from encircle.world.loading.declarations import (
    DeclaredKey,
    keys_of_model,
    keys_of_robot,
    one_line,
    tables_of,
)
from encircle.world.scenario.model import Scenario
from encircle.world.scenario.plugin_parameters import parameters_of
from encircle.world.targets.behaviours import BUILT_IN

PAGE = Path("docs/scenario.md")
_COMMAND = "python -m encircle.world.loading.describe"
_BEGIN = f"<!-- keys of {{}}, from the declarations: {_COMMAND} -->\n"
_END = "<!-- end of keys -->\n"
_HEADER = "| key | type | unit | values | default | meaning |\n|---|---|---|---|---|---|\n"


def sections() -> dict[str, str]:
    """What stands between the comments, by what the first of them names."""
    texts = {
        model.__name__: _section(model.__doc__, keys_of_model(model))
        for model in tables_of(Scenario)
    }
    texts["robot"] = _section(None, keys_of_robot(SET_BY_ROBOT_KEYS))
    texts |= {
        f"behaviour {name}": _section(behaviour.__doc__, keys_of_model(parameters_of(behaviour)))
        for name, behaviour in BUILT_IN.items()
    }
    for name, where in SHIPPED_POLICIES.items():
        policy = resolve_name(where)
        texts[f"policy {name}"] = _section(policy.__doc__, keys_of_model(parameters_of(policy)))
    return texts


def current(page: str) -> str:
    """The page with its tables as the declarations have them; ``ValueError`` for one without."""
    return with_parts(page, {_BEGIN.format(k): text for k, text in sections().items()}, _END)


def _section(docstring: str | None, keys: Sequence[DeclaredKey]) -> str:
    paragraphs = inspect.cleandoc(docstring or "").split("\n\n")
    prose = "".join(f"{one_line(paragraph)}\n\n" for paragraph in paragraphs if paragraph)
    if not keys:
        return prose
    rows = [
        f"| `{name}` | {kind} | {unit} | {values} | {default} | {meaning} |\n"
        for name, kind, unit, values, default, meaning in keys
    ]
    return f"{prose}{_HEADER}{''.join(rows)}"


def main(arguments: list[str]) -> int:
    """Check the page, or write it; the exit status."""
    return check_or_write(PAGE, current, _COMMAND, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
