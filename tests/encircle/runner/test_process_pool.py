"""Processes for work: one that cannot even be started is a process that has died."""

from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import pytest

from encircle.cli.main import main
from encircle.runner.process_pool import in_processes


def test_a_process_that_is_gone_before_it_has_begun_has_died(monkeypatch):
    def submit(*_arguments):
        raise BrokenPipeError("Broken pipe")

    monkeypatch.setattr(ProcessPoolExecutor, "submit", submit)
    with pytest.raises(BrokenProcessPool, match="no process can be started: Broken pipe"):
        list(in_processes(abs, [1], 1))


def test_a_command_says_so_in_one_line(monkeypatch, tmp_path, capsys):
    def reproduce(*_arguments, **_options):
        raise BrokenProcessPool("no process can be started")

    monkeypatch.setattr("encircle.paper.reproduce.reproduce", reproduce)
    assert main(["reproduce", "--out", str(tmp_path / "made")]) == 1
    said = capsys.readouterr().err
    assert said == "encircle: a process for the work is gone: no process can be started\n"
