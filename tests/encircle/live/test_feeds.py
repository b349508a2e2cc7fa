"""Looking on at hunts, in memory and over Zenoh: what is seen is what the recording shows."""

import threading
from concurrent.futures import Future
from contextlib import closing, contextmanager

import pytest
from helpers_hunt import LONG
from helpers_waiting import TIMEOUTS, joined, until

import encircle
from encircle.live.in_memory import MemoryFeed
from encircle.live.over_zenoh import NothingToSee, ZenohFeed
from encircle.live.updates import RunState
from encircle.protocol.codec import encode
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import End
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.scenario_query import RunDescription, encode_description
from encircle.runner.hunts import run
from encircle.runner.launch import free_endpoint
from encircle.scene.builder import scene_of_recording
from encircle.world.recording.recording import read_recording

LOSSY = LONG | {"ticks_max": 40, "channel": {"loss": {"model": "bernoulli", "rate": 0.4}}}
CRASH = LOSSY | {"events": [{"kind": "crash", "robot": "r2", "tick": 10, "ticks": 15}]}


def seen(feed):
    """All that a feed gives until the end: messages, frames, and how the run stands then."""
    messages, frames = [], []
    while True:
        update = feed.take(0.2)
        messages += update.messages
        frames += update.frames
        if update.status.state is RunState.ENDED:
            return messages, frames, update.status


class Looking:
    """Looks on at a hunt in a thread of its own, from its start: a ``HuntOnlooker``."""

    def __init__(self, endpoint=None, in_memory=False):
        self.found, self.feed = None, None
        self._in_memory = in_memory

    def begin(self, scenario, name, so_far=()):
        self._run, self._so_far = name, tuple(so_far)
        if self._in_memory:
            self.feed = MemoryFeed(scenario, name, so_far=self._so_far)
            self._follow()

    def look_on(self, endpoint):
        made = Future()
        self.feed = ZenohFeed(Endpoints(connect=(endpoint,)), self._run, so_far=self._so_far)
        self._follow()
        made.set_result(None)
        return made

    def hear(self, *message):
        if self._in_memory:
            self.feed.hear(*message)

    def end(self):
        if self._in_memory:
            self.feed.end()
        joined(self._thread)
        self.feed.close()

    def _follow(self):
        self._thread = threading.Thread(target=self._look)
        self._thread.start()

    def _look(self):
        self.found = seen(self.feed)


@pytest.mark.parametrize("link", ["memory", "zenoh"])
@pytest.mark.parametrize("scenario", [LOSSY, CRASH], ids=["lossy", "crash"])
def test_what_is_seen_of_a_hunt_is_what_its_recording_shows(tmp_path, link, scenario):
    looking = Looking(in_memory=link == "memory")
    out = tmp_path / "run"
    hunt = run(scenario, link=link, out=out, onlooker=looking, timeouts=TIMEOUTS)
    assert hunt.digest == run(scenario, link="memory").digest
    messages, frames, status = looking.found
    recording = read_recording(out)
    scene = scene_of_recording(recording)
    assert frames == list(scene.frames)
    assert {m for m in messages if not m[1].endswith("/end")} == {
        m for m in recording.messages if not m[1].endswith("/end")
    }
    assert looking.feed.stage == scene.stage
    assert (status.text, status.complete, status.missed_ticks) == ("", True, 0)


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_a_hunt_that_is_gone_on_with_is_seen_from_its_start(tmp_path, link):
    whole, half = tmp_path / "whole", tmp_path / "half"
    run(LOSSY, link="memory", out=whole)

    def stop(report):
        if report.get("tick", 0) > 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(LOSSY, link="memory", out=half, progress=stop, pace=20.0)
    looking = Looking(in_memory=link == "memory")
    hunt = encircle.resume(half, link=link, onlooker=looking, timeouts=TIMEOUTS)
    assert hunt.digest == run(LOSSY, link="memory").digest
    _, frames, status = looking.found
    assert frames == list(scene_of_recording(read_recording(half)).frames)
    assert [frame.beliefs_unsure for frame in frames] == [()] * len(frames)
    assert (status.text, status.complete) == ("", True)


