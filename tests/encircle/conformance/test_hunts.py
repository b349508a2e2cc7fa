"""What the scenes keep of hunts, and what is said of payloads, replays and time."""

import msgpack
import pytest

from encircle.agents.policies.interface import Decision
from encircle.agents.policies.paper import xi_star
from encircle.conformance import hunts, scenes
from encircle.conformance.scenes import Participation, answers_by_tick, answers_of
from encircle.conformance.strangers import alterations
from encircle.conformance.subject import Subject
from encircle.protocol.messages import quantise_m
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.loading.load import load

COUNTING = """
from encircle.agents.policies.paper import xi_star

count = 0


def policy(memory, view):
    global count
    count += 1
    return memory, xi_star(None, view)[1]._replace(say={"count": count})
"""


@pytest.fixture(scope="module")
def recorded():
    return scenes.record(scenes.scenarios("xi-star", [], 6))


def saying(*said):
    """A participation of a robot that says these, one a tick."""
    part = Participation("plain", "r1")
    real = scenes.record({"plain": scenes.scenarios("xi-star", [], 2)["plain"]})
    part.views = real.participations[0].views[: len(said)]
    part.decisions = [Decision("go", (0.0, 0.0), (0.0, 0.0), say=say) for say in said]
    return part


class Steps:
    """The step of every decision of a run in memory, as its commands tell them."""

    def __init__(self):
        self.modes = []

    def decided(self, world, robots, answers):
        self.modes += [
            (world.state.tick, a.command.robot, a.command.mode, a.command.point)
            for a in answers
            if a is not None
        ]

    def ended(self, world):
        pass


@pytest.mark.parametrize("scene", scenes.SCENES)
def test_a_scene_is_the_hunt_that_it_would_be_without_witnesses(scene, recorded):
    scenario = scenes.scenarios("xi-star", [], 6)[scene]
    steps = Steps()
    run_in_memory(build(scenario, scenario.seed), "run", lambda _line: None, observer=steps)
    witnessed = [
        (view.tick, part.robot, decision.mode, decision.point)
        for part in recorded.participations
        if part.scene == scene
        for view, decision in zip(part.views, part.decisions, strict=True)
    ]
    assert sorted(witnessed) == sorted(steps.modes)


def test_the_scenes_have_what_breaks_policies(recorded):
    views = {scene: [] for scene in scenes.SCENES}
    for part in recorded.participations:
        views[part.scene] += part.views
    assert all(view.target is None for view in views["nothing seen"])
    assert any(view.target is not None for view in views["plain"])
    assert all(view.peers == () for view in views["alone"])
    assert {len(view.team) for view in views["large team"]} == {6}
    late = [v.tick - p.tick for v in views["bad radio"] for p in v.heard]
    assert max(late) > 1
    again = [p.robot for p in recorded.participations if p.scene == "a lost robot"]
    assert sorted(again) == ["r1", "r2", "r2", "r3"]
    twice = [(v.tick, v.robot, p.robot, p.sequence) for v in views["bad radio"] for p in v.heard]
    assert len({t[1:] for t in twice}) < len(twice)


def test_views_asked_tick_by_tick_and_one_after_the_other_are_the_same_questions(recorded):
    parts = [part for part in recorded.participations if part.scene == "plain"]
    views = [part.views for part in parts]
    by_tick = answers_by_tick(xi_star, [views])
    assert by_tick == [answers_of(xi_star, each) for each in views]
    assert by_tick == [part.answers for part in parts]


def test_alterations_leave_the_real_view_as_it_was_and_keep_its_team(recorded):
    views = [v for p in recorded.participations if p.scene == "bad radio" for v in p.views]
    view = max(views, key=lambda v: len(v.heard))
    before = repr(view)
    for _, _, alter in alterations(["bid"]):
        altered = alter(view)
        assert altered != view
        assert altered.team == view.team
        assert altered.positions[altered.own] == view.positions[view.own]
    assert repr(view) == before


def test_the_largest_payload_is_measured_as_msgpack_has_it():
    said = [{"a": 1}, {"bids": ["r1", 5] * 20}, {}]
    (result,) = hunts.check_payload([saying(*said)], 4)
    assert result.level == "ok"
    assert f"at most {len(msgpack.packb(said[1]))} of 1024 bytes (r1 at tick 1" in result.said


def test_a_payload_that_is_nearly_too_large_is_a_note():
    (result,) = hunts.check_payload([saying({"a": b"x" * 900})], 4)
    assert (result.level, "--robots" in result.advice) == ("note", True)


@pytest.mark.parametrize(("number", "is_noted"), [(0.1, True), (quantise_m(0.1), False)])
def test_numbers_that_other_machines_may_have_otherwise_are_a_note(number, is_noted):
    results = hunts.check_payload([saying({"at": {"r1": (number, 1)}})], 4)
    assert [r.level for r in results] == ["ok", "note"][: 1 + is_noted]


def test_a_policy_that_counts_is_replayed_and_resumed_to_another_end(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "counting.py").write_text(COUNTING)
    scenario = load({"team": {"robots": 3, "strategy": "counting.py:policy"}, "ticks_max": 30})
    results = hunts.check_replay(scenario)
    assert [(r.check, r.level) for r in results] == [("replay", "wrong"), ("resume", "wrong")]


def test_a_run_that_fails_the_second_time_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "counting.py").write_text(
        COUNTING.replace("count += 1", "count += 1 // (70 - count)")
    )
    text = COUNTING.replace("count += 1\n", "count += 1\n    1 // (95 - count)\n")
    (tmp_path / "counting.py").write_text(text)
    scenario = load({"team": {"robots": 3, "strategy": "counting.py:policy"}, "ticks_max": 30})
    (result,) = hunts.check_replay(scenario)
    assert (result.check, result.level) == ("replay", "wrong")
    assert "ZeroDivisionError" in result.said


def test_a_slower_policy_is_told_so_and_never_wrong(recorded):
    def thorough(memory, view):
        for _ in range(20):
            answer = xi_star(memory, view)
        return answer

    parts = [part for part in recorded.participations if part.scene == "plain"]
    result = hunts.check_time(Subject("thorough", thorough, {}), parts)
    times = float(result.said.split(" times")[0].split(", ")[1])
    assert times > 5.0
    assert result.level in ("ok", "note")


def test_steps_that_are_shortened_are_counted(recorded):
    assert "are longer than step_m_max" in hunts.check_steps(recorded.participations).said
    assert "none" in hunts.check_steps([saying({}, {})]).said
