"""The file for Rerun, read back by Rerun's own reader, against the truth."""

from itertools import pairwise
from math import isnan

import numpy as np
import pytest
from helpers_exports import lossy_hunt, radios_of, states_of
from rerun.chunk import RrdReader

from encircle.exports.rerun_file import export
from encircle.scene.builder import scene_of_recording


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    path = tmp_path_factory.mktemp("rerun") / "hunt.rrd"
    export(lossy_hunt(), path)
    return path


@pytest.fixture(scope="module")
def entities(exported):
    """By entity path and column: (tick, value) in the order of ticks, (None, value) of static."""
    found = {}
    for chunk in RrdReader(exported).stream():
        rows = chunk.to_record_batch().to_pydict()
        ticks = rows.get("tick", [None] * chunk.num_rows)
        for name, values in rows.items():
            if ":" in name:
                column = found.setdefault((chunk.entity_path, name), [])
                column += zip(ticks, values, strict=True)
    return {
        key: sorted(column, key=lambda row: -1 if row[0] is None else row[0])
        for key, column in found.items()
    }


def test_bodies_are_where_the_world_says(entities):
    states = states_of(lossy_hunt())
    for k, robot in enumerate(lossy_hunt().scenario.ids):
        column = entities["/truth/" + robot, "Points3D:positions"]
        assert [tick for tick, _ in column] == [state.tick for state in states]
        # Rerun keeps positions as 32-bit floats.
        places = [place[:2] for _, (place,) in column]
        assert places == pytest.approx(np.float32([state.robots[k] for state in states]))
        drawn = entities[f"/scene/bodies/{robot}", "Cylinders3D:centers"]
        assert [place[:2] for _, (place,) in drawn] == pytest.approx(np.float32(places))


def test_simulated_time_is_the_only_time(exported):
    scenario = lossy_hunt().scenario
    chunks = [c for c in RrdReader(exported).stream() if c.entity_path == "/distances_m/r1"]
    rows = chunks[0].to_record_batch().to_pydict()
    assert set(chunks[0].timeline_names) == {"tick", "simulated time"}
    seconds = [time.total_seconds() for time in rows["simulated time"]]
    assert seconds == pytest.approx([tick * scenario.tick_s for tick in rows["tick"]])
    names = {name for c in RrdReader(exported).stream() for name in c.timeline_names}
    assert names == {"tick", "simulated time"}, "no time at which it was exported"


def test_ages_are_a_table_of_receivers_by_senders(entities):
    frames = scene_of_recording(lossy_hunt()).frames
    tables = entities["/ages", "Tensor:data"]
    for (tick, (tensor,)), frame in zip(tables, frames, strict=True):
        assert tick == frame.tick
        assert tensor["shape"] == [3, 3]
        assert tensor["names"] == ["receiver", "sender"]
        ages = [-1 if isnan(age) else age for age in tensor["buffer"]]
        assert np.reshape(ages, (3, 3)).tolist() == [list(row) for row in frame.ages]


def test_counts_of_packets_are_the_radio_s(entities):
    radios = radios_of(lossy_hunt())
    lost = entities["/packets/loss", "Scalars:scalars"]
    counted = [sum(due == -1 for row in radio.fates for due in row) for radio in radios]
    assert [count for _, (count,) in lost][: len(counted)] == counted
    assert sum(counted) > 0


def test_numbers_that_are_not_known_are_left_out(entities):
    frames = scene_of_recording(lossy_hunt()).frames
    column = entities["/values/age_ticks_mean", "Scalars:scalars"]
    known = [(f.tick, [f.values.age_ticks_mean]) for f in frames if f.values.age_ticks_mean]
    assert column == known
    distances = entities["/distances_m/r2", "Scalars:scalars"]
    assert [d for _, (d,) in distances] == [f.values.distances_m[1] for f in frames]


def test_a_robot_that_is_lost_believes_nothing_for_as_long(entities):
    frames = scene_of_recording(lossy_hunt()).frames
    rows = [row for (path, name), row in entities.items() if "/beliefs/r2/r" in path]
    by_tick = {tick: [] for tick in range(len(frames))}
    for row in rows:
        for tick, value in row:
            if tick is not None:
                by_tick[tick] += value
    assert {tick for tick, values in by_tick.items() if not values} >= set(range(6, 13))
    assert by_tick[20]


def test_events_and_modes_are_there(entities):
    assert (6, ["r2 is lost"]) in entities["/events/lost", "TextLog:text"]
    modes = entities["/modes/r1", "StateChange:state"]
    states = [state for _, state in modes]
    assert all(one != other for one, other in pairwise(states))


def test_when_it_was_exported_is_not_in_it(entities):
    assert not [name for _, name in entities if "start_time" in name]


def test_it_has_a_blueprint_and_is_one_recording(exported):
    reader = RrdReader(exported)
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1


def test_without_beliefs_it_is_a_file_all_the_same(tmp_path):
    export(lossy_hunt(), tmp_path / "hunt.rrd", beliefs=False)
    paths = {chunk.entity_path for chunk in RrdReader(tmp_path / "hunt.rrd").stream()}
    assert not [path for path in paths if path.startswith("/beliefs")]
    assert "/truth/r1" in paths
