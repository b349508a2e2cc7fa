"""The policy under examination: found by its name, its form looked at, its lines named.

What cannot be found under a name is bad usage; what is found but is no policy gets an explanation.
"""

import ast
import inspect
import os
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

from encircle.agents.policies.registry import REGISTRY
from encircle.check_results import CheckResult
from encircle.protocol.errors import did_you_mean
from encircle.protocol.plugin_files import FOLDERS, FileProblem, is_in_file
from encircle.protocol.plugins import PluginLoadError, UnknownPlugin, error_line

FORM = "def policy(memory, view, *, own parameters): ... return memory, Decision(...)"


class NoSuchPolicy(Exception):
    """Nothing has that name; the message says what is near."""


@dataclass(frozen=True)
class Subject:
    """A policy that can be asked. ``function``: as it is written, ``ask``: with its parameters."""

    name: str
    function: Callable[..., Any]
    parameters: Mapping[str, Any]

    @property
    def ask(self) -> Callable[..., Any]:
        """The policy as a hunt asks it: ``(memory, view)``."""
        return partial(self.function, **self.parameters) if self.parameters else self.function

    @property
    def file(self) -> Path | None:
        """The file that it is in, None if in none that can be read."""
        try:
            file = inspect.getsourcefile(inspect.unwrap(self.function))
        except TypeError:
            file = None
        return Path(file).resolve() if file else None

    @property
    def module(self) -> ModuleType | None:
        """The module that it is in."""
        return inspect.getmodule(inspect.unwrap(self.function))

    def place_in(self, error: BaseException) -> str:
        """`` (my_robots.py, line 12)`` where an error came from; empty if not from its file."""
        lines = [
            frame.lineno
            for frame in traceback.extract_tb(error.__traceback__)
            if self._is_own(frame.filename)
        ]
        return f" ({self._shown_file}, line {lines[-1]})" if lines else ""

    def place_of(self, frame: FrameType | None) -> str:
        """As ``place_in``, for a call that goes on: its innermost line in the policy's file."""
        while frame is not None:
            if self._is_own(frame.f_code.co_filename):
                return f" ({Path(frame.f_code.co_filename).name}, line {frame.f_lineno})"
            frame = frame.f_back
        return ""

    def _is_own(self, filename: str) -> bool:
        """Whether a file is the policy's own, or one that lies beside it."""
        return self.file is not None and Path(filename).resolve().parent == self.file.parent

    @property
    def _shown_file(self) -> str:
        return self.file.name if self.file else ""


def found(name: str) -> tuple[Callable[..., Any] | None, CheckResult]:
    """What a name stands for, None if it cannot be used, and what is to be said of it.

    ``NoSuchPolicy`` if it stands for nothing.
    """
    if name.endswith(".py"):
        raise NoSuchPolicy(f"{name}: name its function too, as {name}:{_example(name)}")
    try:
        function = REGISTRY.named(name)
    except UnknownPlugin as error:
        raise NoSuchPolicy(f"{name}: {error}") from None
    except PluginLoadError as error:
        if error.__cause__ is None:
            if isinstance(error.__context__, FileProblem):
                raise NoSuchPolicy(f"{error}{_nearest(name)}") from None
            return None, CheckResult("policy", "wrong", str(error), f"a policy is: {FORM}")
        return None, _not_imported(name, error.__cause__)
    problem = form_problem(function)
    if problem:
        return None, CheckResult("policy", "wrong", f"{name} {problem[0]}", problem[1])
    return function, CheckResult("policy", "ok", f"{name} is {described(function)}")


def described(function: Callable[..., Any]) -> str:
    """A policy as its signature shows it."""
    own = [
        parameter.name
        for parameter in inspect.signature(function).parameters.values()
        if parameter.kind is parameter.KEYWORD_ONLY
    ]
    named = getattr(inspect.unwrap(function), "__name__", type(function).__name__)
    return f"{named}(memory, view)" + (f", own parameters: {', '.join(own)}" if own else "")


def form_problem(function: Any) -> tuple[str, str] | None:
    """What is wrong with the form of something that is to be a policy, and what to do."""
    if inspect.isclass(function):
        return (
            "is a class",
            f"a policy is a function; what it remembers it returns, and is given back: {FORM}",
        )
    if inspect.iscoroutinefunction(function) or inspect.isgeneratorfunction(function):
        return "is async, or yields", f"a policy is a plain function: {FORM}"
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return None
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    names = ", ".join(p.name for p in positional) or "nothing"
    if any(p.kind is p.VAR_POSITIONAL for p in parameters):
        return "takes any number of arguments", f"its own parameters are known by name: {FORM}"
    if len(positional) == 1:
        return (
            f"takes {names} alone, the form before policies remembered",
            f"take memory first, None at first, and return it with the decision: {FORM}",
        )
    if len(positional) > 2:
        return (
            f"takes {names}",
            f"own parameters stand behind a star, and are set by name: {FORM}",
        )
    if len(positional) < 2:
        return f"takes {names}", f"it is asked with what it remembers and its view: {FORM}"
    if positional[0].name == "view" or positional[1].name == "memory":
        return f"takes {names}", f"memory comes first: {FORM}"
    if any(p.kind is p.VAR_KEYWORD for p in parameters):
        return "takes any own parameters", f"name each, so that a mistyped one is refused: {FORM}"
    return None


def _not_imported(name: str, cause: BaseException) -> CheckResult:
    """What is to be said of a file, or a plug-in, that raises when it is imported."""
    file = name.rpartition(":")[0]
    if isinstance(cause, SyntaxError):
        where = f"{Path(cause.filename or file).name}, line {cause.lineno}"
        said = f"{where} cannot be read: {cause.msg}: {(cause.text or '').strip()}"
        return CheckResult("policy", "wrong", said, "mend that line, or one before it")
    lines = [
        (Path(frame.filename).name, frame.lineno)
        for frame in traceback.extract_tb(cause.__traceback__)
        if not is_in_file(name) or Path(frame.filename).name == Path(file).name
    ]
    where = f"{lines[-1][0]}, line {lines[-1][1]}" if lines else name
    advice = "what a file does when it is imported happens in every robot before it joins"
    if isinstance(cause, ImportError):
        advice = "install it in this environment, or put it beside the policy's file"
    return CheckResult("policy", "wrong", f"{where}: {error_line(cause)}", advice)


def _nearest(name: str) -> str:
    """The file or function that was perhaps meant."""
    file, _, function = name.rpartition(":")
    for folder in _folders():
        path = folder / Path(file).expanduser()
        if path.is_file():
            return did_you_mean(function, _functions_in(path))
        beside = [f"{Path(file).parent / p.name}" for p in path.parent.glob("*.py")]
        if hint := did_you_mean(file, beside):
            return hint
    return ""


def _example(file: str) -> str:
    """A function to name, of a file that was named without one."""
    for folder in _folders():
        path = folder / Path(file).expanduser()
        if path.is_file():
            return next(iter(_functions_in(path)), "function")
    return "function"


def _functions_in(path: Path) -> list[str]:
    """The functions that a file defines, without importing it."""
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return []
    names = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    return [name for name in names if not name.startswith("_")]


def _folders() -> list[Path]:
    listed = filter(None, os.environ.get(FOLDERS, "").split(os.pathsep))
    return [*map(Path, listed), Path.cwd()]
