"""Packages that the base install leaves out: what needs them is told in one line how to get them.

What is imported from such a package stands in ``needing``:

    with needing("--to rerun"):
        import rerun

If the package is missing, that raises ``MissingExtra``, which the command line shows as it is.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple


class Extra(NamedTuple):
    """Where a package comes from: its name in the index, and the extra that has it."""

    distribution: str
    extra: str


PACKAGES = {
    "PIL": Extra("pillow", "export"),
    "av": Extra("av", "export"),
    "bokeh": Extra("bokeh", "viewer"),
    "cryptography": Extra("cryptography", "security"),
    "distributed": Extra("distributed", "studies"),
    "foxglove": Extra("foxglove-sdk", "export"),
    "gymnasium": Extra("gymnasium", "learning"),
    "pandas": Extra("pandas", "studies"),
    "pettingzoo": Extra("pettingzoo", "learning"),
    "pyarrow": Extra("pyarrow", "studies"),
    "rerun": Extra("rerun-sdk", "export"),
    "rosbags": Extra("rosbags", "export"),
    "tornado": Extra("tornado", "viewer"),
}
"""By the name under which a package is imported; of several extras that have it, the usual one."""


class MissingExtra(Exception):
    """A package of an extra is not installed; the message names it and says how to get it."""


@contextmanager
def needing(what: str, extra: str | None = None) -> Iterator[None]:
    """Raise ``MissingExtra`` if an import in this context fails for a package of an extra.

    ``what`` needs it, as the message says; ``extra``: which one to name, if several have it.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        line = missing_line(error, what, extra)
        if line is None:
            raise
        raise MissingExtra(line) from None


def missing_line(
    error: ModuleNotFoundError, what: str = "this command", extra: str | None = None
) -> str | None:
    """How to get the package that could not be imported, None if it is of no extra."""
    package = PACKAGES.get((error.name or "").partition(".")[0])
    if package is None:
        return None
    return f'{what} needs {package.distribution}: pip install "encircle[{extra or package.extra}]"'
