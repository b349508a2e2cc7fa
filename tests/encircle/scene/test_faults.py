"""Frames of runs in which robots are killed, freeze and come back, in the middle of rounds too."""

from pathlib import Path

import helpers_swarm
import numpy as np
import pytest
from helpers_scene import frames_of
from helpers_scene_log import assert_as_logged

from encircle.runlog.recorded_log import log_of_messages
from encircle.world.recording.recording import Recording, RecordingError


@pytest.fixture(scope="module", params=range(14))
def swarm(request):
    return helpers_swarm.recorded(request.param)


def frames(swarm, messages):
    scenario = swarm.scenario
    path, run = Path("nowhere"), helpers_swarm.RUN
    return frames_of(Recording(path, scenario, scenario.seed, run, tuple(messages), True))


def test_frames_show_what_the_log_has(swarm):
    scenario, made = swarm.scenario, frames(swarm, swarm.messages)
    of_run = scenario, scenario.seed, helpers_swarm.RUN, swarm.messages
    unsure = {robot for frame in made for robot in frame.beliefs_unsure}
    assert unsure <= swarm.reckless
    if unsure:
        with pytest.raises(RecordingError, match="decided otherwise"):
            log_of_messages(*of_run)
    else:
        assert_as_logged(made, log_of_messages(*of_run))


def test_a_viewer_that_comes_later_shows_the_same_truth(swarm):
    whole = frames(swarm, swarm.messages)
    half = whole[-1].tick // 2
    later = frames(swarm, [m for m in swarm.messages if m[0] >= half])
    assert [f.tick for f in later] == [f.tick for f in whole[half:]]
    for frame, expected in zip(later, whole[half:], strict=True):
        assert frame.robots == expected.robots
        assert frame.packets == expected.packets
        assert frame.modes == expected.modes
        assert frame.lost == expected.lost or frame.tick == whole[-1].tick
        for belief, known in zip(frame.beliefs, expected.beliefs, strict=True):
            assert belief is None or belief == known
        ages, right = np.array(frame.ages), np.array(expected.ages)
        assert ((ages == right) | (ages == -1)).all()
