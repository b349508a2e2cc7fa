"""What docs/protocol.md says of the wire, against the code: bytes, digest, limits and the robot.

The page's own programs are taken out of it and run, so they cannot fall behind.
"""

import cmath
import gzip
import json
import random
import re
import runpy
import subprocess
import sys
from contextlib import ExitStack
from itertools import permutations
from math import pi

import msgpack
import numpy as np
import pytest
from helpers_agents import view_of
from helpers_commands import ours, started_unheard
from helpers_hosts import NodeProcess, wait_for_robots
from helpers_paths import DOCS, TESTS
from helpers_protocol_page import PAGE, program, section
from helpers_waiting import communicated, ended, until
from helpers_world import RUN, answers, arena, begun

import encircle
from encircle.agents.policies.registry import policy_named
from encircle.protocol import VERSION
from encircle.protocol.codec import BYTES_MAX
from encircle.protocol.keys import world_key
from encircle.protocol.lockstep import TABLE, Move, Phase
from encircle.protocol.parameters import Parameters
from encircle.protocol.plugins import SHIPPED_POLICIES
from encircle.protocol.zenoh.access_control import RETRY, configuration_file
from encircle.protocol.zenoh.configuration import configuration
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.lanes import GATE_SETTINGS, QUEUE_SETTINGS, ROUND, SURE, VIEWERS
from encircle.protocol.zenoh.session import open_session
from encircle.runner.launch import free_endpoint
from encircle.world.arena.capture import is_captured
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.recording.recorder import Recorder
from encircle.world.scenario.model import digest_header

SECURITY = (DOCS / "security.md").read_text(encoding="utf-8")
HEX_COLUMNS = 47


def test_the_page_is_of_this_version_and_its_limits_are_the_codecs():
    assert f"It describes version {VERSION}," in PAGE
    rows = re.findall(r"^\| (\w+) \| ([\d,]+) \|$", section("Messages"), re.MULTILINE)
    limits = {kind: int(size.replace(",", "")) for kind, size in rows}
    assert limits == {kind.__name__: size for kind, size in BYTES_MAX.items()}


@pytest.mark.parametrize("kind", BYTES_MAX, ids=lambda kind: kind.__name__)
def test_every_field_has_its_row_in_the_order_of_the_wire(kind):
    text = re.search(rf"\n### {kind.__name__}\n(.*?)(\n### |\Z)", section("Messages"), re.DOTALL)[1]
    rows = re.findall(r"^\| (`.*?) \|", text, re.MULTILINE)
    named = [name.strip("`") for row in rows for name in row.split(", ")]
    assert named == list(kind.__slots__)


def test_the_table_of_a_round_is_the_codes():
    header, _, *rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in section("A round").split("\n### ")[0].splitlines()
        if line.startswith("|")
    ]
    printed = {
        (Phase(row[0]), Move(move)): Phase(after)
        for row in rows
        for move, after in zip(header[1:], row[1:], strict=True)
        if after
    }
    assert printed == TABLE


def test_the_rules_on_lanes_are_those_of_the_code():
    printed = json.loads(re.search(r"```json\n(.*?)```", section("Session"), re.DOTALL)[1])
    assert printed == json.loads(configuration_file(QUEUE_SETTINGS | GATE_SETTINGS))
    rows = re.findall(r"^\| (\w+) \|[^|]*\| `(\w+)` \|", section("Session"), re.MULTILINE)
    assert rows == [("round", ROUND), ("sure", SURE), ("shown", VIEWERS)]


def test_the_round_in_bytes_is_what_its_program_prints(capsys):
    exec(program("A round in bytes"), {})
    sent = {line.split(" ", 2)[2] for line in capsys.readouterr().out.splitlines()}
    text = section("A round in bytes")
    blocks = re.findall(r"```\n(.*?)```", text, re.DOTALL)
    printed = [" ".join(line[:HEX_COLUMNS].strip() for line in b.splitlines()) for b in blocks]
    assert len(printed) == 8
    for line in printed:
        assert line in sent
        assert len(bytes.fromhex(line)) in map(int, re.findall(r"(\d+) bytes", text))


