"""Public trace sets, made up in their form: converted, loaded, and refused line by line."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.cli.main import main
from encircle.network.public_traces import FORMATS, read_orbit, read_uma
from encircle.network.tracing import TraceFileError, write_trace
from encircle.runner.hunts import run
from encircle.world.loading.channel_consistency import TRACE_ROWS_MAX
from encircle.world.loading.load import load

MADE_UP = settings(deadline=None, derandomize=True, max_examples=25)
NODES = ["1-2", "1-10", "3-4"]
"""By row and column; by letters 1-10 would be the first."""


def orbit_text(received, strengths=None):
    """A link's file: a line for each packet that came."""
    strengths = strengths or [31] * len(received)
    return "".join(f"{n} {s}\n" for n, s in zip(received, strengths, strict=True))


def noise_level(folder, nodes=NODES, received=lambda _s, _r: range(0, 300, 2)):
    for s in nodes:
        of_sender = folder / f"Results_node{s}_DailyTest_Sat-Jan-01-00_00_00-2000"
        of_sender.mkdir(parents=True)
        for r in nodes:
            if r != s:
                (of_sender / f"sdec{r}").write_text(orbit_text(list(received(s, r))))
    return folder


@MADE_UP
@given(received=st.sets(st.integers(0, 320)))
def test_what_is_missing_in_a_links_file_was_lost(received, tmp_path_factory):
    file = tmp_path_factory.mktemp("orbit") / "sdec1-4"
    file.write_text(orbit_text(sorted(received)))
    trace = read_orbit(file)
    sent = max([300, *(number + 1 for number in received)])
    assert [row.lost for row in trace.rows] == [n not in received for n in range(sent)]
    assert {(row.sender, row.receiver, row.delay_s) for row in trace.rows} == {("", "", None)}
    assert trace.delays_refused == "the set has no delays"
    assert trace.left_out == 0


def test_a_strength_that_could_not_be_read_is_no_loss(tmp_path):
    file = tmp_path / "sdec1-4"
    file.write_text(orbit_text([0, 1, 2], [128, 255, 0]))
    assert [row.lost for row in read_orbit(file).rows[:4]] == [0, 0, 0, 1]


def test_a_noise_level_gives_each_directed_link_its_rows(tmp_path):
    def received(sender, receiver):
        step = 2 + NODES.index(sender) + 3 * NODES.index(receiver)
        return range(0, 301, step)

    folder = noise_level(tmp_path / "dbm-5", received=received)
    (folder / "README").write_text("of no link\n")
    trace = read_orbit(folder)
    for s, sender in enumerate(NODES, 1):
        for r, receiver in enumerate(NODES, 1):
            if s != r:
                rows = [
                    row.lost
                    for row in trace.rows
                    if (row.sender, row.receiver) == (f"r{s}", f"r{r}")
                ]
                came = set(received(sender, receiver))
                assert rows == [n not in came for n in range(max(300, max(came) + 1))]


def test_nodes_of_a_noise_level_are_robots_in_the_order_given(tmp_path):
    def received(sender, _receiver):
        return [] if sender == "3-4" else range(300)

    trace = read_orbit(noise_level(tmp_path / "dbm0", received=received), ["3-4", "1-2"])
    assert len(trace.rows) == 600
    assert {(row.sender, row.receiver, row.lost) for row in trace.rows} == {
        ("r1", "r2", 1),
        ("r2", "r1", 0),
    }


@MADE_UP
@given(times_ms=st.lists(st.floats(0.0, 1.2e6, allow_subnormal=False), min_size=1, max_size=30))
def test_a_delay_is_half_of_its_round_trip(times_ms, tmp_path_factory):
    file = tmp_path_factory.mktemp("uma") / "roundtrip.csv"
    file.write_text("\n".join(map(repr, times_ms)) + "\n\n")
    trace = read_uma(file)
    delays = [row.delay_s for row in trace.rows]
    np.testing.assert_allclose(delays, np.array(times_ms) / 2000.0, rtol=0, atol=0.6e-6)
    assert [row.lost for row in trace.rows] == [0] * len(times_ms)
    assert trace.delays_refused is None


def test_more_round_trips_than_a_scenario_takes_are_left_out_and_counted(tmp_path):
    file = tmp_path / "long.csv"
    file.write_text("4.5\n" * (TRACE_ROWS_MAX + 7))
    trace = read_uma(file)
    assert (len(trace.rows), trace.left_out) == (TRACE_ROWS_MAX, 7)


ORBIT_LINES = [
    ("17", "a packet's number"),
    ("17 31 5", "a packet's number"),
    ("seventeen 31", "a packet's number"),
    ("-3 31", "a packet's number"),
    ("17.0 31", "a packet's number"),
    ("10000 31", "0 to 9999"),
    ("17 256", "0 to 255"),
    ("1 31", "a packet after number 1"),
    ("0 31", "a packet after number 1"),
]
UMA_LINES = ["fast", "4,5", "4.5 ms", "-1", "nan", "inf", "1200001"]


@pytest.mark.parametrize(("line", "must"), ORBIT_LINES)
def test_a_bad_line_of_a_link_is_named(tmp_path, line, must):
    file = tmp_path / "sdec1-4"
    file.write_text(f"0 30\n\n1 31\n{line}\n900 1\n")
    with pytest.raises(TraceFileError) as caught:
        read_orbit(file)
    assert str(caught.value).startswith(f"{file}, line 4: {line!r}: must be ")
    assert must in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("line", UMA_LINES)
def test_a_bad_round_trip_is_named(tmp_path, line):
    file = tmp_path / "roundtrip.csv"
    file.write_text(f"4.5\n5\n{line}\n")
    with pytest.raises(TraceFileError) as caught:
        read_uma(file)
    assert str(caught.value) == (
        f"{file}, line 3: {line!r}: must be the time of a round trip in ms, from 0 to 1200000"
    )


