"""The generated tables of docs/policies.md: what a policy gets and answers, and those that ship.

    python -m encircle.conformance.describe            is the page current? exit status 1 if not
    python -m encircle.conformance.describe --write    make it so

Of ``View``, ``Peer`` and ``Decision`` each field's type, default and docstring are read from the
source. Of a shipped policy: the first sentence of its docstring, its own parameters, and what
follows ``Source:`` in it or in its module's, and ``Payload:`` in the latter. A hunt shows how
many bytes it says.
"""

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import msgpack

from encircle.agents.policies.interface import Decision, Peer, View
from encircle.conformance.scenes import record, scenarios
from encircle.protocol.plugins import SHIPPED_POLICIES
from encircle.protocol.programs.generated_pages import check_or_write, with_parts
from encircle.world.loading.declarations import field_docstrings, one_line
from encircle.world.scenario.plugin_parameters import parameters_of

PAGE = Path("docs/policies.md")
SCENE = "plain"
_COMMAND = "python -m encircle.conformance.describe"
_BEGIN = f"<!-- {{}}, from the code: {_COMMAND} -->\n"
_END = "<!-- end of what is from the code -->\n"
_FIELDS = "| field | type | default | meaning |\n|---|---|---|---|\n"
_POLICIES = "| policy | in a line | own parameters | says | source |\n|---|---|---|---|---|\n"


def sections() -> dict[str, str]:
    """What stands between the comments, by what the first of them names."""
    fields = {cls.__name__: fields_table(cls) for cls in (View, Peer, Decision)}
    rows = [policy_row(name, where) for name, where in SHIPPED_POLICIES.items()]
    return {**fields, "policies": _POLICIES + "".join(rows)}


def current(page: str) -> str:
    """The page with its tables as the code has them; ``ValueError`` for one without."""
    return with_parts(page, {_BEGIN.format(name): text for name, text in sections().items()}, _END)


def fields_table(cls: type[tuple[Any, ...]]) -> str:
    """A row for each field of a class, and for each property; ``TypeError`` without a docstring."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    assert isinstance(tree, ast.ClassDef)
    meanings = field_docstrings(cls)
    rows = []
    for part in tree.body:
        if isinstance(part, ast.AnnAssign):
            name, annotation, default = ast.unparse(part.target), part.annotation, part.value
            meaning = meanings.get(name, "")
        elif isinstance(part, ast.FunctionDef) and part.returns is not None:
            name, annotation, default = part.name, part.returns, None
            meaning = one_line(ast.get_docstring(part) or "")
        else:
            continue
        if not meaning:
            raise TypeError(f"{cls.__name__}.{name}: has no docstring that says what it means")
        shown = "" if default is None else f"`{ast.unparse(default)}`"
        cells = (f"`{name}`", f"`{ast.unparse(annotation)}`", shown, meaning)
        rows.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |\n")
    return _FIELDS + "".join(rows)


def policy_row(name: str, where: str) -> str:
    """What is told of a shipped policy; ``TypeError`` if its module names no source."""
    policy: Callable[..., Any] = resolve_name(where)
    module = inspect.getmodule(policy)
    assert module is not None
    docstring = inspect.getdoc(module) or ""
    file = where.partition(":")[0].removeprefix("encircle.").replace(".", "/") + ".py"
    line = one_line((inspect.getdoc(policy) or "").split("\n\n")[0])
    own = ", ".join(f"`{parameter}`" for parameter in parameters_of(policy).model_fields)
    if own:
        own = f"[{own}](scenario.md#strategy--{name})"
    source = sentence(inspect.getdoc(policy) or "", "Source") or sentence(docstring, "Source")
    if not source:
        raise TypeError(f"{file}: its docstring has no paragraph 'Source: ...'")
    cells = (
        f"`{name}`",
        line,
        own or "none",
        _said(name, docstring),
        f"{source.removesuffix('.')}; [theory](../{file})",
    )
    return f"| {' | '.join(cells)} |\n"


def sentence(docstring: str, head: str) -> str:
    """The first sentence after ``head:`` at the beginning of a paragraph; empty if there is none.

    A full stop ends it after a bracket, a quotation mark, a digit or a small letter, if a capital
    follows: those of names (``New J. Phys. 19``) do not.
    """
    found = re.search(rf"^{head}: (.*?)(?:\n\n|\Z)", docstring, re.MULTILINE | re.DOTALL)
    text = one_line(found[1]) if found else ""
    return re.split(r"(?<=[a-z0-9)\"]\.) (?=[A-Z])", text)[0]


def _said(name: str, docstring: str) -> str:
    """What it says and how large that is, in msgpack."""
    hunt = record({SCENE: scenarios(name, (), 4)[SCENE]})
    said = [d.say for part in hunt.participations for d in part.decisions if d.say]
    if not said:
        return "nothing"
    payload = sentence(docstring, "Payload").removesuffix(".")
    return f"{payload}; at most {max(len(msgpack.packb(s)) for s in said)} B"


def main(arguments: list[str]) -> int:
    """Check the page, or write it; the exit status."""
    return check_or_write(PAGE, current, _COMMAND, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
