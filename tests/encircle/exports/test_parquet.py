"""Tables of a run in Parquet, read back with pandas, against its log and its result."""

import json

import numpy as np
import pandas as pd
import pytest
from helpers_scene import hunted
from pyarrow import parquet

from encircle.exports.parquet import export
from encircle.exports.table_rows import TABLES
from encircle.measures.radio import delays_ticks
from encircle.protocol.process.interrupts import Interrupted
from encircle.world.channel.loss_causes import CAUSES

CHANGES = [
    "channel.loss={model='bernoulli', rate=0.3}",
    "channel.delay={model='uniform', low_s=0.05, high_s=0.6}",
    "channel.duplication.rate=0.3",
    "sensing.noise_m_std=0.05",
    "events=[{kind='crash', tick=6, ticks=7, robot='r2'}, {kind='silence', tick=3, ticks=4,"
    " robot='r1'}]",
    "ticks_max=25",
]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    recording, log = hunted("sim1", CHANGES)
    out = tmp_path_factory.mktemp("exported") / "tables"
    export(recording, out)
    return recording, log, {name: pd.read_parquet(out / f"{name}.parquet") for name in TABLES}, out


def test_columns_are_those_of_the_page_and_have_units(exported):
    _, _, tables, _ = exported
    for name, table in tables.items():
        assert list(table.columns) == [column for column, _ in TABLES[name]]
        assert np.allclose(table["time_s"], table["tick"] * 0.1)
    # Numbers that could be of several units say of which.
    for columns in TABLES.values():
        for column, kind in columns:
            if kind == "float":
                assert column.endswith(
                    ("_m", "_s", "_rad", "_ticks", "_mps", "_m2", "_m2ps", "_share")
                ) or (column in ("p11_m2ps2", "age_ticks_mean"))


def test_the_truth_is_that_of_the_log(exported):
    recording, log, tables, _ = exported
    truth = tables["truth"]
    bodies = (*recording.scenario.ids, "target")
    for k, body in enumerate(bodies):
        rows = truth[truth["body"] == body]
        assert rows["tick"].tolist() == list(range(log.ticks + 1))
        assert np.array_equal(rows[["x_m", "y_m"]], log.positions[:, k])
    robots = truth[truth["body"] != "target"]
    assert robots["heading_rad"].notna().all()
    away = np.hypot(*(log.robots - log.target[:, None]).reshape(-1, 2).T)
    assert np.allclose(robots["target_distance_m"], away)
    lost = robots[robots["lost"].astype(bool)]
    assert lost.groupby("body")["tick"].apply(list).to_dict() == {"r2": list(range(6, 13))}
    silent = robots[robots["silent"].astype(bool)]
    assert silent.groupby("body")["tick"].apply(list).to_dict() == {"r1": [3, 4, 5, 6]}


def test_decisions_and_beliefs_are_those_of_the_log(exported):
    recording, log, tables, _ = exported
    decisions, beliefs = tables["decisions"], tables["beliefs"]
    assert len(decisions) == log.there.sum()
    for k, robot in enumerate(recording.scenario.ids):
        mine, there = decisions[decisions["robot"] == robot], log.there[:, k]
        assert mine["tick"].tolist() == np.flatnonzero(there).tolist()
        assert mine["mode"].tolist() == log.modes[there, k].tolist()
        assert np.array_equal(mine["xi_ticks"], log.xi[there, k], equal_nan=True)
        assert np.array_equal(mine["point"].fillna(-1), log.points[there, k])
        goals = mine[["goal_x_m", "goal_y_m"]].to_numpy()
        assert np.array_equal(goals, log.goals[there, k], equal_nan=True)
        target = beliefs[(beliefs["robot"] == robot) & (beliefs["about"] == "target")]
        known = ~np.isnan(log.estimates[:, k, 0])
        assert target["tick"].tolist() == np.flatnonzero(known).tolist()
        state = target[["x_m", "y_m", "vx_mps", "vy_mps"]].to_numpy()
        assert np.array_equal(state, log.estimates[known, k])
        covariance = target[["p00_m2", "p01_m2ps", "p11_m2ps2"]].to_numpy()
        assert np.array_equal(covariance, log.covariances[known, k])
        for j, peer in enumerate(recording.scenario.ids):
            rows = beliefs[
                (beliefs["robot"] == robot)
                & (beliefs["about"] == peer)
                & beliefs["planned_with"].eq(True)
            ]
            expected = log.believed[:, k, j]
            expected = expected[~np.isnan(expected[:, 0])]
            assert np.array_equal(rows[["x_m", "y_m"]], expected)


