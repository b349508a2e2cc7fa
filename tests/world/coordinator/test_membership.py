"""Robots that leave and come back: the table, the setups, the coasting body, capture, the digest.

Oracles: the sum of an arithmetic series for the way a body coasts, the crash event's own ticks, and
a run in which nobody is lost.
"""

import re
import runpy
import sys

import numpy as np
import pytest
from helpers_paths import DOCS
from helpers_world import RUN, SQUARE, answers, arena, begun, departures_of, small

import encircle
from encircle.agents.brain.robot_core import RobotCore
from encircle.measures.registry import measure
from encircle.protocol.codec import decode
from encircle.protocol.errors import OutOfTurn
from encircle.protocol.keys import parse_key, robot_key
from encircle.protocol.messages import Observation, Setup
from encircle.replay.replaying import replay
from encircle.runlog.recorded_log import log_of_recording
from encircle.runlog.runlog import RunLogCollector
from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.arena.dynamics import COAST_TICKS
from encircle.world.arena.engine import build
from encircle.world.coordinator.membership import Departure, DepartureCause
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load
from encircle.world.recording.recording import read_recording
from encircle.world.recording.run_directory import create, start_recording
from encircle.world.scenario.errors import ScenarioError

CRASHES = (
    'events=[{kind="crash",robot="r3",tick=4,ticks=6},{kind="crash",robot="r1",tick=12},'
    '{kind="crash",robot="r2",tick=6,ticks=1}]'
)
PAGE = (DOCS / "protocol.md").read_text(encoding="utf-8")


def said_by(core, robot):
    """One robot's share of the script."""
    return [sent for sent in answers(core) if parse_key(sent[0]).robot == robot]


def observed(outgoing):
    """The observations among messages, by robot."""
    found = [decode(Observation, p, RUN) for key, p in outgoing if key.endswith("/observation")]
    return {seen.robot: seen for seen in found}


def test_a_round_no_longer_waits_for_a_robot_that_is_lost_and_the_others_are_told():
    core = begun(WorldCore(arena(), RUN))
    for robot in ("r1", "r2", "r4"):
        for sent in said_by(core, robot):
            assert core.receive(*sent) == []
    following = observed(core.leave("r3", DepartureCause.GONE))
    assert core.state.tick == 1
    assert list(following) == ["r1", "r2", "r4"]
    assert {seen.lost for seen in following.values()} == {("r3",)}
    assert core.rounds.lost == ("r3",)
    assert core.rounds.result().departures == ((0, "r3", "lost: it is gone"),)


@pytest.mark.parametrize("half", [0, 1])
def test_half_an_answer_of_a_robot_that_is_lost_counts_for_nothing(half):
    core = begun(WorldCore(arena(), RUN))
    core.receive(*said_by(core, "r3")[half])
    for robot in ("r1", "r2", "r4"):
        for sent in said_by(core, robot):
            core.receive(*sent)
    core.leave("r3", DepartureCause.GONE)
    np.testing.assert_array_equal(core.state.positions[2], SQUARE[2])
    assert (core.rounds.fates.due[2] == 0).all()
    assert (core.rounds.fates.due[:2, 2] == -4).all()  # receiver-silent: its radio is gone


def test_an_answer_given_in_full_stands_though_its_robot_is_lost_before_the_round_is_over():
    stays, goes = (begun(WorldCore(arena(), RUN)) for _ in range(2))
    for core in (stays, goes):
        for robot in ("r1", "r2", "r3"):
            for sent in said_by(core, robot):
                core.receive(*sent)
    assert goes.leave("r3", DepartureCause.GONE) == []
    for core in (stays, goes):
        for sent in said_by(core, "r4"):
            core.receive(*sent)
    np.testing.assert_array_equal(goes.state.positions, stays.state.positions)
    np.testing.assert_array_equal(goes.rounds.fates.due, stays.rounds.fates.due)