def test_what_is_no_file_of_the_form_is_told_in_one_line(tmp_path):
    (tmp_path / "empty").write_text("\n")
    (tmp_path / "image").write_bytes(b"\xff\xfe\x00")
    folder = noise_level(tmp_path / "dbm0")
    (tmp_path / "none").mkdir()
    gap = noise_level(tmp_path / "gap")
    next(gap.glob("Results_node1-2*/sdec3-4")).unlink()
    twice = noise_level(tmp_path / "twice")
    again = twice / "Results_node1-2_again"
    again.mkdir()
    (again / "sdec3-4").write_text("0 1\n")
    for form, name, nodes, parts in [
        ("uma", "absent", [], ["cannot be read: No such file"]),
        ("orbit", "absent", [], ["cannot be read: No such file"]),
        ("uma", "empty", [], ["has no round trips"]),
        ("uma", "image", [], ["not text in UTF-8"]),
        ("uma", "none", [], ["cannot be read: Is a directory"]),
        ("orbit", "none", [], ["has no files of links", "Results_node1-2_test/sdec1-4"]),
        ("orbit", "gap", [], ["no file of the link from node 1-2 to 3-4"]),
        ("orbit", "twice", [], ["sdec3-4: is of the same link as"]),
        ("orbit", "dbm0", ["1-2", "9-9"], ["no node '9-9'", "1-2, 1-10, 3-4"]),
        ("orbit", "dbm0", ["1-2", "1-2"], ["node 1-2 is named twice"]),
        ("orbit", "dbm0", ["1-2"], ["1 nodes, must be 2 to 256"]),
        ("orbit", "empty", ["1-2"], ["of a folder only"]),
        ("uma", "empty", ["1-2"], ["of the format orbit only"]),
    ]:
        with pytest.raises(TraceFileError) as caught:
            FORMATS[form](tmp_path / name, nodes)
        assert "\n" not in str(caught.value)
        assert str(tmp_path) in str(caught.value)
        for part in parts:
            assert part in str(caught.value), (form, name)
    assert len(read_orbit(folder).rows) == 6 * 300


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_converted_link_is_met_by_a_hunt_as_it_was(tmp_path, capsys, suffix):
    link, out = tmp_path / "sdec1-4", tmp_path / f"link{suffix}"
    link.write_text(orbit_text(range(0, 300, 3)))
    assert main(["trace", str(link), "--from", "orbit", "--out", str(out)]) == 0
    told = capsys.readouterr()
    assert told.out == f"300 packets, 200 lost: {out}\n"
    assert told.err == "encircle: delays are left out: the set has no delays\n"
    loss = load({"team": {"robots": 3}}, [f"channel.loss={{model='trace', file='{out}'}}"]).channel
    assert loss.loss.values == tuple(int(n % 3 > 0) for n in range(300))
    hunt = run(
        {"ticks_max": 9, "team": {"robots": 3}, "target": {"behaviour": "still"}},
        link="memory",
        overrides=[f"channel.loss={{model='trace', file='{out}'}}", "capture.stop_distance_m=1.01"],
    )
    assert hunt.result.packets_lost == {"trace-loss": 6 * 6}


def test_converted_round_trips_are_delays_of_a_hunt(tmp_path, capsys):
    times, out = tmp_path / "roundtrip.csv", tmp_path / "delays.csv"
    times.write_text("4.5\n400\n")
    assert main(["trace", str(times), "--from", "uma", "--out", str(out), "--json"]) == 0
    assert '"delays": true' in capsys.readouterr().out
    assert out.read_text().splitlines() == ["lost,delay_s", "0,0.00225", "0,0.2"]
    delay = load(
        {"team": {"robots": 3}}, [f"channel.delay={{model='trace', file='{out}'}}"]
    ).channel
    assert delay.delay.values == (0.00225, 0.2)


def test_a_converted_folder_is_a_trace_of_links(tmp_path, capsys):
    folder, out = noise_level(tmp_path / "dbm-5"), tmp_path / "links.csv"
    assert (
        main(["trace", str(folder), "--from", "orbit", "--nodes", "1-2,3-4", "--out", str(out)])
        == 0
    )
    assert capsys.readouterr().out == f"600 packets, 300 lost: {out}\n"
    loss = load({"team": {"robots": 2}}, [f"channel.loss={{model='trace', file='{out}'}}"]).channel
    assert [(link.sender, link.receiver) for link in loss.loss.links] == [
        ("r1", "r2"),
        ("r2", "r1"),
    ]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--from", "orbits"], "--from orbits: must be orbit or uma"),
        (["--nodes", "1-2"], "--nodes: is for --from orbit"),
    ],
)
def test_a_mistyped_command_is_told_of(tmp_path, capsys, arguments, told):
    out = tmp_path / "trace.csv"
    assert main(["trace", str(tmp_path / "any"), "--out", str(out), *arguments]) == 2
    assert told in capsys.readouterr().err
    assert not out.exists()


def test_nothing_that_exists_is_overwritten(tmp_path, capsys):
    (tmp_path / "roundtrip.csv").write_text("4.5\n")
    (tmp_path / "out.csv").write_text("mine")
    arguments = [str(tmp_path / "roundtrip.csv"), "--from", "uma", "--out"]
    assert main(["trace", *arguments, str(tmp_path / "out.csv")]) == 2
    assert "exists" in capsys.readouterr().err
    assert (tmp_path / "out.csv").read_text() == "mine"
    with pytest.raises(TraceFileError):
        write_trace(read_uma(tmp_path / "roundtrip.csv"), tmp_path / "out.csv")