def test_packets_have_fates_and_delays(exported):
    recording, log, tables, _ = exported
    packets, tick_s = tables["packets"], recording.scenario.tick_s
    assert len(packets) == np.count_nonzero(log.due)
    counts = packets.groupby("fate").size().to_dict()
    for code, name in CAUSES.items():
        assert counts.get(name, 0) == (log.due == -code).sum()
    delivered = packets[packets["delay_ticks"].notna()]
    assert sorted(delivered["delay_ticks"]) == sorted(delays_ticks(log))
    assert np.allclose(delivered["delay_s"], delivered["delay_ticks"] * tick_s)
    assert (delivered["arrival_tick"] - delivered["tick"]).eq(delivered["delay_ticks"]).all()
    late = delivered["arrival_tick"] > log.ticks
    assert delivered["fate"].eq(np.where(late, "in-flight", "arrived")).all()
    assert late.any()
    copies = packets["copy_arrival_tick"].dropna()
    assert len(copies) == (log.copies > 0).sum() > 0
    assert (copies >= packets.loc[copies.index, "arrival_tick"]).all()


def test_ages_follow_from_the_packets(exported):
    _, _, tables, _ = exported
    ages, packets = tables["ages"], tables["packets"]
    arrived = pd.concat(
        [packets, packets.assign(arrival_tick=packets["copy_arrival_tick"])]
    ).dropna(subset="arrival_tick")
    for row in ages.sample(300, random_state=1).itertuples():
        over = arrived[
            (arrived["sender"] == row.sender)
            & (arrived["receiver"] == row.receiver)
            & (arrived["arrival_tick"] <= row.tick)
        ]
        newest = over["tick"].max()
        assert np.isnan(row.age_ticks) if np.isnan(newest) else row.age_ticks == row.tick - newest


def test_events_and_values_are_there(exported):
    _, log, tables, _ = exported
    events = tables["events"]
    told = [(tick, kind) for tick, kind in zip(events["tick"], events["kind"], strict=True)]
    assert {(3, "silence"), (6, "lost"), (7, "silence"), (13, "back")} <= set(told)
    assert [list(robots) for robots in events[events["kind"] == "lost"]["robots"]] == [["r2"]]
    assert len(tables["values"]) == log.ticks + 1
    assert len(tables["contacts"]) == len(log.contacts)


def test_metadata_say_of_which_run_they_are(exported):
    recording, log, _, out = exported
    for name in TABLES:
        about = json.loads(parquet.read_schema(out / f"{name}.parquet").metadata[b"encircle"])
        assert about["run"] == recording.run
        assert about["seed"] == recording.seed
        assert about["last_tick"] == log.ticks
        assert about["complete"] is True
        assert about["scenario"]["channel"]["loss"] == {"model": "bernoulli", "rate": 0.3}


def test_long_tables_are_written_in_parts(exported, tmp_path, monkeypatch):
    recording, _, tables, _ = exported
    monkeypatch.setattr("encircle.exports.parquet.ROWS_AT_ONCE", 50)
    export(recording, tmp_path / "tables")
    for name, whole in tables.items():
        pd.testing.assert_frame_equal(
            pd.read_parquet(tmp_path / "tables" / f"{name}.parquet"), whole
        )
    assert parquet.ParquetFile(tmp_path / "tables" / "ages.parquet").num_row_groups > 3


def test_beliefs_can_be_left_out(exported, tmp_path):
    recording, _, tables, _ = exported
    export(recording, tmp_path / "tables", beliefs=False)
    assert len(pd.read_parquet(tmp_path / "tables" / "beliefs.parquet")) == 0
    packets = pd.read_parquet(tmp_path / "tables" / "packets.parquet")
    pd.testing.assert_frame_equal(packets, tables["packets"])


def test_an_interruption_leaves_the_work_between_two_frames(exported, tmp_path, monkeypatch):
    def interrupted():
        raise Interrupted("stopped by SIGINT")

    monkeypatch.setattr("encircle.exports.parquet.check", interrupted)
    with pytest.raises(Interrupted):
        export(exported[0], tmp_path / "tables")
