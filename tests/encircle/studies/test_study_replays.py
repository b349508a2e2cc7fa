"""Replays of a study's telling runs: which they are, that they are the table's, and their links."""

import base64
import gzip
import json
import re
import sys
from contextlib import closing

import numpy as np
import pytest
from helpers_pages import Page
from helpers_studies import LOSS, filled, loss_only, never, study_plan
from helpers_waiting import completed

import encircle
from encircle.protocol.process.interrupts import Interrupted
from encircle.studies import replays as replays_module
from encircle.studies.command.request import Request
from encircle.studies.command.study_command import run_study
from encircle.studies.replays import recorded_again, write_replays
from encircle.studies.report.report import write_report
from encircle.studies.summary import summarise
from encircle.studies.telling_runs import (
    FIRST_FAILED,
    MEDIAN,
    UNCAPTURED,
    WORST,
    Replay,
    TellingRun,
    extremes,
    telling_runs,
)

TREE = {
    "name": "small",
    "title": "A <small> study",
    "scenario": "sim1",
    "seeds": 5,
    "set": {"channel.loss.model": "bernoulli", "team.jitter_m": 0.5, "ticks_max": 40},
    "axes": [{**LOSS, "values": [0.0, 0.95]}],
    "measures": ["captured"],
}
GRUMPY = """
from encircle.agents.policies.paper import xi_star


def grumpy(memory, view):
    print("not for standard output")
    if view.tick == 5:
        raise ValueError("enough")
    return xi_star(memory, view)
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    study = encircle.study(TREE, tmp_path_factory.mktemp("made") / "t")
    study.run(workers=2)
    return study


def chosen(study, every_cell=False):
    with closing(study.open()) as table:
        summary = summarise(study.plan, table)
        return telling_runs(study.plan, table, summary, every_cell), table.read().to_pandas()


def in_page(path):
    """The scene in a replay's page."""
    found = re.search(r'id="recording">([^<]+)</script>', path.read_text(encoding="utf-8"))
    return json.loads(gzip.decompress(base64.b64decode(found[1])))


