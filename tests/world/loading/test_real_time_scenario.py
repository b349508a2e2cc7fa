"""The scenario's keys for runs by the clock, and where such runs are refused, in one line each."""

import pytest

import encircle
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import digest_header


def test_the_keys_at_their_defaults_are_not_in_the_digest():
    said = ["radio=world", "clock=lockstep", "team.hold_ticks_max=5"]
    assert digest_header(load("sim1", said), 1) == digest_header(load("sim1"), 1)
    assert digest_header(load("sim1", ["clock=wall"]), 1) != digest_header(load("sim1"), 1)


def test_direct_needs_the_clock():
    assert load("sim1", ["radio=direct", "clock=wall"]).radio == "direct"
    with pytest.raises(ScenarioError) as refused:
        load("sim1", ["radio=direct"])
    head, line = str(refused.value).splitlines()
    assert head == "scenario 'sim1' has one problem:"
    assert line.startswith("  radio = 'direct': needs clock = 'wall', not 'lockstep'")


@pytest.mark.parametrize(
    "change",
    ["clock=sundial", "radio=drums", "team.hold_ticks_max=-1", "robot.silence_ticks_max=0"],
)
def test_other_values_are_refused_with_key_and_value(change):
    key, _, value = change.partition("=")
    with pytest.raises(ScenarioError) as refused:
        load("sim1", [change])
    assert f"{key} = " in str(refused.value)
    assert value in str(refused.value)


def test_in_memory_there_is_no_clock():
    with pytest.raises(ScenarioError, match="clock = 'wall': in memory no time passes"):
        encircle.run("sim1", link="memory", overrides=["clock=wall"])


def test_studies_are_in_lock_step():
    with pytest.raises(StudyError, match="clock = 'wall': a study pairs runs") as refused:
        load_plan("loss", ["clock=wall"])
    assert len(str(refused.value).splitlines()) == 2
