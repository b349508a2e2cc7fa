"""One digest whichever way a run goes: on scenarios drawn at random, with every kind of everything.

In memory, over bytes in another order of answers with strangers about, over Zenoh with processes,
by the program of docs/protocol.md from the recording alone, and taken up where it broke off; fresh
brains decide the same on the recording. A failure names its seed and the line that plays it again;
ENCIRCLE_DIGEST_SEED takes one seed in place of the usual ones.
"""

import os
import random
import re
import runpy
import sys
from pathlib import Path

import pytest
from helpers_paths import DOCS
from helpers_scenarios import scenario_of
from helpers_swarm import play, swarm_scenario

from encircle.replay.replaying import replay
from encircle.runner import hunts
from encircle.runner.launch import run_processes
from encircle.studies import session
from encircle.world.arena.engine import build
from encircle.world.scenario.model import Scenario

PAGE = (DOCS / "protocol.md").read_text(encoding="utf-8")
PROGRAM = re.search(r"\n## The digest\n.*?```python\n(.*?)```", PAGE, re.DOTALL)[1]
REPLAY = (
    "replay: ENCIRCLE_DIGEST_SEED={} .venv/bin/python -m pytest -n 0 tests/world/test_digests.py"
)
ONE = os.environ.get("ENCIRCLE_DIGEST_SEED")

SEEDS = range(12) if ONE is None else (int(ONE),)
BY_PROCESSES = (2, 5) if ONE is None else (int(ONE),)
NIGHTLY = [range(first, first + 50) for first in range(1_000, 2_000, 50)]
NIGHTLY_BY_SESSION = [range(first, first + 50) for first in range(1_000, 1_400, 50)]
NIGHTLY_BY_PROCESSES = range(1_000, 1_030)


def script(recording: Path, monkeypatch, capsys) -> str:
    """What the page's program prints for a recording."""
    program = recording.with_name("digest.py")
    program.write_text(PROGRAM, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", [str(program), str(recording)])
    capsys.readouterr()
    runpy.run_path(str(program), run_name="__main__")
    return capsys.readouterr().out.strip()


def broken_off(seed: int, recording: Path, into: Path) -> Path:
    """The directory of a run whose world was killed at some time."""
    into.mkdir()
    whole = recording.read_bytes()
    share = random.Random(f"broken off {seed}").uniform(0.2, 0.95)
    (into / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
    return into


def compare(seed: int, folder: Path, monkeypatch, capsys) -> None:
    """All ways that need one process."""
    out = folder / str(seed)
    hunt = hunts.run(swarm_scenario(seed), link="memory", out=out)
    recording = out / "recording.mcap"
    found = {
        "over bytes": play(seed, faults=False, order=1).digest,
        "by the page's program": script(recording, monkeypatch, capsys),
        "taken up": hunts.resume(broken_off(seed, recording, out / "cut"), link="memory").digest,
    }
    assert found == dict.fromkeys(found, hunt.digest)
    assert replay(recording).same


def over_zenoh(seed: int, folder: Path, monkeypatch, capsys) -> None:
    """A world and its robots as processes of their own."""
    scenario, out = scenario_of(seed), folder / f"zenoh-{seed}"
    digest = by_processes(scenario, out)
    assert digest == hunts.run(scenario, link="memory").digest
    assert script(out / "recording.mcap", monkeypatch, capsys) == digest
    assert replay(out).same


def by_processes(scenario: Scenario, out: Path) -> str:
    """The digest of a run over Zenoh."""
    path = out.with_suffix(".json")
    path.write_text(scenario.model_dump_json(exclude_unset=True), encoding="utf-8")
    arguments = [str(path), "--out", str(out)]
    return run_processes(arguments, scenario.ids, "drawn", lambda _report: None)[0].digest


def noted(check, seeds, *arguments) -> None:
    """Check seed by seed; a failure names its seed."""
    for seed in seeds:
        try:
            check(seed, *arguments)
        except BaseException as error:
            error.add_note(REPLAY.format(seed))
            raise


def test_all_ways_of_a_drawn_run_have_one_digest(tmp_path, monkeypatch, capsys):
    noted(compare, SEEDS, tmp_path, monkeypatch, capsys)


def test_a_drawn_run_over_processes_has_the_digest_of_the_one_in_memory(
    tmp_path, monkeypatch, capsys
):
    noted(over_zenoh, BY_PROCESSES, tmp_path, monkeypatch, capsys)


def test_what_robots_refuse_is_not_in_the_digest_whichever_way_a_run_goes(
    tmp_path, monkeypatch, capsys
):
    late = ["channel.delay={model='exponential', mean_s=2.0}", "target.step_m_max=0.3"]
    hunt = hunts.run("sim1", link="memory", overrides=late, out=tmp_path / "memory")
    assert by_processes(hunt.scenario, tmp_path / "zenoh") == hunt.digest
    for way in ("memory", "zenoh"):
        recording = tmp_path / way / "recording.mcap"
        assert b"late-detection" in recording.read_bytes()
        assert script(recording, monkeypatch, capsys) == hunt.digest


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("seeds", NIGHTLY, ids=lambda seeds: f"{seeds[0]}-{seeds[-1]}")
def test_all_ways_of_many_drawn_runs_have_one_digest(seeds, tmp_path, monkeypatch, capsys):
    noted(compare, seeds, tmp_path, monkeypatch, capsys)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("seeds", NIGHTLY_BY_SESSION, ids=lambda seeds: f"{seeds[0]}-{seeds[-1]}")
def test_many_drawn_runs_through_kept_processes_have_one_digest(seeds, monkeypatch):
    with session.Session([f"r{k + 1}" for k in range(8)]) as robots:
        noted(through, seeds, robots)


def through(seed: int, robots: session.Session) -> None:
    scenario = scenario_of(seed)
    _, digest = robots.hunt(build(scenario, scenario.seed))
    assert digest == hunts.run(scenario, link="memory").digest


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_many_drawn_runs_over_processes_have_one_digest(tmp_path, monkeypatch, capsys):
    noted(over_zenoh, NIGHTLY_BY_PROCESSES, tmp_path, monkeypatch, capsys)
