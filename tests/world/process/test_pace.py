"""A pace for lock-step: when ticks are held back, for how long, and that it decides nothing."""

import threading

import pytest
from helpers_waiting import joined

import encircle
from encircle.world.process.pace import Pace
from encircle.world.scenario.errors import ScenarioError


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.mark.parametrize(("factor", "period_s"), [(1.0, 0.1), (4.0, 0.025), (0.1, 1.0)])
def test_each_tick_takes_as_long_as_its_pace_says(factor, period_s):
    clock = Clock()
    pace = Pace(factor, 0.1, clock)
    for tick in range(20):
        assert pace.left_s(tick) == pytest.approx(period_s)
        clock.now_s += 0.4 * period_s
        assert pace.left_s(tick) == pytest.approx(0.6 * period_s)
        clock.now_s += 0.6 * period_s


def test_a_short_delay_is_made_up_for_and_a_long_one_is_not():
    clock = Clock()
    pace = Pace(1.0, 0.1, clock)
    pace.left_s(0)
    clock.now_s += 0.13
    assert pace.left_s(1) == pytest.approx(0.07)
    clock.now_s += 5.0
    assert pace.left_s(2) == 0.0
    assert pace.left_s(3) == pytest.approx(0.1)


def test_who_is_held_is_released():
    pace = Pace(1.0, 3600.0)
    held = threading.Thread(target=pace.hold, args=(0,))
    held.start()
    pace.release()
    joined(held)
    pace.hold(1)
    assert not pace.holds


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_a_hunt_has_the_same_digest_at_any_pace(link):
    hunts = [encircle.run("sim1", link=link, pace=pace) for pace in (None, 50.0)]
    assert hunts[0].digest == hunts[1].digest
    ticks_s = hunts[1].result.ticks * 0.1 / 50.0
    assert hunts[1].timing["rounds_s"] >= ticks_s


def test_a_run_by_the_clock_has_a_pace_of_its_own():
    with pytest.raises(
        ScenarioError, match=r"clock = 'wall' has a pace of its own; leave --pace 2"
    ):
        encircle.run("sim1", overrides=["clock=wall"], pace=2.0)
