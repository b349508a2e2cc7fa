"""Several robots in one process: each a robot of its own, whatever becomes of the others."""

import signal
from collections import Counter

import pytest
from helpers_commands import ours
from helpers_hunt import LONG
from helpers_waiting import LONGEST_S, completed

import encircle
from encircle.protocol.keys import robot_key
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.node_info import decode_info
from encircle.protocol.zenoh.queries import query
from encircle.protocol.zenoh.session import open_session
from encircle.replay.replaying import replay
from encircle.runner.testimony import RunFailed
from encircle.world.recording.recording import read_recording

RADIO = [
    "seed=3",
    "channel.loss={model='bernoulli',rate=0.3}",
    "events=[{kind='crash',robot='r3',tick=8,ticks=6}]",
]


MIXED = [
    "ticks_max=40",
    "target.step_m_max=0.6",
    "team.strategy='auction'",
    "team.robots.r1={step_m_max=0.1, sensing_range_m=3.0}",
    "team.robots.r2.strategy='pursuit'",
    "team.robots.r3={strategy='intents', radio_range_m=8.0, loss_rate=0.3}",
    "channel.delay={model='gamma', mean_s=0.2, std_s=0.2}",
    "sensing={noise_m_std=0.05, localisation_noise_m_std=0.1}",
]


def recorded(directory):
    """All that was recorded, but for the name of the run."""
    recording = read_recording(directory)
    name = recording.run.encode()
    return Counter((t, key, payload.replace(name, b"")) for t, key, payload in recording.messages)


@pytest.mark.parametrize("sharing", [2, 3, 4])
@pytest.mark.parametrize("changes", [RADIO, MIXED], ids=["radio", "mixed"])
def test_a_hunt_is_the_same_however_many_robots_share_a_process(changes, sharing, tmp_path):
    alone = encircle.run("sim1", link="memory", overrides=changes, out=tmp_path / "alone")
    shared = encircle.run(
        "sim1", overrides=changes, robots_per_process=sharing, out=tmp_path / "shared"
    )
    assert shared.digest == alone.digest
    assert shared.result.refused == {}
    assert shared.processes == 1 + -(-4 // sharing)
    assert recorded(tmp_path / "shared") == recorded(tmp_path / "alone")


@pytest.mark.parametrize("share", [0.3, 0.8])
def test_robots_that_share_a_process_go_on_with_a_run_that_broke_off(share, tmp_path):
    alone = encircle.run("sim1", link="memory", overrides=MIXED, out=tmp_path / "alone")
    whole = (tmp_path / "alone" / "recording.mcap").read_bytes()
    (tmp_path / "cut").mkdir()
    (tmp_path / "cut" / "recording.mcap").write_bytes(whole[: int(share * len(whole))])
    assert encircle.resume(tmp_path / "cut", robots_per_process=2).digest == alone.digest
    assert replay(tmp_path / "cut").same


@pytest.mark.nightly
@pytest.mark.parametrize("together", [64, 128])
def test_256_robots_capture_as_in_memory(together):
    many = {
        "ticks_max": 300,
        "team": {
            "robots": 256,
            "radius_m": 0.1,
            "sensing_range_m": 500.0,
            "placement": {"distance_m_min": 5.0, "distance_m_max": 30.0},
        },
        "robot": {"assignment": "cyclic"},
        "capture": {"count": 12},
    }
    alone = encircle.run(many, link="memory")
    assert alone.result.captured
    assert encircle.run(many, robots_per_process=together).result == alone.result


def test_a_hunt_of_sixteen_in_one_process_is_that_in_memory():
    many = LONG | {"ticks_max": 30, "team": {"robots": 16, "sensing_range_m": 500.0}}
    alone = encircle.run(many, link="memory")
    shared = encircle.run(many, robots_per_process=16)
    assert (shared.digest, shared.processes) == (alone.digest, 2)


def test_a_run_by_the_clock_goes_on_with_robots_that_share_a_process():
    changes = ["clock='wall'", "ticks_max=20", "target.step_m_max=0.5"]
    hunt = encircle.run("sim1", overrides=changes, robots_per_process=4)
    assert hunt.result.ticks == 20
    counts = hunt.timing["real_time"]["robots"]
    assert sorted(counts) == ["r1", "r2", "r3", "r4"]


def test_each_is_asked_by_its_own_name_and_all_are_lost_with_their_process(hunt):
    hunt.start_world()
    hunt.robots["r1"] = hunt.start("agents", "r1", "r2", "--connect", hunt.endpoint)
    for robot in ("r3", "r4"):
        hunt.start_robot(robot)
    hunt.wait_for_ticks()
    with open_session(Endpoints(connect=(hunt.endpoint,), connect_s_max=LONGEST_S)) as session:
        for robot in ("r1", "r2"):
            reply = query(session, robot_key("faulty", robot, "about"), LONGEST_S)
            assert reply is not None
            assert decode_info(reply.payload).node == robot
    hunt.signal("r1", signal.SIGKILL)
    lost = {("r1", "lost: it is gone"), ("r2", "lost: it is gone")}
    hunt.wait_for(lambda seen: set(seen) == lost)
    hunt.wait_for_ticks()
    hunt.start("agents", "r2", "r1", "--connect", hunt.endpoint)
    hunt.wait_for(lambda seen: set(seen[2:]) == {("r1", "back"), ("r2", "back")})
    hunt.wait_for_ticks()


def test_a_signal_ends_all_robots_of_a_process_with_one_line(hunt):
    hunt.start_world()
    shared = hunt.start("agents", *("r1", "r2", "r3", "r4"), "--connect", hunt.endpoint)
    hunt.wait_for_ticks()
    assert shared.terminate() == 1
    last = shared.said.splitlines()[-1]
    assert last == "robot r1, r2, r3, r4: stopped by SIGTERM"


def test_a_robot_that_is_not_of_the_team_ends_alone(finite_hunt):
    finite_hunt.start_world()
    names = ("r1", "r2", "r3", "r4", "r9")
    wait = ("--join-timeout", "1")
    shared = finite_hunt.start("agents", *names, "--connect", finite_hunt.endpoint, *wait)
    assert finite_hunt.world.end() == 0
    assert shared.end() == 1
    assert any("r9: the world of run faulty" in line for line in shared.said.splitlines())
    assert "robot r1, r2, r3, r4: run faulty ended: ticks" in shared.said


FAILS = """
def falls(memory, view):
    raise ZeroDivisionError("nobody divides by this")
"""


def test_a_policy_that_fails_is_told_by_its_robots_line(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(FAILS)
    monkeypatch.chdir(tmp_path)
    changes = ["team.robots.r2={strategy='mine.py:falls'}"]
    with pytest.raises(RunFailed, match=r"in robot r2 at tick 0: .*nobody divides by this"):
        encircle.run("sim2", overrides=changes, robots_per_process=3)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["r1", "r1"], "r1 is named twice"),
        (["r1", "r/2"], "robot 'r/2' is not a valid name"),
        ([], "give it, or set ENCIRCLE_ROBOT"),
    ],
)
def test_names_that_make_no_sense_are_refused_with_one_line(names, said):
    done = completed(ours("agents", *names, "--run", "x", "--connect", "tcp/127.0.0.1:1"))
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_certificate_is_one_robots(tmp_path):
    where = ("--connect", "tls/127.0.0.1:1", "--certificates", str(tmp_path))
    done = completed(ours("agents", "r1", "r2", "--run", "x", *where))
    assert done.returncode == 2
    assert "a certificate is one robot's; start r1, r2 each in a process of its own" in done.stderr
