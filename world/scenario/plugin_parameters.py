"""A plug-in's own parameters: the keyword-only arguments of a policy or of a target's behaviour.

Each is declared by its annotation, which carries range, unit and meaning: pydantic's ``Field``, or
the marks ``Range``, ``Unit`` and ``Meaning`` of ``encircle.protocol.parameters``, which spare a
robot an import.
"""

import inspect
import json
from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from encircle.protocol.errors import suggestion
from encircle.protocol.parameters import Meaning, Problems, Range
from encircle.protocol.plugins import error_line
from encircle.world.scenario.fields import shown
from encircle.world.scenario.validation import Path as KeyPath
from encircle.world.scenario.validation import problems_in

Function = Callable[..., Any]
GIVEN = 2
"""Each is called with what it remembers and what it sees."""


def check_parameters(function: Function, parameters: Mapping[str, Any]) -> None:
    """``Problems`` listing parameters that a plug-in lacks, needs or cannot take.

    Another ``ValueError`` if it does not take memory and view, or if its annotations cannot be
    understood.
    """
    try:
        # Functions are hashable; other people's callables may not be.
        is_function = inspect.isfunction(function)
        model = _parameters_of_function(function) if is_function else parameters_of(function)
    except WrongForm:
        raise
    except Exception as error:
        # They are other people's code.
        raise ValueError(f"its parameters cannot be understood: {error_line(error)}") from None
    tree = dict(parameters)
    if lines := [
        f"{name} = {shown(value)}: must be made of numbers, texts, truth values, lists and tables"
        for name, value in tree.items()
        if not _is_plain(value)
    ]:
        raise Problems(lines)
    try:
        # The function gets what was written, so "5" must not pass for 5; lists may be tuples.
        model.model_validate_json(json.dumps(tree), strict=True)
    except ValidationError as error:
        found = problems_in(error, model, tree)
        raise Problems([line + _known(path, line, model) for path, line in found.items()]) from None


def _known(path: KeyPath, line: str, model: type[BaseModel]) -> str:
    """What to add to a problem that is a parameter's name: those that there are."""
    name, known = str(path[0]), list(model.model_fields)
    if len(path) > 1 or name in known:
        return ""
    # A name without its unit is shorter than what is like it.
    longer = [other for other in known if other.startswith(f"{name}_")]
    near = "" if "did you mean" in line else suggestion(longer)
    return f"{near}; " + (f"known are: {', '.join(known)}" if known else "there are none")


def _is_plain(value: Any) -> bool:
    try:
        json.dumps(value).encode()
    except (TypeError, ValueError, RecursionError):
        return False
    return True


class WrongForm(ValueError):
    """A plug-in that does not take ``(memory, view, *, own parameters)``."""


def parameters_of(function: Function) -> type[BaseModel]:
    """A plug-in's parameters as a model: a field for each keyword-only argument.

    ``WrongForm`` if it does not take two arguments besides.
    """
    if inspect.isclass(function):
        raise WrongForm("it is a class, must be a function")
    if inspect.iscoroutinefunction(function) or inspect.isgeneratorfunction(function):
        raise WrongForm("it is async, or yields; must be a plain function")
    signature = inspect.signature(function)
    try:
        required = {
            name: None
            for name, p in signature.parameters.items()
            if p.kind is p.KEYWORD_ONLY and p.default is p.empty
        }
        signature.bind(*[None] * GIVEN, **required)
    except TypeError:
        raise WrongForm(
            f"it takes {signature}, must take (memory, view), and its own parameters after a *"
        ) from None
    hints = get_type_hints(_annotated(function), include_extras=True)
    wanted: dict[str, Any] = {
        name: (_constrained(hints.get(name, Any)), ... if p.default is p.empty else p.default)
        for name, p in signature.parameters.items()
        if p.kind is p.KEYWORD_ONLY
    }
    return create_model("Parameters", __config__=ConfigDict(extra="forbid"), **wanted)


def _annotated(function: Function) -> Function:
    """The function whose annotations are those of a callable, which may be an object."""
    while isinstance(function, partial):
        function = function.func
    function = inspect.unwrap(function)
    known = inspect.isroutine(function) or inspect.isclass(function)
    return function if known else type(function).__call__


_parameters_of_function = lru_cache(maxsize=64)(parameters_of)


def _constrained(annotation: Any) -> Any:
    """The annotation, our own marks of range and meaning put as pydantic has them."""
    if get_origin(annotation) is not Annotated:
        return annotation
    inner, *marks = get_args(annotation)
    for mark in marks:
        if isinstance(mark, Range):
            inner = Annotated[inner, Field(ge=mark.low, le=mark.high)]
        elif isinstance(mark, Meaning):
            inner = Annotated[inner, Field(description=mark.text)]
        else:
            inner = Annotated[inner, mark]
    return inner
