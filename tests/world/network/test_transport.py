"""What is worked out of a run's ledger, against what a made-up network did to it."""

import numpy as np
import pytest
from helpers_networks import DRIFTS, OFFSETS_US, delays_us, lossier, lossy
from helpers_real_time import EPOCH_US, Simulated, by_clock

from encircle.protocol.messages import Radio
from encircle.world.network.message_ledger import MessageLedger
from encircle.world.network.transits import SETTLE_S, offsets_of, transits_of
from encircle.world.network.transport import clock, delay_refusal, injected, links_of, report


@pytest.fixture(scope="module")
def clean() -> Simulated:
    played = Simulated(by_clock("radio=direct"), delays_us, OFFSETS_US, DRIFTS)
    played.run()
    return played


@pytest.fixture(scope="module")
def losing() -> Simulated:
    played = Simulated(by_clock("radio=direct", "ticks_max=200"), lossy, OFFSETS_US, DRIFTS)
    played.run()
    return played


@pytest.fixture(scope="module")
def losing_all() -> Simulated:
    played = Simulated(by_clock("radio=direct"), lossier, OFFSETS_US, DRIFTS)
    played.run()
    return played


def link(played: Simulated, sender: str, receiver: str, carries: str):
    [found] = [
        one
        for one in links_of(played.world.ledger)
        if (one.sender, one.receiver, one.carries) == (sender, receiver, carries)
    ]
    return found


def test_clocks_an_hour_apart_are_told_within_their_bounds(clean):
    for robot, ahead_us in OFFSETS_US.items():
        told = clock(robot, offsets_of(clean.world.ledger, robot))
        last_us = clean.world.state.tick * 20_000
        true_s = (ahead_us + DRIFTS[robot] * last_us) / 1e6
        assert told["steady"]
        assert abs(told["offset_s"] - true_s) <= told["error_s"] < 0.003
        # Nothing is quicker than the two ways without queues.
        assert told["round_trip_s_median"] >= 0.0029


def test_one_way_delays_are_what_was_put_in_within_their_bounds(clean):
    ledger = clean.world.ledger
    offsets = {robot: offsets_of(ledger, robot) for robot in ledger.robots}
    for sender, receiver in (("r1", "r2"), ("r2", "r1"), ("r4", "r3")):
        transits = transits_of(ledger, sender, receiver, offsets)
        assert len(transits) > 90
        for number, transit in enumerate(transits):
            assert not transit.lost
            true_us = delays_us(sender, receiver, "pose", number)
            assert abs(transit.delay_us - true_us) <= transit.error_us


@pytest.mark.parametrize(
    ("sender", "receiver", "channel"),
    [("world", "r2", "observation"), ("r2", "world", "command"), ("r2", "world", "pose")],
)
def test_delays_of_the_legs_are_what_was_put_in_within_their_bounds(
    clean, sender, receiver, channel
):
    found = link(clean, sender, receiver, channel)
    put_in = [delays_us(sender, receiver, channel, k) / 1e6 for k in range(found.sent)]
    assert found.lost == 0
    assert found.delay_refused is None
    assert abs(found.delay_s_median - np.median(put_in)) <= found.delay_s_error + 1e-5
    assert found.delay_s_error < 0.003


def test_losses_between_robots_are_exactly_those_of_the_network(losing):
    ledger = losing.world.ledger
    offsets = {robot: offsets_of(ledger, robot) for robot in ledger.robots}
    for sender in ledger.robots:
        for receiver in ledger.robots:
            if sender == receiver:
                continue
            lost = [transit.lost for transit in transits_of(ledger, sender, receiver, offsets)]
            truth = losing.sent[sender, receiver, "pose"]
            first = truth.index(False)
            assert lost == truth[first : first + len(lost)]
            # All but what was sent in the last second, or before the first was heard.
            assert len(truth) - first - len(lost) <= SETTLE_S / 0.02 + 2
            assert any(lost)


def late(sender: str, receiver: str, channel: str, number: int) -> int | None:
    """A fifth of everything is lost, and robots hear each other more than two ticks later."""
    delay_us = lossier(sender, receiver, channel, number)
    if delay_us is None or "world" in (sender, receiver):
        return delay_us
    return delay_us + 45_000


def worse(sender: str, receiver: str, channel: str, number: int) -> int | None:
    """All is well in the first half, a third of everything is lost in the second."""
    lost = number >= 150 and np.random.default_rng(
        [7, number, *f"{sender}{receiver}{channel}".encode()]
    ).random() < (1 / 3)
    return None if lost else delays_us(sender, receiver, channel, number)


