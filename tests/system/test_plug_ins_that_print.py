"""What plug-ins print never stands among what a command prints, which programs read."""

import json

import pytest
from helpers_commands import ours
from helpers_waiting import completed

import encircle

LOUD = """
from encircle.agents.policies.paper import pursue

print("imported")


def policy(memory, view):
    print("asked")
    return pursue(memory, view)


def target(memory, view):
    print("asked")
    return None, (0.0, 0.0)
"""
OVERRIDES = ["team.strategy=loud.py:policy", "target.behaviour=loud.py:target", "ticks_max=5"]
STUDY = f"""
name = "loud"
scenario = "sim1"
seeds = 2
measures = ["captured"]
set = {{ "team.strategy" = "{OVERRIDES[0].partition("=")[2]}", ticks_max = 5 }}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "loud.py").write_text(LOUD)
    (tmp_path / "loud.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "command",
    [
        "run sim1 --link memory --out out",
        "run sim1 --link zenoh --out out",
        "study loud.toml --workers 2 --out out",
        "study loud.toml --link zenoh --out out",
    ],
)
def test_while_hunts_are_run(folder, command):
    words = command.split()
    changes = [word for change in OVERRIDES for word in ("--set", change)] * (words[0] == "run")
    done = completed([*ours("encircle", *words), "--json", *changes])
    assert json.loads(done.stdout), done.stderr
    assert "imported" in done.stderr


@pytest.mark.parametrize(
    "command",
    [
        "replay {}",
        "replay {} --check",
        "replay {} --digest",
        "replay {} --robots",
        "export {} --to html --out out.html",
    ],
)
def test_while_a_recording_is_read(folder, command, capsys):
    encircle.run("sim1", link="memory", overrides=OVERRIDES, out="made")
    capsys.readouterr()
    done = completed([*ours("encircle", *command.format("made").split()), "--json"])
    assert json.loads(done.stdout), done.stderr
    assert "imported" in done.stderr
