"""Plug-ins are found as they are installed now, though a process remembers what it has found."""

import os
import shutil

import helpers_plugins as plugins

from encircle.protocol.plugins import TARGETS, installed


def test_what_is_installed_or_removed_while_a_process_runs_is_noticed(tmp_path, monkeypatch):
    # Its last change lies back, so the next one shows however coarse the clock of files is.
    os.utime(tmp_path, (0, 0))
    plugins.make_importable(tmp_path, monkeypatch)
    before = installed(TARGETS)
    assert "tiptoe" not in before
    plugins.put_there(tmp_path, {}, ["targets tiptoe = strangers:tiptoe"])
    assert installed(TARGETS)["tiptoe"].source == "strangers:tiptoe of strangers 1.0"
    shutil.rmtree(tmp_path / "strangers-1.0.dist-info")
    os.utime(tmp_path, (1, 1))
    assert installed(TARGETS) == before


def test_who_changes_an_answer_changes_no_other(tmp_path):
    names = set(installed(TARGETS))
    installed(TARGETS).clear()
    assert set(installed(TARGETS)) == names