@pytest.mark.parametrize("truth", [loss_only, never])
@pytest.mark.parametrize("seeds", [1, 2, 7, 12])
def test_of_a_cell_the_median_the_worst_and_the_first_without_a_capture_are_told(
    tmp_path, truth, seeds
):
    plan = study_plan(axes=[LOSS], seeds=seeds)
    with closing(filled(plan, tmp_path / "t", truth)) as table:
        summary = summarise(plan, table)
        runs = telling_runs(plan, table, summary, True)
        rows = table.read().to_pandas()
    for cell in range(len(plan.cells)):
        mine = rows[rows["cell"] == cell].sort_values("seed")
        ranked = sorted(
            (not captured, ticks, seed)
            for captured, ticks, seed in zip(
                mine["captured"], mine["ticks"], mine["seed"], strict=True
            )
        )
        expected = {MEDIAN: ranked[(seeds - 1) // 2][2]}
        expected[WORST] = min(seed for *rank, seed in ranked if rank == list(ranked[-1][:2]))
        if lost := mine[mine["captured"] == 0.0]["seed"].tolist():
            expected[UNCAPTURED] = lost[0]
        told = {reason: run.seed for run in runs if run.cell == cell for reason in run.reasons}
        assert told == expected
    assert len({(run.cell, run.seed) for run in runs}) == len(runs)


def test_few_are_of_the_two_cells_that_differ_most(tmp_path):
    plan = study_plan(axes=[LOSS], seeds=12)
    with closing(filled(plan, tmp_path / "t")) as table:
        summary = summarise(plan, table)
        runs = telling_runs(plan, table, summary, False)
    rates = [cell.rate.value for cell in summary.cells]
    assert {run.cell for run in runs} == {int(np.argmin(rates)), int(np.argmax(rates))}
    with closing(filled(study_plan(seeds=3), tmp_path / "one")) as table:
        assert extremes(summarise(study_plan(seeds=3), table)) == (0,)


def test_pages_show_the_runs_that_were_counted(made, tmp_path):
    runs, rows = chosen(made)
    replays = write_replays(made.plan, runs, tmp_path)
    assert [replay.run for replay in replays] == runs
    for run, replay in zip(runs, replays, strict=True):
        row = rows[(rows["cell"] == run.cell) & (rows["seed"] == run.seed)].iloc[0]
        _, digest = recorded_again(made.plan, run)
        assert digest == run.digest == row["digest"]
        assert replay.problem == ""
        shown = in_page(tmp_path / replay.page)
        assert len(shown["frames"]) == row["ticks"] + 1
        assert shown["frames"][-1]["cap"] == row["captured"]
        assert shown["stage"]["seed"] == run.seed
        level = made.plan.axes[0].levels[made.plan.cells[run.cell][0]]
        assert shown["stage"]["title"] == f"A <small> study: packet loss {100 * level:g} %"
        assert shown["status"]["complete"] is True


def test_a_page_that_is_there_is_not_made_again(made, tmp_path, monkeypatch):
    run = chosen(made)[0][0]
    (replay,) = write_replays(made.plan, [run], tmp_path)
    monkeypatch.setattr(replays_module, "recorded_again", None)
    assert write_replays(made.plan, [run], tmp_path) == [replay]


def test_a_run_that_comes_out_otherwise_is_not_shown(made, tmp_path):
    run = chosen(made)[0][0]._replace(digest="another")
    (replay,) = write_replays(made.plan, [run], tmp_path)
    assert replay.page == ""
    assert replay.problem.endswith(", not to another")
    assert list(tmp_path.iterdir()) == []


def test_what_takes_long_is_left_out_of_few(made, tmp_path):
    runs = [run._replace(wall_s=4.0) for run in chosen(made)[0]]
    replays = write_replays(made.plan, runs, tmp_path, wall_s_max=9.0)
    assert [bool(replay.page) for replay in replays] == [True, True] + [False] * (len(runs) - 2)
    assert {replay.problem for replay in replays[2:]} == {"it takes long: --replays all shows it"}


def test_one_that_takes_long_leaves_room_for_those_that_do_not(made, tmp_path):
    first, *others = chosen(made)[0]
    runs = [first._replace(wall_s=9.5), *(run._replace(wall_s=1.0) for run in others)]
    replays = write_replays(made.plan, runs, tmp_path, wall_s_max=9.0)
    assert [bool(replay.page) for replay in replays] == [False] + [True] * len(others)


def test_a_run_that_fails_is_shown_as_far_as_it_comes(tmp_path, monkeypatch, capfd):
    # Not by the variable: the tests' workers have the environment in which their server began.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "grumpy_robots.py").write_text(GRUMPY, encoding="utf-8")
    tree = {**TREE, "axes": [], "strategies": ["xi-star", "grumpy_robots.py:grumpy"], "seeds": 2}
    study = encircle.study(tree, tmp_path / "t")
    study.run(workers=1)
    with closing(study.open()) as table:
        runs = telling_runs(study.plan, table, None, False)
    (run,) = runs
    assert run.reasons == (FIRST_FAILED,)
    assert (run.cell, run.seed) == (1, 1)
    capfd.readouterr()
    (replay,) = write_replays(study.plan, runs, study.directory)
    assert capfd.readouterr().out == ""
    shown = in_page(study.directory / replay.page)
    assert [frame["t"] for frame in shown["frames"]] == list(range(6))
    assert shown["status"]["complete"] is False


def test_a_team_that_cannot_be_placed_is_no_reason_to_lose_the_report(made, tmp_path):
    crowd = {**TREE, "scenario": {"team": {"robots": 60, "placement": {"distance_m_max": 4.5}}}}
    plan = encircle.study({**crowd, "axes": [], "set": {}}, tmp_path / "t").plan
    run = TellingRun(0, 1, (FIRST_FAILED,), False, 0, "", 0.0, "no room")
    (replay,) = write_replays(plan, [run], tmp_path)
    assert replay.problem.startswith("it cannot be shown: ScenarioError: ")


def test_an_interruption_leaves_no_half_page(made, tmp_path, monkeypatch):
    def interrupted(_plan, _run):
        raise Interrupted("stopped by SIGINT")

    monkeypatch.setattr(replays_module, "recorded_again", interrupted)
    with pytest.raises(Interrupted):
        write_replays(made.plan, chosen(made)[0], tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_the_report_links_them_and_says_what_each_is(made, tmp_path):
    runs, _ = chosen(made)
    replays = [
        *write_replays(made.plan, runs[:1], tmp_path),
        Replay(runs[1], "", "no <reason>"),
    ]
    with closing(made.open()) as table:
        path = write_report(made.plan, table, tmp_path, "it", replays=replays)
        plain = write_report(made.plan, table, made.directory, "it")
    page = Page(path.read_text(encoding="utf-8"))
    linked = [given["href"] for tag, given in page.seen if tag == "a"]
    assert linked == [replays[0].page]
    assert (path.parent / linked[0]).is_file()
    (first, second) = [text for text in page.words["li"] if "the " in text and "seed" in text][:2]
    level = made.plan.axes[0].levels[made.plan.cells[runs[0].cell][0]]
    assert first.startswith(f"packet loss {level * 100:g} %, seed {runs[0].seed}: the median run")
    assert second.endswith("; no <reason>")
    assert "Runs to look at" in page.words["h2"]
    assert "Runs to look at" not in Page(plain.read_text(encoding="utf-8")).words["h2"]


def test_the_command_writes_them_and_none_if_none_are_asked_for(made, tmp_path):
    source = tmp_path / "small.toml"
    source.write_text(
        'scenario = "sim1"\nseeds = 1\nmeasures = ["captured"]\n[set]\nticks_max = 5\n'
    )
    ask = Request(str(source), tmp_path / "t", None, "memory", 1, None, ())
    answer = run_study(ask)
    assert answer["replays"] == [str(tmp_path / "t" / "replays" / "cell-0-seed-1.html")]
    page = Page((tmp_path / "t" / "report.html").read_text(encoding="utf-8"))
    (text,) = [text for text in page.words["li"] if text.startswith("seed 1: ")]
    assert text == (
        "seed 1: the median run and the worst run and the first without a capture,"
        " not captured within 0.5 s"
    )
    none = Request(str(source), tmp_path / "t", None, "memory", 1, None, (), "none")
    assert run_study(none)["replays"] == []


@pytest.mark.parametrize("which", ["few", "all"])
def test_without_the_viewer_few_are_left_out_and_all_are_refused_at_once(tmp_path, which):
    source = tmp_path / "small.toml"
    source.write_text(
        'scenario = "sim1"\nseeds = 1\nmeasures = ["captured"]\n[set]\nticks_max = 5\n'
    )
    words = ["study", str(source), "--out", "t", "--workers", "1", "--replays", which]
    script = (
        "import sys; sys.modules['bokeh'] = None; from encircle.cli.main import main\n"
        f"if __name__ == '__main__': sys.exit(main({words!r}))"
    )
    done = completed([sys.executable, "-c", script], cwd=tmp_path)
    line = 'encircle: a replay in the report needs bokeh: pip install "encircle[viewer]"'
    if which == "all":
        assert (done.returncode, done.stderr) == (2, f"{line}\n")
        assert not (tmp_path / "t").exists()
    else:
        assert done.returncode == 0
        assert f"{line}; the report has no links to replays\n" in done.stderr
        assert (tmp_path / "t" / "report.html").exists()
        assert not (tmp_path / "t" / "replays").exists()