@pytest.mark.parametrize(
    "changes",
    [
        [],
        ['channel.loss={model="bernoulli",rate=0.3}', "robot.detections=relay"],
        ["robot.publish=event", "robot.detections=relay", "seed=7", "title=Another"],
        ["robot.publish_every_ticks=3", "ticks_max=20", "sensing.noise_m_std=0.05"],
        ["robot.publish_every_ticks=2", "channel.duplication.rate=0.5"],
        ["robot.detections=fuse", 'channel.loss={model="bernoulli",rate=0.3}'],
        ["team.strategy=auction", "channel.duplication.rate=0.5"],
        ["team.strategy=intents", "robot.detections=fuse"],
    ],
    ids=["plain", "relayed", "event", "third", "copied", "fused", "speaking", "all"],
)
def test_the_digest_of_a_recording_is_the_one_its_program_prints(
    changes, tmp_path, monkeypatch, capsys
):
    hunt = encircle.run("sim1", link="memory", out=tmp_path / "run", overrides=changes)
    recording = tmp_path / "run" / "recording.mcap"
    assert digest_by_the_page(recording, monkeypatch, capsys) == hunt.digest


def test_the_digest_of_a_run_that_was_changed_is_the_one_its_program_prints(
    tmp_path, monkeypatch, capsys
):
    interventions = encircle.Interventions()
    for rate in (0.2, 0.9, 0.5):
        interventions.give({"kind": "loss", "rate": rate})
    interventions.give({"kind": "crash", "robot": "r2", "tick": 9, "ticks": 6})
    path = tmp_path / "run"
    hunt = encircle.run("sim1", link="memory", out=path, interventions=interventions)
    assert len(hunt.result.interventions) == 4
    assert digest_by_the_page(path / "recording.mcap", monkeypatch, capsys) == hunt.digest


def digest_by_the_page(recording, monkeypatch, capsys):
    """What the program of the page prints for a recording."""
    script = recording.with_name("digest.py")
    script.write_text(program("The digest"))
    monkeypatch.setattr(sys, "argv", ["digest.py", str(recording)])
    runpy.run_path(str(script), run_name="__main__")
    return capsys.readouterr().out.strip()


def test_the_digest_of_a_recording_of_version_3_is_the_one_that_it_had(
    tmp_path, monkeypatch, capsys
):
    before = TESTS / "data" / "recorded_by_0_1_0" / "lossy"
    recording = tmp_path / "recording.mcap"
    recording.write_bytes(gzip.decompress((before / "recording.mcap.gz").read_bytes()))
    digest = json.loads((before / "summary.json").read_text())["digest"]
    assert digest_by_the_page(recording, monkeypatch, capsys) == digest


def test_the_digest_is_that_of_the_page_however_others_pack_what_they_say(
    tmp_path, monkeypatch, capsys
):
    messages, draws = [], random.Random(1)
    core = begun(WorldCore(arena("ticks_max=12"), RUN, record=lambda *m: messages.append(m)))
    while core.ended is None:
        for key, payload in answers(core):
            body = msgpack.unpackb(payload)
            if key.endswith("/pose"):
                body["say"] = draws.choice([{}, {"b": 1.5, "a": [1, b"x", {"z": None}]}])
            names = draws.choice([list(body), sorted(body), [*body][::-1]])
            single = draws.random() < 0.5
            core.receive(key, msgpack.packb({n: body[n] for n in names}, use_single_float=single))
    core.rounds.commit()
    assert core.rounds.refused == {}
    path, scenario = tmp_path / "recording.mcap", core.arena.scenario
    metadata = {"run": RUN, "digest_header": digest_header(scenario, core.arena.seed)}
    recorder = Recorder(path, scenario.tick_s, metadata)
    for message in messages:
        recorder.record(*message)
    recorder.close()
    digest = digest_by_the_page(path, monkeypatch, capsys)
    assert digest == core.rounds.result().digest


