"""Bars in notebooks: by default there, and nowhere else."""

import sys
from types import SimpleNamespace

import pytest

import encircle
from encircle import progress
from encircle.progress import DRAWN_S, NotebookBar, in_notebook, no_progress, notebook_progress


@pytest.fixture
def shown(monkeypatch):
    """What is displayed: pairs of HTML and whether it replaces; this process is a kernel."""
    outputs = []
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setattr(
        progress, "_displayed", lambda _id: lambda html, update: outputs.append((html, update))
    )
    return outputs


def test_here_is_no_notebook(monkeypatch):
    assert not in_notebook()
    for shell in (None, SimpleNamespace()):
        interactive = SimpleNamespace(get_ipython=lambda shell=shell: shell)
        monkeypatch.setitem(sys.modules, "IPython", interactive)
        assert not in_notebook()
        with notebook_progress("work", "runs") as tell:
            assert tell is no_progress


def test_a_bar_is_drawn_now_and_then_and_ends_as_a_line():
    now_s, shown = [0.0], []
    bar = NotebookBar("a <b>", "ticks", lambda: now_s[0], lambda *output: shown.append(output))
    bar(0, 50)
    now_s[0] += DRAWN_S / 2
    bar(1, 50)
    now_s[0] += DRAWN_S
    bar(20, 50)
    bar(50, 50)
    bar.end()
    assert [update for _, update in shown] == [False, True, True]
    assert '<progress value="20" max="50">' in shown[1][0]
    assert "a &lt;b&gt;: 20 of 50 ticks" in shown[1][0]
    assert "50 ticks" in shown[2][0]
    assert "<progress" not in shown[2][0]


def test_work_that_tells_nothing_leaves_nothing(shown):
    with notebook_progress("work", "runs"):
        pass
    with notebook_progress("work", "runs") as tell:
        tell(7, 7)
    assert shown == []


def test_a_study_shows_a_bar_in_a_notebook_and_none_if_it_tells_somebody(shown, tmp_path):
    plan = {"name": "short", "scenario": "sim1", "seeds": 1, "set": {"ticks_max": 2}}
    # One bar for what is missing, none where all is there.
    told = []
    encircle.study(plan, out=tmp_path / "told").run(
        workers=1, progress=lambda *done: told.append(done)
    )
    assert told[-1] == (1, 1)
    assert shown == []
    encircle.study(plan, out=tmp_path / "shown").run(workers=1)
    assert "0 of 1 runs" in shown[0][0]
    assert "short: 1 runs" in shown[-1][0]
    before = len(shown)
    encircle.study(plan, out=tmp_path / "shown").table()
    assert len(shown) == before


def test_a_hunt_shows_its_ticks(shown, monkeypatch):
    """A hunt tells now and then; here at every tick."""
    from encircle.runner import hunts

    monkeypatch.setattr(hunts, "PROGRESS_PERIOD_S", 0.0)
    encircle.run("sim1", link="memory", overrides=["ticks_max=5"])
    assert "Simulation 1: four robots: " in shown[0][0]
    assert "of 5 ticks" in shown[0][0]
    before = len(shown)
    encircle.run("sim1", link="memory", progress=lambda _report: None)
    assert len(shown) == before