class World:
    """What a viewer hears of a world, said by hand."""

    def __init__(self, name, described):
        self.endpoint, self.name = free_endpoint(), name
        self.link = ZenohConnection(Endpoints(listen=(self.endpoint,)), robot_key(name, "*", "*"))
        if described is not None:
            self.link.answer_queries(world_key(name, "scenario"), lambda: described)
        self.come_back()

    def come_back(self):
        self.token = self.link.session.liveliness().declare_token(world_key(self.name, "alive"))

    def leave(self):
        self.token.undeclare()

    def say(self, topic, payload):
        self.link.send(f"encircle/{self.name}/{topic}", payload)

    def close(self):
        self.link.close()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    out = tmp_path_factory.mktemp("recorded") / "run"
    run(LOSSY, link="memory", out=out)
    return read_recording(out)


def described(recording, **changes):
    scenario = recording.scenario.model_dump_json()
    whole = {
        "run": recording.run,
        "seed": recording.seed,
        "scenario": scenario,
        "setups": (),
    } | changes
    return encode_description(RunDescription(**whole))


def feed_of(world, **options):
    return ZenohFeed(Endpoints(connect=(world.endpoint,)), world.name, **options)


@contextmanager
def watched(recording):
    """A world that has the run of a recording, and a feed that looks on."""
    with (
        closing(World(recording.run, described(recording))) as world,
        closing(feed_of(world)) as feed,
    ):
        yield world, feed


def until_frames(feed, tick):
    """Take what a feed gives until the frame of a tick is there; the last update."""
    found = []

    def there():
        found.append(feed.take(0.1))
        return any(frame.tick >= tick for update in found for frame in update.frames)

    until(there, f"the frame of tick {tick}")
    return found[-1]


def test_who_comes_late_is_told_what_cannot_be_known(recorded):
    with (
        closing(World(recorded.run, described(recorded))) as world,
        closing(feed_of(world)) as feed,
    ):
        assert feed.take(0.0).status.state is RunState.WAITING
        for tick, topic, payload in recorded.messages:
            if tick >= 20:
                world.say(topic, payload)
        _, frames, status = seen(feed)
        assert frames[0].tick == 20
        assert frames[0].beliefs_unsure == recorded.scenario.ids
        assert frames[5].robots == scene_of_recording(recorded).frames[25].robots
        assert status.text == "seen from tick 20 on"
        assert status.complete


def test_ticks_that_are_missed_are_told_and_beliefs_are_then_unsure(recorded):
    with (
        closing(World(recorded.run, described(recorded))) as world,
        closing(feed_of(world)) as feed,
    ):
        for tick, topic, payload in recorded.messages:
            if not 12 <= tick < 15:
                world.say(topic, payload)
        _, frames, status = seen(feed)
        assert [frame.tick for frame in frames] == [*range(12), *range(15, 41)]
        assert status.missed_ticks == 3
        assert "3 ticks missed" in status.text
        unsure = {frame.tick for frame in frames if frame.beliefs_unsure}
        assert unsure == set(range(15, 40))


def test_after_a_long_gap_it_is_seen_again(tmp_path):
    out = tmp_path / "run"
    run(LONG, link="memory", out=out)
    recording = read_recording(out)
    with watched(recording) as (world, feed):
        for tick, topic, payload in recording.messages:
            if not 12 <= tick < 350:
                world.say(topic, payload)
        _, frames, status = seen(feed)
        assert [frame.tick for frame in frames] == [*range(12), *range(350, 401)]
        assert status.missed_ticks == 338
        # What packets brought in those ticks is not known: no age counts on from before.
        assert max(age for frame in frames for row in frame.ages for age in row) < 60


def test_a_world_that_is_out_of_reach_for_a_moment_is_not_gone(recorded):
    with watched(recorded) as (world, feed):
        for tick, topic, payload in recorded.messages:
            if tick <= 10:
                world.say(topic, payload)
        until_frames(feed, 9)
        world.leave()
        until(lambda: "out of reach" in feed.take(0.1).status.text, "the world to go")
        world.come_back()
        until(lambda: feed.take(0.1).status.text == "", "the world to be back")
        for tick, topic, payload in recorded.messages:
            if tick > 10:
                world.say(topic, payload)
        _, frames, status = seen(feed)
        assert frames[-1].tick == 40
        assert (status.text, status.complete) == ("", True)