def test_the_whole_robot_of_the_page_takes_part_in_a_hunt(tmp_path):
    script = tmp_path / "my_robot.py"
    script.write_text(program("A whole robot"))
    endpoint = free_endpoint()
    world = subprocess.Popen(
        ours(
            *("world", "sim1", "--listen", endpoint, "--run", "demo"),
            *("--set", "ticks_max=40", "--json"),
        ),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    robots = [
        started_unheard(ours("agents", f"r{k}", "--connect", endpoint, "--run", "demo"))
        for k in (1, 2, 3)
    ]
    try:
        wait_for_robots(endpoint, "demo", 3)
        guest = [sys.executable, str(script), "r4", "demo", endpoint]
        robots.append(subprocess.Popen(guest, stdout=subprocess.DEVNULL))
        out, _ = communicated(world)
        statuses = [ended(robot) for robot in robots]
    finally:
        for process in (world, *robots):
            process.kill()
            process.wait()
    result = next(
        report["result"] for report in map(json.loads, out.splitlines()) if "result" in report
    )
    assert result["refused"] == {}
    assert result["ended"] in ("captured", "ticks")
    assert statuses == [0] * 4


def test_the_settings_of_robots_and_viewers_are_the_ones_used():
    config = configuration(Endpoints(connect=("tcp/127.0.0.1:1",)))
    plain, certified = (
        re.findall(r"^\| `connect/retry` \| `(\{.*?\})`", page, re.MULTILINE)
        for page in (PAGE, SECURITY)
    )
    assert [json.loads(text) for text in plain] == [json.loads(config.get_json("connect/retry"))]
    assert [json.loads(text) for text in certified] == [RETRY]


def test_the_viewer_of_the_page_sees_a_hunt_until_its_world_is_gone(tmp_path):
    script = tmp_path / "my_viewer.py"
    script.write_text(program("Looking on"))
    endpoint = free_endpoint()
    with ExitStack() as stack:

        def start(name, *command):
            node = NodeProcess([sys.executable, *command], tmp_path / name, {})
            stack.callback(node.kill)
            return node

        world = start(
            *(
                "world",
                "-m",
                "encircle.world",
                "sim1",
                "--listen",
                endpoint,
                "--run",
                "demo",
                "--json",
            )
        )
        world.wait_until(lambda node: any("listening" in report for report in node.reports()))
        viewer = start("viewer", str(script), "demo", endpoint)
        session = stack.enter_context(open_session(Endpoints(connect=(endpoint,))))
        shown = session.declare_publisher(world_key("demo", "state"))
        until(lambda: shown.matching_status, "the viewer")
        for k in range(1, 5):
            # By interpreters of their own: the viewer's subscription needs a moment to be known
            # everywhere, and forked robots begin the hunt in less than that.
            own = ("-P", "-m", "encircle.agents")
            start(f"r{k}", *own, f"r{k}", "--connect", endpoint, "--run", "demo")
        assert world.end() == 0
        assert viewer.end() == 0
        ticks = [int(line.split()[0]) for line in viewer.printed_text().splitlines()]
    assert ticks == sorted(set(ticks))
    assert 0 < len(ticks) <= world.result()["ticks"] + 1
    assert ticks[0] == 0


def test_the_strategies_of_the_page_are_the_ones_there_are():
    table = section("The hunt").split("| `strategy` |")[1].split("\n\n")[0]
    rows = re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
    assert [name.strip("`") for row in rows for name in row.split(", ")] == list(SHIPPED_POLICIES)


def test_a_capture_is_what_the_page_says():
    draws = np.random.default_rng(5)
    stop_m = 1.3
    for _ in range(4000):
        count = int(draws.integers(2, 7))
        places = draws.normal(0.0, 1.0, (count, 2))
        asked = int(draws.integers(1, 6))
        near = [complex(x, y) for x, y in places if abs(complex(x, y)) <= stop_m]
        bearings = sorted(cmath.phase(ray) for ray in near)
        after = [*bearings[1:], *(bearing + 2 * pi for bearing in bearings[:1])]
        gaps = [b - a for a, b in zip(bearings, after, strict=True)]
        said = len(near) >= max(3, asked) and max(gaps) < pi
        assert is_captured(places, stop_m, asked) == said


def test_ring_points_and_shrinking_are_what_the_page_says():
    draws = np.random.default_rng(6)
    known = Parameters()
    assert "at most 1.5 `ring_radius_m`" in " ".join(PAGE.split())
    modes = set()
    target, ahead = (0.0, 0.0), complex(0.5, -0.25)

    def predict(grid):
        return np.array([[ahead.real, ahead.imag]] * len(grid)), "as told"

    for _ in range(600):
        count = int(draws.integers(3, 7))
        turns = np.sort(draws.uniform(0.0, 2 * pi, count))
        away = draws.uniform(3.0, 6.2, count)
        team = [
            (float(x), float(y))
            for x, y in zip(away * np.cos(turns), away * np.sin(turns), strict=True)
        ]
        _, choice = policy_named("xi-3")(None, view_of(team, 1, target, predict, known))
        gaps = np.diff([*turns, turns[0] + 2 * pi])
        closes = away.max() <= 1.5 * known.ring_radius_m and gaps.max() <= 0.9 * pi
        assert choice.mode == ("shrink" if closes else "encircle")
        modes.add(choice.mode)
        if closes:
            assert choice.goal == target
            continue
        u = complex(*team[int(away.argmax())]) / away.max()
        points = [
            ahead + known.ring_radius_m * cmath.rect(1, 2 * pi * q / count) * u
            for q in range(count)
        ]
        assert complex(*choice.goal) == pytest.approx(points[choice.point], abs=1e-9)
        ways = [[abs(complex(*place) - point) for point in points] for place in team]
        shared = min(
            permutations(range(count)),
            key=lambda p: sum(w[q] for w, q in zip(ways, p, strict=True)),
        )
        assert choice.point == shared[1]
    assert modes == {"shrink", "encircle"}
