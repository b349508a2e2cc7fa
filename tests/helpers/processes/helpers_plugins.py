"""Packages with policies, targets and measures, as installed or as a work in progress."""

import importlib
import os
import sys
from pathlib import Path

STRATEGY = """
from encircle import Decision


def chase(memory, view):
    x, y = view.position
    goal = view.target.position if view.target else (x, y)
    return memory, Decision("chase", (goal[0] - x, goal[1] - y), goal)
"""


def put_there(folder, files, entries, name="strangers", version="1.0"):
    """A distribution in a folder: ``files`` by their way, ``entries`` as ``group name = value``."""
    for way, text in files.items():
        path = Path(folder) / way
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    info = Path(folder) / f"{name}-{version}.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = []
    for entry in entries:
        group, said = entry.split(" ", 1)
        lines += [f"[encircle.{group}]", said]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


def make_importable(folder, monkeypatch):
    """Let this process, and those that it starts, find what is there; forgotten after the test."""
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
    importlib.invalidate_caches()


def forget(folder):
    """Import anew, at the next time, what lies in a folder."""
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", "") or "").startswith(str(folder)):
            del sys.modules[name]
    importlib.invalidate_caches()