def test_a_world_that_dies_is_told(recorded):
    with (
        closing(World(recorded.run, described(recorded))) as world,
        closing(feed_of(world)) as feed,
    ):
        for tick, topic, payload in recorded.messages:
            if tick <= 10:
                world.say(topic, payload)
        until_frames(feed, 9)
        world.close()
        _, frames, status = seen(feed)
        assert frames[-1].tick == 10
        assert status.text == "the world is gone (tick 10)"
        assert not status.complete


def test_a_run_that_fails_is_told(recorded):
    with (
        closing(World(recorded.run, described(recorded))) as world,
        closing(feed_of(world)) as feed,
    ):
        for tick, topic, payload in recorded.messages:
            if tick <= 10 and topic != "world/radio":
                world.say(topic, payload)
        world.say("robots/r1/end", encode(End("r1", 10, "failed: r3 is lost"), world.name))
        _, _, status = seen(feed)
        assert "failed: r3 is lost" in status.text
        assert not status.complete


def test_before_the_run_begins_it_is_told_who_is_waited_for(recorded):
    with (
        closing(World(recorded.run, described(recorded))) as world,
        closing(feed_of(world)) as feed,
    ):
        robots = [ZenohConnection(Endpoints(connect=(world.endpoint,)), "x") for _ in range(2)]
        for name, robot in zip(("r1", "r3"), robots, strict=True):
            robot.declare_alive(robot_key(world.name, name, "alive"))
        until(lambda: feed.take(0.1).status.text == "waiting for r2, r4", "two robots")
        for robot in robots:
            robot.close()
        until(lambda: "r1" in feed.take(0.1).status.text, "nobody")


def with_unknown_policy(recording):
    scenario = recording.scenario.model_dump_json()
    return described(recording, scenario=scenario.replace("xi-star", "none-such"))


@pytest.mark.parametrize(
    ("reply", "says"),
    [
        (lambda recording: b"", "not msgpack"),
        (lambda recording: described(recording, scenario="[]"), "cannot be understood here"),
        (lambda recording: described(recording, scenario="{"), "cannot be understood here"),
        (
            lambda recording: described(
                recording,
                scenario=recording.scenario.model_dump_json().replace("xi-star", "none-such"),
            ),
            "cannot be understood here: .*none-such",
        ),
    ],
)
def test_what_cannot_be_understood_is_one_line(recorded, reply, says):
    with (
        closing(World(recorded.run, reply(recorded))) as world,
        pytest.raises(NothingToSee, match=says) as told,
    ):
        feed_of(world)
    assert "\n" not in str(told.value)


def test_a_run_that_is_not_there_is_one_line_with_those_that_are(recorded):
    with closing(World(recorded.run, described(recorded))) as world:
        where = Endpoints(connect=(world.endpoint,))
        with pytest.raises(
            NothingToSee, match=f"^no world of run other answers.*runs there are {world.name}$"
        ):
            ZenohFeed(where, "other", wait_s_max=0.1)


def test_so_is_a_world_that_does_not_tell_its_scenario():
    with (
        closing(World("w", None)) as world,
        pytest.raises(NothingToSee, match="does not tell its scenario"),
    ):
        feed_of(world, wait_s_max=0.1)


def test_who_closes_a_feed_wakes_who_waits(recorded):
    with closing(World(recorded.run, described(recorded))) as world:
        feed = feed_of(world)
        waiting = threading.Thread(target=feed.take, args=(3600.0,))
        waiting.start()
        feed.close()
        feed.close()
        joined(waiting)


class NotShown:
    """An onlooker whose page cannot be served."""

    def begin(self, *_hunt):
        raise RuntimeError("no page")


@pytest.mark.parametrize("link", ["memory", "zenoh"])
def test_a_hunt_that_cannot_be_shown_writes_nothing_and_sets_nothing_aside(tmp_path, link):
    new, half = tmp_path / "new", tmp_path / "half"
    with pytest.raises(RuntimeError, match="no page"):
        run(LOSSY, link=link, out=new, onlooker=NotShown())
    assert not new.exists()

    def stop(report):
        if report.get("tick", 0) > 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(LOSSY, link="memory", out=half, progress=stop, pace=20.0)
    before = {path.name: path.read_bytes() for path in half.iterdir()}
    with pytest.raises(RuntimeError, match="no page"):
        encircle.resume(half, link=link, onlooker=NotShown())
    assert {path.name: path.read_bytes() for path in half.iterdir()} == before