def test_a_lost_robot_is_set_up_afresh_for_its_next_observation():
    core = begun(WorldCore(arena(), RUN))
    core.leave("r2", DepartureCause.NO_ANSWER)
    late = said_by(core, "r2")
    for sent in late:
        assert core.receive(*sent) == []
    assert core.rounds.refused == {"out-of-turn": 2}
    assert core.join("r2") == []
    with pytest.raises(OutOfTurn):
        core.join("r1")
    out = []
    for robot in ("r1", "r3", "r4"):
        for sent in said_by(core, robot):
            out += core.receive(*sent)
    key, payload = out[0]
    setup = decode(Setup, payload, RUN)
    assert key == robot_key(RUN, "r2", "setup")
    assert (setup.first_tick, setup.answer_tick) == (1, 1)
    assert list(observed(out)) == ["r1", "r2", "r3", "r4"]
    assert {seen.lost for seen in observed(out).values()} == {()}
    assert core.rounds.result().departures == ((0, "r2", "lost: no answer"), (1, "r2", "back"))


def test_a_robot_asked_again_after_it_is_back_gets_its_setup_again_too():
    core = begun(WorldCore(arena(), RUN))
    core.leave("r2", DepartureCause.NO_ANSWER)
    core.join("r2")
    for robot in ("r1", "r3", "r4"):
        for sent in said_by(core, robot):
            core.receive(*sent)
    again = core.rounds.unanswered()
    assert [parse_key(key).channel for key, _ in again] == ["setup"] + ["observation"] * 4
    robot = RobotCore("r2", RUN)
    first, second = ([robot.receive(*sent) for sent in again if "/r2/" in sent[0]] for _ in "ab")
    assert first == second
    assert len(first[1]) == 2


def test_before_the_run_begins_a_robot_may_go_and_come_and_the_run_waits_for_it():
    core = WorldCore(arena(), RUN)
    for robot in core.arena.ids:
        core.join(robot)
    assert core.leave("r2", DepartureCause.GONE) == []
    assert core.rounds.lost == ("r2",)
    [(_, payload)] = core.join("r2")
    assert decode(Setup, payload, RUN).first_tick == 0
    assert core.rounds.lost == ()
    assert len(core.begin()) == 4
    assert core.rounds.result().departures == ()


def test_to_lose_a_robot_twice_is_to_lose_it_once_and_an_unknown_one_is_out_of_turn():
    core = begun(WorldCore(arena(), RUN))
    core.leave("r2", DepartureCause.GONE)
    assert core.leave("r2", DepartureCause.GONE) == []
    assert len(core.rounds.departures) == 1
    with pytest.raises(OutOfTurn):
        core.leave("r9", DepartureCause.GONE)


def test_when_all_are_lost_the_rest_is_played_without_any_and_ends():
    core = begun(WorldCore(arena(), RUN))
    for robot in core.arena.ids:
        ends = core.leave(robot, DepartureCause.GONE)
    assert [parse_key(key).channel for key, _ in ends] == ["end"] * 4
    result = core.rounds.result()
    assert (result.ended, result.ticks, result.captured) == ("ticks", 10, False)
    assert (result.packets_sent, result.packets_in_flight) == (0, 0)


def test_what_is_noted_does_not_pile_up_while_no_robot_is_there():
    noted = []

    def record(tick, _key, _payload):
        noted.append((tick, len(core.rounds.journal.pending)))

    core = begun(WorldCore(arena("ticks_max=60"), RUN, record=record))
    for robot in core.arena.ids:
        core.leave(robot, DepartureCause.GONE)
    core.rounds.commit()
    assert noted[-1][0] == 60
    assert max(pending for _, pending in noted) <= 4


def test_nor_in_memory():
    crashes = [{"kind": "crash", "robot": f"r{n}", "tick": 2} for n in range(1, 5)]
    pending = []
    run_in_memory(
        arena("ticks_max=60", events=crashes),
        RUN,
        print,
        progress=lambda world: pending.append(len(world.rounds.journal.pending)),
    )
    assert len(pending) == 60
    assert max(pending) <= 4