def _fading() -> dict[str, list[bool]]:
    generator = np.random.default_rng(4)
    fades: dict[str, list[bool]] = {}
    for robot in OFFSETS_US:
        away, fades[robot] = False, []
        for _ in range(400):
            away = generator.random() < (0.8 if away else 0.05)
            fades[robot].append(away)
    return fades


FADES = _fading()


def fading(sender: str, receiver: str, channel: str, number: int) -> int | None:
    """Robots are out of reach for five ticks or so, in and out, of the world as of each other."""
    if any(FADES[robot][number] for robot in (sender, receiver) if robot != "world"):
        return None
    return delays_us(sender, receiver, channel, number)


@pytest.mark.parametrize("network", [lossier, late, worse, fading])
def test_however_many_commands_are_lost_losses_between_robots_are_those_of_the_network(network):
    played = Simulated(by_clock("radio=direct", "ticks_max=300"), network, OFFSETS_US, DRIFTS)
    played.run()
    ledger = played.world.ledger
    offsets = {robot: offsets_of(ledger, robot) for robot in ledger.robots}
    total = 0
    for sender in ledger.robots:
        for receiver in ledger.robots:
            if sender == receiver:
                continue
            transits = transits_of(ledger, sender, receiver, offsets)
            truth = played.sent[sender, receiver, "pose"]
            first = truth.index(False)
            assert [transit.number for transit in transits] == list(
                range(first, first + len(transits))
            )
            assert [transit.lost for transit in transits] == truth[first : first + len(transits)]
            # All but those of the last second, and of what was not known of when the run ended.
            assert len(truth) - first - len(transits) <= SETTLE_S / 0.02 + 20
            total += len(transits)
    assert total > 12 * 180


def test_losses_of_commands_observations_and_packets_are_told_apart(losing_all):
    """In each direction all that was lost is counted once, as what it was."""
    losing = losing_all
    for robot in losing.scenario.ids:
        answered = losing.world.ledger.participations[robot][-1].last_tick + 1
        observations = losing.sent["world", robot, "observation"][:answered]
        assert link(losing, "world", robot, "observation").lost == sum(observations)
        commands = losing.sent[robot, "world", "command"]
        while commands[-1]:  # nobody knows of those that were lost last
            commands = commands[:-1]
        found = link(losing, robot, "world", "command")
        assert abs(found.sent - len(commands)) <= 1
        assert abs(found.lost - sum(commands)) <= 1
        assert found.lost > 5
        packets = losing.sent[robot, "world", "pose"]
        assert abs(link(losing, robot, "world", "pose").lost - sum(packets)) <= 5


def test_what_the_modelled_radio_does_is_no_loss_of_the_network():
    scenario = by_clock("radio=direct", 'channel.loss={model="bernoulli",rate=0.4}')
    played = Simulated(scenario, delays_us)
    played.run()
    found = links_of(played.world.ledger)
    assert sum(one.lost for one in found) == 0
    told = injected(played.world.ledger)
    assert len(told) == 12
    assert all(one["lost"]["loss"] > 20 for one in told)
    assert sum(one["sent"] for one in told) == played.world.rounds.result().packets_sent
    lost = sum(one["lost"]["loss"] for one in told)
    assert lost == played.world.rounds.result().packets_lost["loss"]


def test_injected_delay_is_in_seconds():
    ledger = MessageLedger(("r1", "r2"), 0.02, direct=True)
    ledger.fates_drawn(Radio(10, ((0, 12), (-1, 0)), ((0, 15), (0, 0))))
    ledger.fates_drawn(Radio(11, ((0, 17), (-8, 0))))
    one, other = injected(ledger)
    assert one == {
        "sender": "r1",
        "receiver": "r2",
        "sent": 2,
        "copied": 1,
        "lost": {},
        "delay_s_mean": pytest.approx(0.08),
        "delay_s_max": pytest.approx(0.12),
    }
    assert (other["sender"], other["receiver"], other["sent"]) == ("r2", "r1", 2)
    assert other["lost"] == {"loss": 1, "outage": 1}
    assert other["delay_s_mean"] is other["delay_s_max"] is None


def test_delays_are_refused_when_the_clocks_are_not_known_to_half_a_tick():
    def slow(*sent) -> int:
        return 13_000 + delays_us(*sent)

    played = Simulated(by_clock("radio=direct", "team.hold_ticks_max=20"), slow)
    played.run()
    for one in links_of(played.world.ledger):
        assert one.delay_s_median is one.delay_s_p99 is None
        assert one.delay_s_error > 0.01
        assert "not known to within half a tick (10.00 ms)" in one.delay_refused
        assert one.sent > 20
        assert one.lost == 0
    assert delay_refusal(10_000.0, 0.02) is None
    assert delay_refusal(None, 0.02) == "no exchange of times"


