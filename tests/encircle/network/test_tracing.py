"""Traces of recorded runs: a channel that replays a trace loses and delays what the network did."""

import csv
import io

import numpy as np
import pytest
from helpers_networks import DRIFTS, OFFSETS_US, delays_us, lossier, lossy
from helpers_real_time import Simulated, by_clock
from rich.console import Console

from encircle.cli.main import main
from encircle.network.recorded_ledger import ledger_of
from encircle.network.tracing import NetworkTrace, TraceRow, trace_of, write_trace
from encircle.network.transport_tables import print_transport_report
from encircle.runlog.recorded_log import log_of_recording
from encircle.runner.hunts import run
from encircle.world.loading.trace_files import read_trace, rows_of
from encircle.world.network.transport import links_of
from encircle.world.recording.recording import read_recording

TICKS = 160


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run over a network that loses a fifth of all messages, with its directory."""
    out = tmp_path_factory.mktemp("recorded") / "run"
    scenario = by_clock("radio=direct", f"ticks_max={TICKS}")
    played = Simulated(scenario, lossy, OFFSETS_US, DRIFTS, out=out)
    played.run()
    return played


def test_the_ledger_of_a_recording_is_that_of_the_run(recorded):
    read = ledger_of(read_recording(recorded.out))
    assert read.participations == recorded.world.ledger.participations
    assert read.injected == recorded.world.ledger.injected
    assert links_of(read) == links_of(recorded.world.ledger)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_recorded_converted_and_replayed_the_losses_are_those_of_the_network(
    recorded, tmp_path, suffix
):
    path = tmp_path / f"network{suffix}"
    write_trace(trace_of(read_recording(recorded.out)), path)
    table = f'{{model="trace",file="{path}"}}'
    ticks = 100
    hunt = {
        "ticks_max": ticks,
        "team": {"robots": 4},
        "target": {"behaviour": "still"},
        "tick_s": 0.02,
    }
    overrides = [f"channel.loss={table}", f"channel.delay={table}", "capture.stop_distance_m=1.01"]
    run(hunt, link="memory", overrides=overrides, out=tmp_path / "replayed")
    due = log_of_recording(read_recording(tmp_path / "replayed")).due
    ids = recorded.scenario.ids
    for i, sender in enumerate(ids):
        for k, receiver in enumerate(ids):
            if i == k:
                continue
            truth = recorded.sent[sender, receiver, "pose"]
            first = truth.index(False)
            expected = truth[first : first + len(due)]
            assert len(expected) >= 60
            assert (due[: len(expected), i, k] < 0).tolist() == expected
            # A delay of one or two milliseconds means delivery after one tick.
            sent_ticks = np.arange(len(expected))[~np.array(expected)]
            assert (due[sent_ticks, i, k] == sent_ticks + 1).all()


def test_delays_in_the_file_are_those_of_the_network_within_the_clocks_bounds(recorded, tmp_path):
    path = tmp_path / "network.csv"
    write_trace(trace_of(read_recording(recorded.out)), path)
    rows = rows_of(read_trace(path), "delay")
    [values] = [x["values"] for x in rows["links"] if (x["sender"], x["receiver"]) == ("r1", "r2")]
    truth = [lossy("r1", "r2", "pose", k) for k in range(TICKS)]
    truth = truth[next(k for k, t in enumerate(truth) if t is not None) :]
    assert [v is None for v in values] == [t is None for t in truth[: len(values)]]
    known = [(v, t / 1e6) for v, t in zip(values, truth, strict=False) if v is not None]
    # The time of sending is unknown for packets that did not reach the world; the trace has the
    # median delay.
    close = sum(abs(v - t) < 0.003 for v, t in known)
    assert close == len(known)


def test_a_run_through_the_world_has_the_way_there_and_on(tmp_path):
    played = Simulated(by_clock(), delays_us, OFFSETS_US, DRIFTS, out=tmp_path / "run")
    played.run()
    trace = trace_of(read_recording(tmp_path / "run"))
    assert trace.delays_refused is None
    rows = [row for row in trace.rows if (row.sender, row.receiver) == ("r1", "r3")]
    assert len(rows) >= 98
    for number, row in enumerate(rows[:90]):
        up_us = delays_us("r1", "world", "pose", number)
        down_us = delays_us("world", "r3", "observation", number + 1)
        assert row.lost == 0
        assert abs(row.delay_s - (up_us + down_us) / 1e6) < 0.004


def test_with_an_observation_that_is_lost_go_the_packets_that_it_brings(tmp_path):
    played = Simulated(by_clock(), lossier, OFFSETS_US, DRIFTS, out=tmp_path / "run")
    played.run()
    trace = trace_of(read_recording(tmp_path / "run"))
    up, down = played.sent["r1", "world", "pose"], played.sent["world", "r3", "observation"]
    rows = [row for row in trace.rows if (row.sender, row.receiver) == ("r1", "r3")]
    assert len(rows) > 60
    # Robots send packets only in answer to observations that have arrived.
    ticks = [
        tick for tick, lost in enumerate(played.sent["world", "r1", "observation"]) if not lost
    ]
    truth = [up[k] or down[tick + 1] for k, tick in enumerate(ticks[: len(rows)])]
    assert [bool(row.lost) for row in rows] == truth


def test_without_good_clocks_the_losses_are_told_without_delays(tmp_path):
    trace = NetworkTrace(
        [TraceRow("r1", "r2", 0, 0.001), TraceRow("r1", "r2", 1, None)], "clocks", 0
    )
    write_trace(trace, tmp_path / "t.csv")
    with open(tmp_path / "t.csv", newline="") as file:
        assert list(csv.reader(file)) == [
            ["sender", "receiver", "lost"],
            ["r1", "r2", "0"],
            ["r1", "r2", "1"],
        ]


@pytest.fixture
def cli(capsys):
    """Output of ``encircle``: exit status, standard output, standard error."""

    def run_command(*arguments: object) -> tuple[int, str, str]:
        status = main([str(argument) for argument in arguments])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run_command


def test_a_target_that_exists_is_left_alone(cli, recorded, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("precious")
    status, _, error = cli("trace", recorded.out, "--out", path)
    assert status == 2
    assert error == f"encircle: {path} exists: choose another --out, nothing was changed\n"
    assert path.read_text() == "precious"


@pytest.mark.parametrize("name", ["t.txt", "t"])
def test_a_target_of_another_kind_is_refused_before_anything_is_read(cli, tmp_path, name):
    status, _, error = cli("trace", tmp_path / "nothing", "--out", tmp_path / name)
    assert status == 2
    assert "must end in .csv or .parquet" in error


def test_a_run_in_lock_step_is_refused(cli, tmp_path):
    run({"ticks_max": 3, "team": {"robots": 2}}, link="memory", out=tmp_path / "run")
    for command in (
        ["trace", tmp_path / "run", "--out", tmp_path / "t.csv"],
        ["transport", tmp_path / "run"],
    ):
        status, _, error = cli(*command)
        assert status == 2
        assert "clock = 'lockstep'" in error
        assert error.count("\n") == 1
    assert not (tmp_path / "t.csv").exists()


def test_a_foreign_recording_is_refused(cli, tmp_path):
    (tmp_path / "recording.mcap").write_bytes(b"something else")
    status, _, error = cli("trace", tmp_path, "--out", tmp_path / "t.csv")
    assert status == 2
    assert "is not a recording of this program" in error


def test_a_directory_that_is_not_there_is_refused(cli, recorded, tmp_path):
    status, _, error = cli("trace", recorded.out, "--out", tmp_path / "no" / "t.csv")
    assert status == 2
    assert "cannot be written: No such file or directory" in error


def test_the_tables_of_transport_are_shown(cli, recorded):
    status, output, _ = cli("transport", recorded.out)
    assert status == 0
    assert "what the network did" in output
    assert "clocks" in output


def shown(changes: dict, width: int = 80, clocks: tuple = ()) -> str:
    """The tables of a report with two links and some clocks, on a terminal of a given width."""
    named = {"sender": "r1", "receiver": "world"}
    delays = {"delay_s_median": None, "delay_s_p99": None, "delay_s_error": 0.5}
    link = named | delays | {"carries": "pose", "sent": 7, "lost": 0, "unknown": 0}
    fate = named | {"sent": 7, "copied": 0, "lost": {}, "delay_s_mean": 0.02, "delay_s_max": 0.02}
    rows = {
        "tick_s": 0.02,
        "links": [link | {"delay_refused": reason} for reason in ("because", "because", None)],
        "injected": [fate | changes],
        "clocks": clocks,
        "incomplete_from_tick": None,
    }
    console = Console(width=width, file=io.StringIO())
    print_transport_report(rows, console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_why_there_is_no_delay_stands_once_below_the_table():
    assert shown({}).count("because") == 1
    assert "no delay for 2 of 3 links: because\n" in shown({})


@pytest.mark.parametrize("is_steady", [True, False])
def test_clocks_have_a_column_for_remarks_if_there_are_any(is_steady):
    named = {"offset_s": 0.1, "error_s": 0.1, "round_trip_s_median": 0.1}
    clock = {"robot": "r1", "steady": is_steady, **named}
    said = shown({}, clocks=(clock,))
    assert "clock of" in said
    assert ("remark" in said, "set anew in mid-run" in said) == (not is_steady, not is_steady)


@pytest.mark.parametrize("did", [{"lost": {"loss": 1}}, {"copied": 1}, {"delay_s_max": 0.04}])
def test_what_was_injected_is_shown_if_anything_was(did):
    assert "injected" in shown(did)
    assert "injected" not in shown({})
