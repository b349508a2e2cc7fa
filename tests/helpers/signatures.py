"""The signatures in ``docs/api.md``, read off the source. By hand: ``python signatures.py``.

They are what the source says, not what ``inspect`` makes of it: a ``Path`` is called ``Path``.
"""

import ast
import inspect
import re
import textwrap
from pathlib import Path
from typing import Any

import encircle

PAGE = Path(__file__).parents[2] / "docs" / "api.md"
ENTRY = re.compile(r"^### `(\w+)`\n\n(?:```python\n(.*?)```\n\n)?", re.MULTILINE | re.DOTALL)
LONGEST = 100


class _Values(ast.NodeTransformer):
    """Names of constants by what they are, and annotations without quotes."""

    def __init__(self, names: dict[str, Any]) -> None:
        self._names = names

    def visit_Name(self, node: ast.Name) -> ast.expr:
        value = self._names.get(node.id)
        return ast.Constant(value) if isinstance(value, str | int | float) else node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.stmt:
        if isinstance(node.annotation, ast.Constant):
            node.annotation = ast.parse(str(node.annotation.value), mode="eval").body
        if isinstance(node.value, ast.Call) and ast.unparse(node.value.func) == "field":
            defaults = [k.value for k in node.value.keywords if k.arg == "default"]
            node.value = defaults[0] if defaults else None
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> ast.arg:
        if isinstance(node.annotation, ast.Constant):
            node.annotation = ast.parse(str(node.annotation.value), mode="eval").body
        return node


def signature(name: str, value: Any) -> str:
    """A function with its arguments, a class with its fields; empty if it has neither."""
    if not (inspect.isfunction(value) or inspect.isclass(value)):
        return ""
    tree = ast.parse(textwrap.dedent(inspect.getsource(value))).body[0]
    tree = _Values(vars(inspect.getmodule(value))).visit(tree)
    if isinstance(tree, ast.FunctionDef):
        return call(name, tree) + "\n"
    assert isinstance(tree, ast.ClassDef)
    # A pydantic model's keys have a page of their own.
    fields = [] if hasattr(value, "model_fields") else tree.body
    lines = [ast.unparse(part) for part in fields if isinstance(part, ast.AnnAssign)]
    methods = [part for part in fields if isinstance(part, ast.FunctionDef) and is_public(part)]
    return "".join(f"{line}\n" for line in [*lines, *(call(m.name, m) for m in methods)])


def is_public(method: ast.FunctionDef) -> bool:
    """A method without an underscore; what a property is stands in the text."""
    properties = {"property", "cached_property"}
    decorated = {ast.unparse(decorator) for decorator in method.decorator_list}
    return method.name == "__call__" or not (method.name.startswith("_") or decorated & properties)


def call(name: str, function: ast.FunctionDef) -> str:
    """A function's head, in several lines if it is long."""
    arguments = function.args
    arguments.args = [a for a in arguments.args if a.arg != "self"]
    returned = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    returned = returned.replace("'", "")
    parts = [
        part.replace("=", " = ", 1) if ":" in part else part
        for part in split(ast.unparse(arguments).replace("'", '"'))
    ]
    line = f"{name}({', '.join(parts)}){returned}"
    if len(line) <= LONGEST:
        return line
    return "\n".join([f"{name}(", *(f"    {part}," for part in parts), f"){returned}"])


def split(arguments: str) -> list[str]:
    """At the commas that are in no brackets."""
    parts, depth = [""], 0
    for character in arguments:
        depth += (character in "([{") - (character in ")]}")
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]


def rewritten(page: str) -> str:
    """The page with the signatures that its entries should have."""

    def entry(match: re.Match[str]) -> str:
        code = signature(match[1], getattr(encircle, match[1]))
        return f"### `{match[1]}`\n\n" + (f"```python\n{code}```\n\n" if code else "")

    return ENTRY.sub(entry, page)


if __name__ == "__main__":
    PAGE.write_text(rewritten(PAGE.read_text()))
