"""Hunts in memory through the Python API: repeatable, recorded, and refused when they must be."""

import json

import pytest

from encircle.runner.hunts import default_directory, run
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.loading.files import shipped
from encircle.world.loading.load import load
from encircle.world.recording.recording import read_recording
from encircle.world.recording.run_directory import RunDirectoryError
from encircle.world.scenario.errors import ScenarioError

HARD = [
    "channel.loss={model='gilbert-elliott', good_to_bad=0.1, bad_to_good=0.3}",
    "channel.delay={model='lognormal', mean_s=0.3, std_s=0.2}",
    "sensing.noise_m_std=0.1",
    "ticks_max=60",
]


def in_memory(scenario, **options):
    return run(scenario, link="memory", **options)


def test_it_is_the_api_of_the_package():
    import encircle

    assert encircle.run is run
    assert encircle.run("sim1", link="memory").captured


@pytest.mark.parametrize("scenario", ["sim1", "sim2", "sim4"])
def test_the_same_seed_is_the_same_run_and_another_is_another(scenario):
    first, again, other = (in_memory(scenario, seed=s, overrides=HARD) for s in (7, 7, 8))
    assert first.result == again.result
    assert first.run != again.run
    assert other.digest != first.digest


def test_recording_or_watching_a_run_does_not_change_it(tmp_path):
    plain = in_memory("sim1", overrides=HARD)
    assert in_memory("sim1", overrides=HARD, out=tmp_path).result == plain.result
    assert in_memory("sim1", overrides=HARD, progress=lambda _: None).result == plain.result


def test_a_scenario_by_name_path_mapping_or_loaded_is_the_same_run(tmp_path):
    plain = in_memory("sim2")
    path = tmp_path / "mine.toml"
    path.write_bytes(shipped()["sim2"].read_bytes())
    tree = load("sim2").model_dump(mode="json", exclude_unset=True)
    for source in (path, str(path), tree, load("sim2")):
        assert in_memory(source).result == plain.result
    assert in_memory(load("sim2"), seed=5).result == in_memory("sim2", seed=5).result


def test_seed_and_overrides_are_those_of_the_hunt():
    hunt = in_memory("sim1", seed=9, overrides=["target.step_m_max=0.15", "ticks_max=5"])
    assert hunt.seed == hunt.scenario.seed == 9
    assert hunt.scenario.target.step_m_max == 0.15
    assert (hunt.result.ticks, hunt.result.ended, hunt.captured) == (5, "ticks", False)
    assert hunt.capture_tick is None
    assert in_memory("sim1", overrides=["seed=9"]).result == in_memory("sim1", seed=9).result


def test_a_capture_is_reported_with_its_tick_and_close_robots():
    hunt = in_memory("sim1")
    assert hunt.captured
    assert hunt.capture_tick == hunt.result.ticks > 0
    assert hunt.result.ended == "captured"
    assert all(distance <= 1.3 for distance in hunt.result.distances_m)
    assert hunt.result.packets_sent == 12 * hunt.result.ticks
    assert hunt.result.refused == {}


def test_the_out_directory_holds_recording_and_summary_of_the_very_run(tmp_path):
    out = tmp_path / "new" / "run"
    hunt = in_memory("sim1", seed=3, out=out)
    assert hunt.out == out
    assert sorted(p.name for p in out.iterdir()) == ["recording.mcap", "summary.json"]
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["digest"], summary["seed"], summary["run"]) == (hunt.digest, 3, hunt.run)
    assert summary["captured"] is hunt.captured
    recording = read_recording(out)
    assert recording.complete
    assert (recording.run, recording.seed) == (hunt.run, 3)
    # What it takes to run it again is in the recording.
    assert in_memory(recording.scenario, seed=recording.seed).digest == hunt.digest


def test_without_out_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert in_memory("sim1", overrides=["ticks_max=3"]).out is None
    assert list(tmp_path.iterdir()) == []


def test_a_directory_that_is_not_empty_is_refused_and_unchanged(tmp_path):
    (tmp_path / "notes.txt").write_text("precious")
    with pytest.raises(RunDirectoryError, match="not empty"):
        in_memory("sim1", out=tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]
    assert (tmp_path / "notes.txt").read_text() == "precious"
    in_memory("sim1", out=tmp_path / "run")
    before = {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir()}
    with pytest.raises(RunDirectoryError, match="not empty"):
        in_memory("sim1", seed=2, out=tmp_path / "run")
    assert {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir()} == before


@pytest.mark.parametrize("link", ["", "tcp", "Memory"])
def test_an_unknown_link_is_refused_with_the_known_ones(tmp_path, link):
    with pytest.raises(ValueError, match="zenoh, memory") as caught:
        run("sim1", link=link, out=tmp_path / "run")
    assert repr(link) in str(caught.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("scenario", "changes", "said"),
    [
        ("sim9", [], "sim1"),
        ("sim1", ["team.robots=9"], "team.robots = 9"),
        ("sim1", ["seed=-1"], "seed = -1"),
        ("sim1", ["nonsense"], "key=value"),
    ],
)
def test_a_bad_scenario_is_refused_before_a_directory_is_made(tmp_path, scenario, changes, said):
    with pytest.raises(ScenarioError, match=said):
        in_memory(scenario, overrides=changes, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_team_for_which_there_is_no_room_is_refused():
    crowd = {"team": {"robots": 60, "placement": {"distance_m_min": 2.0, "distance_m_max": 2.5}}}
    with pytest.raises(ScenarioError, match="no room"):
        in_memory(crowd)


def test_what_json_prints_holds_what_the_design_promises():
    hunt = in_memory("sim1", seed=4)
    shown = json.loads(json.dumps(hunt.as_dict("sim1")))
    promised = ("scenario", "seed", "link", "robots", "processes", "captured", "capture_tick")
    promised += ("ticks", "digest", "wall_s", "out")
    assert set(promised) <= set(shown)
    assert (shown["scenario"], shown["seed"], shown["link"]) == ("sim1", 4, "memory")
    assert (shown["robots"], shown["processes"], shown["out"]) == (4, 1, None)
    assert (shown["digest"], shown["ticks"]) == (hunt.digest, hunt.result.ticks)


def test_progress_is_told_in_ticks_and_distances():
    told = []
    in_memory("sim3", overrides=[*HARD, "ticks_max=200"], progress=told.append)
    reports = [report for report in told if "tick" in report]
    assert [r["tick"] for r in reports] == sorted({r["tick"] for r in reports})
    assert all(len(r["distances_m"]) == 4 for r in reports)


def test_the_default_directory_is_a_new_one_named_after_scenario_and_seed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first = default_directory("sim1", 3)
    assert str(first) == "runs/sim1-seed3-1"
    first.mkdir(parents=True)
    assert str(default_directory("sim1", 3)) == "runs/sim1-seed3-2"
    assert str(default_directory("some/where/mine.toml", 1)) == "runs/mine-seed1-1"


def test_progress_is_told_while_all_robots_are_away():
    """So that a hunt in memory keeps its pace, takes interventions and can be stopped then."""
    away = [{"kind": "crash", "robot": f"r{k}", "tick": 3, "ticks": 20} for k in range(1, 5)]
    scenario = load("sim1").model_dump(mode="json", exclude_unset=True)
    arena = build(load(scenario | {"events": away, "ticks_max": 25}), 1)
    ticks = []
    run_in_memory(arena, "away-0123456789ab", print, progress=lambda w: ticks.append(w.state.tick))
    assert ticks == list(range(25))