def test_delays_are_refused_when_a_clock_was_set_anew_in_mid_run():
    class Jumping(Simulated):
        def clock_us(self, robot, true_us):
            jump_us = 100_000 if robot == "r2" and true_us > 1_000_000 else 0
            return super().clock_us(robot, true_us) + jump_us

    played = Jumping(by_clock("radio=direct"), delays_us)
    played.run()
    found = {(one.sender, one.receiver): one.delay_refused for one in links_of(played.world.ledger)}
    assert "clock of r2 was set anew" in found["r1", "r2"]
    assert "clock of r2 was set anew" in found["world", "r2"]
    assert found["r1", "r3"] is None


def test_a_frozen_robot_has_lost_nothing_when_it_goes_on_and_had_it_late():
    played = Simulated(by_clock("radio=direct"), delays_us, frozen_us={"r2": (500_000, 900_000)})
    world = played.run()
    found = link(played, "world", "r2", "observation")
    arrivals_us = [20_000 * k + delays_us("world", "r2", "observation", k) for k in range(100)]
    true_us = [
        (900_000 if 500_000 <= at_us < 900_000 else at_us) - 20_000 * k
        for k, at_us in enumerate(arrivals_us)
    ]
    quantiles_s = np.quantile(true_us[: found.sent], (0.5, 0.99)) / 1e6
    assert found.sent >= 98
    assert found.delay_s_p99 > 0.35
    assert np.abs(quantiles_s - (found.delay_s_median, found.delay_s_p99)).max() < 0.003
    assert all(one.lost == 0 for one in links_of(world.ledger))
    counts = world.answers.summary()
    assert counts["r2"]["held"] >= 5
    assert counts["r2"]["stood_still"] >= 10
    assert counts["r1"] == {"late": 0, "held": 0, "stood_still": 0, "superseded": 0}
    assert world.ledger.participations["r2"][-1].passed_over >= 15


def test_what_was_sent_to_a_robot_that_was_cut_off_at_the_end_is_not_known_to_have_come():
    def cut(sender: str, receiver: str, channel: str, number: int) -> int | None:
        gone = "r2" in (sender, receiver) and number >= 60
        return None if gone else delays_us(sender, receiver, channel, number)

    played = Simulated(by_clock(), cut)
    played.run()
    found = link(played, "world", "r2", "observation")
    assert (found.sent, found.lost, found.unknown) == (60, 0, 40)
    assert link(played, "world", "r1", "observation").unknown <= 1


def test_a_full_ledger_says_from_when_on(clean):
    ledger = MessageLedger(("r1", "r2"), 0.02, direct=True, rows_max=3)
    source = clean.world.ledger
    ledger.joined("r1", 0)
    for number, (tick, sent_us, arrival_us) in source.participations["r1"][0].packets.items():
        pose = _pose(number, tick, sent_us)
        ledger.packet(pose, arrival_us)
    assert len(ledger.participations["r1"][0].packets) == 3
    assert report(ledger)["incomplete_from_tick"] == 3
    assert report(source)["incomplete_from_tick"] is None


def _pose(number, tick, sent_us):
    from helpers_world import pose

    return pose("r1", tick, sequence=number, sent_us=sent_us)


def test_robots_that_never_hear_each_other_have_lost_every_packet():
    """As behind a router with certificates that was not told of the direct radio."""

    def deaf(sender: str, receiver: str, channel: str, number: int) -> int | None:
        among_robots = "world" not in (sender, receiver)
        return None if among_robots else delays_us(sender, receiver, channel, number)

    played = Simulated(by_clock("radio=direct"), deaf)
    played.run()
    settle_ticks = SETTLE_S / 0.02
    for sender in played.scenario.ids:
        for receiver in played.scenario.ids:
            if sender != receiver:
                found = link(played, sender, receiver, "pose")
                assert found.lost == found.sent >= 100 - settle_ticks - 1
                assert found.delay_refused == "nothing has arrived"


def test_nothing_is_concluded_from_a_run_in_which_nothing_came():
    ledger = MessageLedger(("r1", "r2"), 0.02, direct=True)
    ledger.joined("r1", 0)
    ledger.joined("r2", 0)
    ledger.asked("r1", 0, EPOCH_US)
    for one in links_of(ledger):
        assert (one.sent, one.lost) == (0, 0)
        assert one.delay_refused == "no exchange of times"
