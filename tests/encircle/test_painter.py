"""Pictures drawn by a process that gets ready meanwhile: the same, and it is gone after them."""

import os
import subprocess
import sys
from pathlib import Path

from helpers_waiting import completed, until

import encircle
from encircle.cli.painter import Painter
from encircle.figures.run_figures import picture_of_run

DRAW = (
    "import sys; from pathlib import Path; from encircle.cli.painter import Painter;"
    "made = Painter().draw(Path(sys.argv[1])); Path(sys.argv[2]).write_bytes(made)"
)


def test_the_picture_is_the_one_that_would_be_drawn_here(tmp_path):
    encircle.run("sim2", link="memory", out=tmp_path / "run", overrides=["ticks_max=5"])
    done = completed([sys.executable, "-c", DRAW, str(tmp_path / "run"), str(tmp_path / "made")])
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "made").read_bytes() == picture_of_run(tmp_path / "run")


def test_who_cannot_draw_says_nothing_and_leaves_it_to_its_parent(tmp_path):
    done = completed([sys.executable, "-c", DRAW, str(tmp_path / "none"), str(tmp_path / "made")])
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "made").read_bytes() == b""


def test_beside_threads_nothing_is_forked(monkeypatch):
    monkeypatch.setattr("threading.active_count", lambda: 2)
    monkeypatch.setattr(os, "fork", lambda: 1 / 0)
    painter = Painter()
    assert painter.draw(Path("anywhere")) == b""
    painter.close()


def test_it_ends_with_a_parent_that_is_killed():
    script = (
        "import time; from encircle.cli.painter import Painter; painter = Painter();"
        "print(painter._pid, flush=True); time.sleep(3600)"
    )
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        entry = Path("/proc") / parent.stdout.readline().strip()
        assert entry.exists()
        parent.kill()
    until(lambda: not entry.exists(), "its end")
