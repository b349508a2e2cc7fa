"""How long a run may wait at a tick: what is asked again, what is overdue, what is reported."""

from encircle.world.process.progress import (
    LOOK_GAP_S_MAX,
    RESEND_PERIOD_S,
    LockStepWatch,
    NewTick,
    Overdue,
    RealTimeWatch,
    StillWaiting,
)

LOOK_S = 0.125
AGAIN = StillWaiting(answers=True, ask_again=True)


def looks(watch, tick: int, first: int, count: int) -> list[tuple[float, object]]:
    """What each of ``count`` looks has shown, with its time; nothing is left out."""
    times_s = [LOOK_S * k for k in range(first, first + count)]
    shown = [(now_s, watch.look(tick, now_s)) for now_s in times_s]
    return [(now_s, progress) for now_s, progress in shown if progress is not None]


def test_answers_are_asked_for_again_each_period_and_are_overdue_in_the_end_and_then_anew():
    watch = LockStepWatch(answer_s_max=2.5, now_s=0.0)
    shown = looks(watch, 0, 0, 60)
    assert shown[0] == (0.0, NewTick())
    first = [(now_s, progress) for now_s, progress in shown[1:] if now_s <= 3.0]
    assert first == [
        (RESEND_PERIOD_S + LOOK_S, AGAIN),
        (2 * RESEND_PERIOD_S + LOOK_S, AGAIN),
        (2.5 + LOOK_S, Overdue(2.5)),
    ]
    overdue = [now_s for now_s, progress in shown if progress == Overdue(2.5)]
    assert overdue == [2.625, 5.25]


def test_a_new_tick_begins_a_new_wait():
    watch = LockStepWatch(answer_s_max=0.5, now_s=0.0)
    for tick in range(20):
        assert looks(watch, tick, 4 * tick, 4) == [(0.5 * tick, NewTick())]


def test_time_in_which_this_world_was_frozen_is_no_waiting():
    watch = LockStepWatch(answer_s_max=1.0, now_s=0.0)
    assert watch.look(0, 0.0) == NewTick()
    assert watch.look(0, 1000.0) is None, f"{LOOK_GAP_S_MAX} s of it count"
    assert watch.look(0, 1000.6) is None
    assert watch.look(0, 1000.7) == Overdue(1.0)


def test_the_tick_at_which_a_run_was_resumed_has_a_limit_of_its_own_and_is_not_asked_again():
    watch = LockStepWatch(1.25, 0.0, resumed_tick=7, resumed_s_max=5.0)
    resumed = looks(watch, 7, 0, 38)
    assert {progress for _, progress in resumed[1:]} == {
        StillWaiting(answers=True, ask_again=False)
    }
    assert looks(watch, 7, 38, 4) == [(5.125, Overdue(5.0))]
    later = looks(watch, 8, 42, 14)
    assert [progress for _, progress in later] == [NewTick(), AGAIN, Overdue(1.25)]


def test_by_the_clock_nothing_is_asked_again_and_a_tick_that_does_not_end_is_not_reported():
    watch = RealTimeWatch(tick_s=3.0, now_s=0.0)
    shown = looks(watch, 0, 0, 80)
    assert [progress for _, progress in shown] == [
        NewTick(),
        *[StillWaiting(answers=False, ask_again=False)] * 3,
    ]
    assert shown[-1][0] == 3 * RESEND_PERIOD_S + LOOK_S
