"""Our programs as commands."""

import sys

PACKAGES = ("agents", "world")


def ours(program: str, *arguments: str) -> list[str]:
    """The command of a node, ``agents`` or ``world``, or ``python -m`` anything else."""
    module = f"encircle.{program}" if program in PACKAGES else program
    return [sys.executable, "-m", module, *map(str, arguments)]