def test_who_looks_on_sees_the_rounds_in_which_no_robot_is_there_before_the_others():
    crashes = [{"kind": "crash", "robot": f"r{n}", "tick": 2, "ticks": 5} for n in range(1, 5)]
    core = begun(WorldCore(arena(events=crashes), RUN))
    core.rounds.journal.publishes = True
    while core.state.tick < 2:
        core.rounds.commit()
        for sent in answers(core):
            outgoing = core.receive(*sent)
    assert core.state.tick == 7
    kinds = [parse_key(key).channel for key, _ in outgoing]
    assert kinds == [*["radio", "state"] * 5, *["setup"] * 4, *["observation"] * 4]


@pytest.mark.parametrize("motion", ["holonomic", "unicycle"])
def test_a_lost_body_coasts_two_steps_more_within_five_ticks_and_then_stands(motion):
    hunted = arena(f"team.motion={motion}", "team.turn_rad_max=3.14")
    state = engine.initial(hunted)
    steps = np.array([[0.0, 0.25]] * 4)
    none = [None] * 4
    for _ in range(3):
        state, _ = engine.advance(hunted, state, steps, none)
    begun_at, gone = state.positions[0].copy(), np.array([True, False, False, False])
    lengths = []
    for _ in range(8):
        before = state.positions[0]
        state, _ = engine.advance(hunted, state, np.zeros((4, 2)), none, lost=gone)
        lengths.append(state.positions[0][1] - before[1])
    # 0.25 (4 + 3 + 2 + 1 + 0) / 5, each step rounded to quanta.
    np.testing.assert_allclose(lengths, [0.2, 0.15, 0.1, 0.05, 0, 0, 0, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(state.positions[0] - begun_at, [0.0, 0.5], rtol=0, atol=4e-6)
    assert lengths[COAST_TICKS - 1 :] == [0.0] * 4


def test_a_lost_unicycle_keeps_its_heading_and_a_robot_that_is_back_steers_again():
    hunted = arena("team.motion=unicycle")
    state, lost = engine.initial(hunted), np.array([True, False, False, False])
    up = np.array([[0.0, 0.2]] * 4)
    for at in range(6):
        before = state.headings[0]
        state, _ = engine.advance(
            hunted, state, up, [None] * 4, lost=lost if at in (2, 3) else None
        )
        assert (state.headings[0] == before) == (at in (2, 3) or before == pytest.approx(np.pi / 2))
    assert state.away is None


def near(robots, count=None):
    """Robots in a ring near enough to capture, of which so many are asked for."""
    ring = [[1.2 * np.cos(a), 1.2 * np.sin(a)] for a in 2 * np.pi * np.arange(robots) / robots]
    sections = {"capture": {"count": count}} if count else {}
    return build(small(team={"positions": ring}, **sections), 1)


@pytest.mark.parametrize(
    ("robots", "gone", "captured"), [(4, 1, False), (5, 1, True), (5, 2, False)]
)
def test_a_team_captures_with_the_robots_that_are_left(robots, gone, captured):
    """Of 4 or 5 at equal angles the gap is pi, or 4 pi / 5, without one; 6 pi / 5 without two."""
    hunted = near(robots)
    lost = np.arange(robots) < gone
    state, _ = engine.advance(
        hunted, engine.initial(hunted), np.zeros((robots, 2)), [None] * robots, lost=lost
    )
    assert state.captured == captured
    assert engine.initial(hunted).captured


def test_a_body_that_nobody_commands_is_no_hunter_though_it_stands_in_the_ring():
    hunted = near(4)
    state = engine.initial(hunted)
    all_gone, _ = engine.advance(
        hunted, state, np.zeros((4, 2)), [None] * 4, lost=np.array([True] * 4)
    )
    assert not all_gone.captured


def recorded(path, *overrides, observer=None):
    """A run of simulation 1 in memory with a recording, and its result."""
    scenario = load("sim1", overrides)
    recorder = start_recording(create(path), scenario, "kept")
    hunted = build(scenario, scenario.seed)
    result = run_in_memory(hunted, "kept", print, recorder.record, observer=observer)
    recorder.close()
    return result


def test_a_crash_in_the_scenario_takes_its_robot_and_brings_it_back(tmp_path):
    result = recorded(tmp_path / "run", CRASHES, "ticks_max=40")
    assert [(t, r, what.split(":")[0]) for t, r, what in result.departures] == [
        (4, "r3", "lost"),
        (6, "r2", "lost"),
        (7, "r2", "back"),
        (10, "r3", "back"),
        (12, "r1", "lost"),
    ]
    there = {robot: set() for robot in ("r1", "r2", "r3", "r4")}
    lost = {}
    for tick, robot, payload in read_recording(tmp_path / "run").of_channel("observation"):
        there[robot].add(tick)
        lost[tick] = decode(Observation, payload, "kept").lost
    every = set(range(result.ticks))
    assert there["r1"] == set(range(12))
    assert there["r2"] == every - {6}
    assert there["r3"] == every - set(range(4, 10))
    assert there["r4"] == every
    assert lost[5] == ("r3",)
    assert lost[6] == ("r2", "r3")
    assert lost[12] == ("r1",)


def test_a_run_with_losses_and_returns_replays_and_its_log_is_the_same_either_way(tmp_path):
    collector = RunLogCollector()
    result = recorded(tmp_path / "run", CRASHES, "ticks_max=40", observer=collector)
    check = replay(tmp_path / "run")
    assert check.same
    assert check.differences == ()
    kept = log_of_recording(read_recording(tmp_path / "run"))
    measured, seen = measure(kept), measure(collector.log())
    np.testing.assert_array_equal(list(measured.values()), list(seen.values()))
    np.testing.assert_array_equal(
        kept.there.sum(axis=0), [12, result.ticks - 1, result.ticks - 6, result.ticks]
    )
    assert not np.isnan(measured["gap_rad_mean"])
    assert 0.0 <= measured["peer_missing_share"] < 0.1


def test_a_recording_shows_when_a_robot_is_lost_in_the_midst_of_a_round(tmp_path):
    """It was asked and never answered; that is no difference, and no decision is missing."""
    scenario = small("ticks_max=8")
    recorder = start_recording(create(tmp_path / "run"), scenario, RUN)
    core = WorldCore(build(scenario, 1), RUN, record=recorder.record)
    robots = {robot: RobotCore(robot, RUN) for robot in core.arena.ids}
    out = [sent for robot in robots for sent in core.join(robot)] + core.begin()
    while core.ended is None:
        said = [
            back
            for key, payload in out
            for back in robots[parse_key(key).robot].receive(key, payload)
        ]
        out = []
        for key, payload in said:
            if parse_key(key).robot == "r4" and core.state.tick in (3, 7):
                out += core.leave("r4", DepartureCause.NO_ANSWER)
            else:
                out += core.receive(key, payload)
        if core.state.tick == 6:
            core.join("r4")
    core.rounds.commit()
    recorder.close()
    check = replay(tmp_path / "run")
    assert departures_of(core) == [
        (3, "r4", "lost: no answer"),
        (7, "r4", "back"),
        (7, "r4", "lost: no answer"),
    ]
    assert check.same
    there = log_of_recording(read_recording(tmp_path / "run")).there[:, 3]
    assert there.tolist() == [True] * 3 + [False] * 5


@pytest.mark.parametrize("crashes", [CRASHES, 'events=[{kind="crash",robot="r2",tick=0,ticks=3}]'])
def test_the_digest_covers_losses_and_the_program_of_the_page_agrees(
    crashes, tmp_path, monkeypatch, capsys
):
    result = recorded(tmp_path / "run", crashes, "ticks_max=30", "channel.duplication.rate=0.2")
    section = PAGE.split("\n## The digest\n", 1)[1]
    (tmp_path / "digest.py").write_text(re.search(r"```python\n(.*?)```", section, re.DOTALL)[1])
    monkeypatch.setattr(sys, "argv", ["digest.py", str(tmp_path / "run" / "recording.mcap")])
    runpy.run_path(str(tmp_path / "digest.py"), run_name="__main__")
    assert capsys.readouterr().out.strip() == result.digest
    assert (
        result.digest
        == recorded(
            tmp_path / "again", crashes, "ticks_max=30", "channel.duplication.rate=0.2"
        ).digest
    )


def test_why_a_robot_was_lost_is_not_in_the_digest_but_that_it_was_is():
    digests = []
    for cause in (None, DepartureCause.GONE, DepartureCause.NO_ANSWER):
        core = begun(WorldCore(arena(), RUN))
        for tick in range(10):
            for key, payload in answers(core):
                if core.ended is None and parse_key(key).robot not in core.rounds.lost:
                    core.receive(key, payload)
            if tick == 4 and cause:
                core.leave("r1", cause)
        digests.append(core.rounds.result().digest)
    assert digests[0] != digests[1] == digests[2]


@pytest.mark.parametrize(
    ("events", "named"),
    [
        ('[{kind="crash",robot="r7",tick=3}]', "events.0.robot = 'r7': robots are r1"),
        ('[{kind="crash",robot="r1",tick=-1}]', "events.0.tick = -1"),
        ('[{kind="crash",robot="r1",tick=3,ticks=0}]', "events.0.ticks = 0"),
        ('[{kind="crash",robot="r1"}]', "events.0.tick"),
        (
            '[{kind="crash",robot="r1",tick=3,ticks=5},{kind="crash",robot="r1",tick=7}]',
            "events.1.tick = 7: r1 is away already, up to tick 8, by events.0",
        ),
        (
            '[{kind="crash",robot="r1",tick=9,ticks=5},{kind="crash",robot="r1",tick=7}]',
            "events.0.tick = 9: r1 is away already, for ever, by events.1",
        ),
    ],
)
def test_a_crash_that_cannot_be_is_a_problem_with_key_and_value(events, named):
    with pytest.raises(ScenarioError, match=re.escape(named)):
        load("sim1", [f"events={events}"])


def test_crashes_one_after_the_other_and_of_others_are_none():
    load(
        "sim1",
        [
            'events=[{kind="crash",robot="r1",tick=3,ticks=5},{kind="crash",robot="r1",tick=8},'
            '{kind="crash",robot="r2",tick=4}]'
        ],
    )


def test_a_run_without_losses_has_the_digest_that_it_would_have_if_none_could_be():
    parts = []

    class Hashed:
        def update(self, part):
            parts.append(part)

    core = WorldCore(arena("ticks_max=1"), RUN)
    core.rounds.journal.hash = Hashed()
    begun(core)
    for sent in answers(core):
        core.receive(*sent)
    core.rounds.commit()
    bodies = 2 * len(core.arena.ids)
    assert len(parts) == 1 + 1 + bodies + 1  # truth; fates; poses and commands; truth


def test_a_run_with_crashes_over_zenoh_is_the_run_in_memory():
    """The processes of robots that are away are simply not asked, and then set up afresh."""
    changes = [CRASHES, "ticks_max=40", "channel.loss={model='bernoulli', rate=0.2}"]
    apart = encircle.run("sim1", link="zenoh", overrides=changes)
    together = encircle.run("sim1", link="memory", overrides=changes)
    assert apart.digest == together.digest
    assert apart.result.departures == together.result.departures
    assert len(apart.result.departures) == 5
    assert apart.result.refused == {}


@pytest.mark.parametrize(
    ("departure", "text"),
    [
        (Departure(3, "r1", DepartureCause.GONE), "lost: it is gone"),
        (Departure(3, "r1", DepartureCause.NO_ANSWER, "for 3 s"), "lost: no answer for 3 s"),
        (Departure(3, "r1", DepartureCause.CRASH), "lost: a crash in the scenario"),
        (Departure(3, "r1", DepartureCause.NOT_RETURNED), "lost: it did not come back"),
        (Departure(3, "r1", DepartureCause.BEFORE_RESUMING), "lost: before the run was resumed"),
        (Departure(3, "r1", DepartureCause.BACK), "back"),
    ],
)
def test_the_texts_of_departures_are_those_that_files_have(departure, text):
    assert departure.text == text
    assert departure.row == (3, "r1", text)
