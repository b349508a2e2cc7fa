"""The command line as a person or a script meets it: output, exit status, errors in one line."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers_commands import command as run_command
from helpers_waiting import completed

import encircle
from encircle.cli.main import COMMANDS, main
from encircle.runlog.ground_truth import ground_truth_of
from encircle.world.recording.recording import read_recording

REQUIRED = {
    "scenario",
    "seed",
    "link",
    "robots",
    "processes",
    "captured",
    "capture_tick",
    "ticks",
    "digest",
    "wall_s",
    "out",
}


def command(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return run_command(*arguments, folder=folder)


def test_run_prints_one_json_object_and_nothing_else_on_standard_output(tmp_path):
    done = command(tmp_path, "run", "sim1", "--json", "--out", "here")
    assert done.returncode == 0
    answer = json.loads(done.stdout)
    assert set(answer) >= REQUIRED
    assert (answer["link"], answer["robots"], answer["processes"]) == ("zenoh", 4, 5)
    assert answer["digest"] == encircle.run("sim1", link="memory").digest
    written = sorted(p.name for p in (tmp_path / "here").iterdir())
    assert written == ["recording.mcap", "summary.json", "trajectory.png"]


def test_run_ends_in_a_table_with_the_paths(tmp_path):
    done = command(tmp_path, "run", "sim1", "--link", "memory", "--seed", "5")
    assert done.returncode == 0
    for said in ("captured", "at tick", "packets sent", "runs/sim1-seed5-1/recording.mcap"):
        assert said in done.stdout
    assert (tmp_path / "runs/sim1-seed5-1/trajectory.png").stat().st_size > 10_000


def test_a_second_run_gets_a_directory_of_its_own(tmp_path):
    for _ in range(2):
        command(tmp_path, "run", "sim1", "--link", "memory", "--set", "ticks_max=3")
    assert len(list((tmp_path / "runs").iterdir())) == 2


def test_scenarios_lists_those_of_the_paper(tmp_path):
    done = command(tmp_path, "scenarios")
    assert [line.split()[0] for line in done.stdout.splitlines()] == [
        f"sim{k}" for k in range(1, 6)
    ]
    assert set(json.loads(command(tmp_path, "scenarios", "--json").stdout)) == set(
        encircle.shipped()
    )


def test_replay_check_passes_on_an_honest_recording(tmp_path):
    encircle.run("sim2", link="memory", out=tmp_path / "run")
    done = command(tmp_path, "replay", "run", "--check", "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["same"] is True


def test_replay_tells_the_digest_that_a_fresh_world_comes_to(tmp_path):
    interventions = encircle.Interventions()
    interventions.give({"kind": "loss", "rate": 0.6, "tick": 10})
    hunt = encircle.run("sim2", link="memory", out=tmp_path / "run", interventions=interventions)
    done = command(tmp_path, "replay", "run", "--digest", "--json")
    assert json.loads(done.stdout) == {
        "run": hunt.run,
        "digest": hunt.digest,
        "recorded": hunt.digest,
        "interventions": 1,
    }
    line = command(tmp_path, "replay", "run", "--digest").stdout
    assert line == f"digest {hunt.digest}, 1 intervention; as in its summary\n"
    summary = tmp_path / "run" / "summary.json"
    summary.write_text(summary.read_text().replace(hunt.digest, "0" * 32))
    done = command(tmp_path, "replay", "run", "--digest")
    assert (done.returncode, "its summary has 000" in done.stdout) == (1, True)
    summary.unlink()
    done = command(tmp_path, "replay", "run", "--digest")
    assert (done.returncode, "no summary to compare" in done.stdout) == (0, True)


def test_replay_tells_of_each_robot(tmp_path):
    hunt = encircle.run("sim2", link="memory", out=tmp_path / "run")
    told = json.loads(command(tmp_path, "replay", "run", "--robots", "--json").stdout)
    assert [robot["robot"] for robot in told["robots"]] == list(hunt.scenario.ids)
    ways_m = [robot["path_m"] for robot in told["robots"]]
    places = ground_truth_of(read_recording(tmp_path / "run")).robots
    assert ways_m == pytest.approx(np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0))
    table = command(tmp_path, "replay", "run", "--robots").stdout.splitlines()
    assert table[0].split() == list(hunt.scenario.ids)
    assert ["path_m", "m", *(f"{way_m:.4g}" for way_m in ways_m)] in [row.split() for row in table]


@pytest.mark.parametrize(
    "options",
    [(), ("--check",), ("--json",), ("--check", "--json"), ("--robots",), ("--digest",)],
)
def test_replay_says_of_a_recording_that_is_cut_off_that_it_is(tmp_path, options):
    encircle.run("sim1", link="memory", out=tmp_path / "run")
    whole = command(tmp_path, "replay", "run", *options)
    assert whole.stderr == ""
    path = tmp_path / "run" / "recording.mcap"
    path.write_bytes(path.read_bytes()[:-5000])
    done = command(tmp_path, "replay", "run", *options)
    assert done.returncode == 0
    assert "recording.mcap is cut off or damaged: it can be read up to tick" in done.stderr
    assert done.stdout.count("\n") == whole.stdout.count("\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "nowhere"], "neither a file nor one of"),
        (["run", "sim1", "--link", "pigeon"], "pigeon"),
        (["run", "sim1", "--set", "target.speed=3"], "target.speed = 3: unknown key"),
        (["run", "sim1", "--set", "team.strategy=guess"], "unknown policy"),
        (["run", "sim1", "--set", "nonsense"], "must be key=value"),
        (["run", "sim11"], "(did you mean 'sim1'?)"),
        (["run", "loss-delay"], "'loss-delay' is a study: encircle study loss-delay"),
        (["run", "study.toml"], "has scenario, so it is a study: encircle study study.toml"),
        (
            ["study", "sim2"],
            "'sim2' is a scenario, which has no axes: to run it once, encircle run",
        ),
        (["study", "mine.toml"], "'mine.toml' is a scenario, which has no axes"),
        (["study", "los"], "(did you mean 'loss'?)"),
        (["run", "sim1", "--out", "full"], "full is not empty"),
        (["replay", "absent"], "absent cannot be read"),
        (["world", "sim1", "--listen", "tcp/127.0.0.1:1", "--run", "a/b"], "not a valid name"),
        (["world", "sim1", "--listen", "here", "--run", "a"], "'here': must be PROTOCOL/HOST:PORT"),
        (["world", "sim1", "--run", "a"], "neither an endpoint to listen on"),
        (
            ["world", "sim11", "--listen", "tcp/127.0.0.1:1", "--run", "a"],
            "world: scenario 'sim11' is neither a file nor one of",
        ),
        (["world", "sim1", "--listen", "tcp/0.0.0.0:1", "--run", "a"], "--without-authentication"),
        (["world", "sim1", "--out", "a", "--runs", "b", "--run", "a"], "give one of them"),
        (
            ["world", "sim1", "--listen", "tcp/127.0.0.1:1", "--run", "a", "--control"],
            "--control: goes with --parent",
        ),
        (["robot", "r1", "--connect", "tcp/127.0.0.1:1"], "--run is missing"),
        (["robot", "--run", "a", "--connect", "tcp/127.0.0.1:1"], "set ENCIRCLE_ROBOT"),
        (["router"], "neither an endpoint to listen on"),
        (["alive", "weather"], "'weather' is not one of router, world, robot"),
        (["fly"], "no such command: fly"),
        (["stdy"], "no such command: stdy (did you mean 'study'?)"),
        (["--version"], "no such option: --version"),
        ([], "usage: encircle"),
        (["run", "sim1", "--sed", "3"], "--sed 3 (did you mean '--seed'?)"),
        (["run", "sim1", "sim2"], "unrecognized arguments: sim2"),
        (["run", "sim1", "--seed", "x"], "argument --seed: 'x' is not a whole number"),
        (["run", "sim1", "--set", "a={b=c,", "d=2}"], 'put all of it in quotes: --set "KEY=VALUE"'),
        (
            ["run", "sim1", "--set", "channel.loss={model=bernoulli, rate=0.6}"],
            """(did you mean "channel.loss={model='bernoulli', rate=0.6}"?""",
        ),
        (["replay"], "RUN is missing (a recorded run's directory or recording): give it"),
        (["replay", "a", "--check", "--robots"], "--check and --robots: give one of them"),
        (["replay", "a", "--robots", "--digest"], "--robots and --digest: give one of them"),
        (["trace", "absent"], "--out is missing: give it"),
        (["certificates", "new"], "--robots is missing: give it"),
        (["study", "loss", "--seeds", "0"], "'0' is not a whole number of at least 1"),
        (["study", "loss", "--workers", "1025"], "'1025' is not a whole number from 1 to 1024"),
        (["study", "loss", "--cluster", "tcp://h:1", "--workers", "2"], "goes neither with"),
        (["reproduce", "--seeds", "1"], "'1' is not a whole number of at least 2"),
    ],
)
def test_bad_usage_is_status_2_and_names_the_thing(tmp_path, arguments, said):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "precious").write_text("keep me")
    (tmp_path / "study.toml").write_text('scenario = "sim1"\nseeds = 3\n')
    (tmp_path / "mine.toml").write_text("[team]\nrobots = 3\n")
    done = command(tmp_path, *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert (tmp_path / "full" / "precious").read_text() == "keep me"


@pytest.mark.parametrize("name", ["robot", "world", "router", "alive", "doctor"])
def test_commands_that_are_programs_of_their_own_explain_themselves(tmp_path, name):
    done = command(tmp_path, name, "--help")
    assert done.returncode == 0
    assert done.stdout.startswith(f"usage: encircle {name} ")
    assert "[ENCIRCLE_CONNECT]" in done.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself_and_is_listed(capsys, name):
    assert main([name, "--help"]) == 0
    own = capsys.readouterr().out
    assert own.startswith(f"usage: encircle {name} ")
    assert main(["--help"]) == 0
    assert f"  {name} " in capsys.readouterr().out


def test_settings_for_single_parties_do_not_reach_a_run_of_all(tmp_path, monkeypatch):
    """As in a container, where the environment says where a robot is to connect."""
    expected = encircle.run("sim1", link="memory").digest
    monkeypatch.setenv("ENCIRCLE_CONNECT", "tcp/127.0.0.1:1")
    monkeypatch.setenv("ENCIRCLE_SET", "target.step_m_max=0.1")
    done = command(tmp_path, "run", "sim1", "--json")
    assert json.loads(done.stdout)["digest"] == expected


def test_all_errors_of_a_scenario_are_shown_at_once(tmp_path):
    (tmp_path / "bad.toml").write_text(
        'ticks_max = 0\nspeed = 2\n[team]\nrobots = -1\n[channel.loss]\nrate = "much"\n'
    )
    said = command(tmp_path, "run", "bad.toml").stderr
    for key in ("ticks_max = 0", "speed = 2", "team.robots = -1", "channel.loss.rate = 'much'"):
        assert key in said


def test_the_program_starts_without_the_plotting_library():
    modules = "encircle.cli.main, encircle.runner.hunts, encircle.runner.launch"
    code = f"import sys, {modules}; print(*sys.modules)"
    done = completed([sys.executable, "-c", code])
    assert done.returncode == 0, done.stderr
    assert not {"matplotlib", "scipy", "encircle.agents.brain.brain"} & set(done.stdout.split())


def test_a_robot_imports_only_what_a_robot_uses():
    code = (
        "import sys\n"
        "from encircle.protocol.process.deferred_imports import UNUSED, lazy\n"
        "with lazy(*UNUSED):\n"
        "    import encircle.agents.process.robot\n"
        "print(*(m for m, x in sys.modules.items() if type(x).__name__ != '_LazyModule'))"
    )
    done = completed([sys.executable, "-c", code])
    loaded = set(done.stdout.split())
    assert "filterpy.kalman.kalman_filter" in loaded
    unwanted = {"encircle.world", "encircle.cli", "matplotlib", "pydantic", "mcap", "rich"}
    assert not (unwanted | {"numpy.f2py", "numpy.ma", "scipy.stats", "scipy.ndimage"}) & loaded
    assert "scipy.spatial.transform" not in loaded


def test_what_was_postponed_works_when_it_is_used():
    code = (
        "from encircle.protocol.process.deferred_imports import UNUSED, deferred, lazy\n"
        "with lazy(*UNUSED), deferred('scipy.stats', 'scipy.ndimage'):\n"
        "    import filterpy.stats\n"
        "import numpy, scipy.spatial, scipy.stats\n"
        "print(filterpy.stats.logpdf(1.0, 0.0, 1.0) == scipy.stats.norm.logpdf(1.0))\n"
        "print(numpy.f2py.__name__, numpy.ma.masked_invalid([1.0]).sum())\n"
        "print(scipy.spatial.transform.Rotation.identity().magnitude())"
    )
    done = completed([sys.executable, "-c", code])
    assert done.stdout.split() == ["True", "numpy.f2py", "1.0", "0.0"], done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "give a scenario, or --resume RUN"),
        (("sim1", "--when-lost", "panic"), "'panic' is not one of go-on, end"),
        (("sim1", "--resume", "here"), "goes with neither a scenario nor --seed, --set or --out"),
        (("--resume", "here", "--seed", "3"), "goes with neither a scenario nor"),
        (("--resume", "nowhere"), "nowhere"),
    ],
)
def test_a_run_that_cannot_be_meant_is_refused_with_a_line(tmp_path, arguments, said):
    done = command(tmp_path, "run", *arguments)
    assert done.returncode == 2
    assert said in " ".join(done.stderr.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_complete_is_not_resumed_nor_under_another_name(tmp_path):
    encircle.run("sim2", link="memory", out=tmp_path / "run")
    done = command(tmp_path, "run", "--resume", "run")
    assert done.returncode == 2
    [line] = [line for line in done.stderr.splitlines() if line.startswith("encircle:")]
    assert "this run has come to its end" in line
    other = command(tmp_path, "world", "--resume", "run", "--run", "b", "--listen", "tcp/[::1]:0")
    assert other.returncode == 2
    assert "--run b: the run in run is run-" in other.stderr
