"""Traces in files: read as CSV or Parquet, put into the scenario, or refused with the place."""

import json
import sys

import pytest
from helpers_world import RUN, played
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.arena import engine
from encircle.world.loading.channel_consistency import TRACE_ROWS_MAX
from encircle.world.loading.load import load
from encircle.world.loading.trace_files import read_trace, rows_of
from encircle.world.scenario.errors import ScenarioError

SAME = "lost,delay_s\n0,0.1\n1,\n0,0.35\n"
PER_LINK = """sender, receiver, lost, delay_s
r1,r2,1,
r1,r2,0,0.2
,,0,0.1
r2,r1,0,0.3
,,1,
"""
TWO = {"team": {"robots": 2}}


def written(folder, text, name="trace.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def loss_of(path, *overrides, **tree):
    table = {"loss": {"model": "trace", "file": str(path)}}
    return load({**TWO, "channel": table, **tree}, overrides).channel.loss


def delay_of(path, *overrides):
    table = {"delay": {"model": "trace", "file": str(path)}}
    return load({**TWO, "channel": table}, overrides).channel.delay


def refusal(path, sort="loss", *overrides, tree=TWO):
    with pytest.raises(ScenarioError) as caught:
        load({**tree, "channel": {sort: {"model": "trace", "file": str(path)}}}, overrides)
    return str(caught.value)


def test_the_rows_take_the_place_of_the_file(tmp_path):
    path = written(tmp_path, SAME)
    assert loss_of(path).model_dump(exclude_unset=True) == {"model": "trace", "values": (0, 1, 0)}
    assert delay_of(path).model_dump(exclude_unset=True) == {
        "model": "trace",
        "values": (0.1, None, 0.35),
    }


def test_links_get_their_rows_and_the_rest_those_without_names(tmp_path):
    path = written(tmp_path, PER_LINK)
    tree = {"team": {"robots": 3}}
    loss = loss_of(path, **tree)
    assert loss.values == (0, 1)
    own = {(link.sender, link.receiver): link.values for link in loss.links}
    assert own == {("r1", "r2"): (1, 0), ("r2", "r1"): (0,)}
    # The row of r1 to r2 that was lost has no delay, but keeps its place.
    delays = {(link.sender, link.receiver): link.values for link in delay_of(path).links}
    assert delays == {("r1", "r2"): (None, 0.2), ("r2", "r1"): (0.3,)}


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("lost\ntrue\nFalse\nTRUE\n0\n 1 \n1.0\n", (1, 0, 1, 0, 1, 1)),
        ("\ufefflost\r\n1\r\n\r\n0\r\n", (1, 0)),
        ('sequence,"lost",remark\n1,0,"a, b"\n2,"1",\n', (0, 1)),
        ("lost\n1", (1,)),
    ],
)
def test_ways_to_write_a_loss(tmp_path, text, values):
    assert loss_of(written(tmp_path, text)).values == values


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("delay_s\n0\n1e-3\n 0.25 \n600\n", (0.0, 0.001, 0.25, 600.0)),
        ("delay_s,x\n,1\n0.5,2\nnan,3\n", (None, 0.5, None)),
        ("lost,delay_s\n1,-1\n0,0.5\n1,0\n", (None, 0.5, None)),
    ],
)
def test_ways_to_write_a_delay_and_whatever_stands_for_a_lost_one(tmp_path, text, values):
    assert delay_of(written(tmp_path, text)).values == values


@pytest.mark.parametrize(
    ("text", "sort", "parts"),
    [
        ("lost\n0\n2\n", "loss", ["row 2", "lost = '2'", "0 or 1"]),
        ("lost\n0\nyes\n", "loss", ["row 2", "lost = 'yes'"]),
        ("lost,x\n0,a\n,b\n", "loss", ["row 2", "lost = ''"]),
        ("delay_s\n0.1\n-0.2\n", "delay", ["row 2", "delay_s = '-0.2'", "0 to 600"]),
        ("delay_s\n0.1\nsoon\n", "delay", ["row 2", "delay_s = 'soon'"]),
        ("delay_s\n0.1\n0.2\ninf\n", "delay", ["row 3", "delay_s = 'inf'"]),
        ("delay_s\n601\n", "delay", ["row 1", "delay_s = '601'"]),
        ("lost,delay_s\n0,0.1\n0,\n", "delay", ["row 2", "delay_s = ''", "from 0 to 600 s"]),
        ("lost,delay_s\n0,0.1\nx,0.2\n", "delay", ["row 2", "lost = 'x'"]),
        ("delay_s,x\n,1\n,2\n", "delay", ["every packet was lost"]),
        ("delay_s\n0.1\n", "loss", ["no column 'lost'", "delay_s"]),
        ("lost;delay_s\n0;0.1\n", "loss", ["no column 'lost'", "lost;delay_s"]),
        ("lost,lost\n0,1\n", "loss", ["two columns", "lost, lost"]),
        ("lost,delay_s\n0,0.1\n1\n", "loss", ["row 2", "1 values under 2 names"]),
        ("lost\n", "loss", ["no rows"]),
        ("", "loss", ["no rows"]),
        ('lost\n"0\n', "loss", ["cannot be read"]),
        ("sender,lost\nr1,0\n", "loss", ["no column 'receiver'"]),
        ("sender,receiver,lost\nr1,,0\n", "loss", ["row 1", "receiver = ''"]),
        ("sender,receiver,lost\n,,1\n,r1,0\n", "loss", ["row 2", "sender = ''"]),
        ("sender,receiver,lost\nr1,r1,0\n", "loss", ["row 1", "receiver = 'r1'", "another"]),
        ("sender,receiver,lost\nrobot 1,r2,0\n", "loss", ["row 1", "sender = 'robot 1'"]),
        ("sender,receiver,lost\nr01,r2,0\n", "loss", ["row 1", "sender = 'r01'"]),
        ("sender,receiver,lost\nr1,r2,0\n", "loss", ["channel.loss", "no rows for r2 -> r1"]),
    ],
)
def test_a_malformed_trace_is_refused_by_file_row_column_and_value(tmp_path, text, sort, parts):
    path = written(tmp_path, text)
    said = refusal(path, sort)
    assert "has one problem" in said
    assert f"channel.{sort}" in said
    assert all(part in said for part in parts), said
    if "rows for" not in parts[-1] and "every packet" not in parts[-1]:
        assert str(path) in said


def test_links_without_rows_are_named_but_not_all_of_many(tmp_path):
    path = written(tmp_path, "sender,receiver,lost\nr1,r2,0\n")
    said = refusal(path, tree={"team": {"robots": 5}})
    assert "no rows for r1 -> r3, r1 -> r4, r1 -> r5, r2 -> r1 and 15 more" in said


def test_a_link_that_another_loss_is_for_needs_no_rows(tmp_path):
    path = written(tmp_path, "sender,receiver,lost\nr1,r2,0\n")
    trace = {"model": "trace", "file": str(path)}
    links = [{"sender": "r1", "receiver": "r2", "loss": trace}]
    loaded = load({"team": {"robots": 3}, "channel": {"links": links}})
    assert "file" not in json.dumps(loaded.model_dump(mode="json"))
    others = [{"sender": "r2", "loss": {"model": "none"}}]
    assert load({**TWO, "channel": {"loss": trace, "links": others}}).ids == ("r1", "r2")


def test_rows_of_robots_that_a_smaller_team_has_not_are_no_matter(tmp_path):
    text = PER_LINK + "r7,r8,1,\n"
    assert len(loss_of(written(tmp_path, text)).links) == 3


@pytest.mark.parametrize("name", ["absent.csv", "folder.csv", "trace.txt", "trace", "nul\0.csv"])
def test_a_file_that_cannot_be_read_is_refused_with_its_name(tmp_path, name):
    (tmp_path / "folder.csv").mkdir()
    said = refusal(f"{tmp_path}/{name}")
    assert name in said or "\0" in name
    assert "channel.loss.file" in said


def test_bytes_that_are_no_text_are_refused(tmp_path):
    for name in ("trace.csv", "trace.parquet"):
        (tmp_path / name).write_bytes(b"lost\n\xff\xfe\n" * 9)
        assert f"{name} cannot be read" in refusal(tmp_path / name)


def test_too_many_rows_are_refused_in_one_file_or_together(tmp_path):
    row = "0,0.1\n"
    long = written(tmp_path, "lost,delay_s\n" + row * (TRACE_ROWS_MAX + 1), "long.csv")
    assert f"more than {TRACE_ROWS_MAX} rows" in refusal(long)
    half = written(tmp_path, "lost,delay_s\n" + row * (TRACE_ROWS_MAX // 2 + 1), "half.csv")
    both = {sort: {"model": "trace", "file": str(half)} for sort in ("loss", "delay")}
    with pytest.raises(ScenarioError, match=f"{TRACE_ROWS_MAX + 2} rows together"):
        load({**TWO, "channel": both})


def test_a_file_lies_beside_the_scenario_or_in_the_working_directory(tmp_path, monkeypatch):
    beside, here = tmp_path / "beside", tmp_path / "here"
    beside.mkdir()
    here.mkdir()
    written(beside, "lost\n1\n")
    written(here, "lost\n0\n0\n")
    monkeypatch.chdir(here)
    scenario = beside / "hunt.toml"
    scenario.write_text(
        "[team]\nrobots = 2\n[channel]\nloss = {model = 'trace', file = 'trace.csv'}\n"
        "[[channel.links]]\nsender = 'r1'\nloss = {model = 'trace', file = 'trace.csv'}\n"
    )
    for path in (scenario, "../beside/hunt.toml"):
        loaded = load(path)
        assert loaded.channel.loss.values == loaded.channel.links[0].loss.values == (1,)
    assert load(scenario, ["channel.loss.file=trace.csv"]).channel.loss.values == (0, 0)
    assert loss_of("trace.csv").values == (0, 0)
    assert loss_of(beside / "trace.csv").values == (1,)


def test_all_that_is_wrong_is_said_at_once(tmp_path):
    said = refusal(written(tmp_path, "lost\n7\n"), "loss", "tick_s=-1", "channel.delay.rate=1")
    assert "3 problems" in said
    assert all(part in said for part in ("lost = '7'", "tick_s = -1", "channel.delay.rate"))
    said = refusal(written(tmp_path, "lost\n7\n"), "loss", "capture.count=9", "seed=3")
    assert "2 problems" in said


def test_a_resolved_scenario_depends_on_no_file(tmp_path):
    path = written(tmp_path, PER_LINK)
    table = {"model": "trace", "file": str(path), "mode": "shifted"}
    tree = {
        "team": {"robots": 2},
        "ticks_max": 6,
        "target": {"behaviour": "still"},
        "channel": {"loss": table, "delay": table},
    }
    loaded = load(tree)
    digest = played(engine.build(loaded, 1), RUN).rounds.result().digest
    path.unlink()
    for unset in (True, False):
        text = loaded.model_dump_json(exclude_unset=unset)
        assert "file" not in text
        again = load(json.loads(text))
        assert again == loaded
        assert played(engine.build(again, 1), RUN).rounds.result().digest == digest
    moved = written(tmp_path, PER_LINK, "other.csv")
    for sort in ("loss", "delay"):
        tree["channel"][sort] = {**table, "file": str(moved)}
    assert played(engine.build(load(tree), 1), RUN).rounds.result().digest == digest


def test_parquet_says_the_same_as_csv(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    columns = {
        "sender": ["r1", "r1", None, "r2", ""],
        "receiver": ["r2", "r2", None, "r1", ""],
        "lost": [True, False, False, False, True],
        "delay_s": [None, 0.2, 0.1, 0.3, float("nan")],
        "remark": [b"a", b"b", b"c", b"d", b"e"],
    }
    path = tmp_path / "trace.parquet"
    parquet.write_table(pyarrow.table(columns), path)
    same = written(tmp_path, PER_LINK)
    assert loss_of(path) == loss_of(same)
    assert delay_of(path) == delay_of(same)
    parquet.write_table(pyarrow.table({"lost": [0, 1, 3]}), path)
    assert "row 3, lost = 3" in refusal(path)
    parquet.write_table(pyarrow.table({"gone": [0, 1, 3]}), path)
    assert "no column 'lost'; its columns are gone" in refusal(path)
    parquet.write_table(pyarrow.table({"lost": [0] * (TRACE_ROWS_MAX + 1)}), path)
    assert f"{TRACE_ROWS_MAX + 1} rows" in refusal(path)


def test_a_small_parquet_file_does_not_become_a_huge_table(tmp_path):
    import pyarrow
    from pyarrow import parquet

    path = tmp_path / "trace.parquet"
    # One text of 64 KiB, 5,000 times.
    long = pyarrow.DictionaryArray.from_arrays([0] * 5_000, ["0" * 2**16])
    table = pyarrow.table({"lost": long.cast(pyarrow.string())})
    parquet.write_table(table, path, dictionary_pagesize_limit=2**20)
    assert path.stat().st_size < 2**16
    assert "lost: has a text of 65536 bytes, at most 64 may be" in refusal(path)
    parquet.write_table(table, path, use_dictionary=False)
    assert path.stat().st_size < 2**26
    assert "has 327700175 bytes to be read, at most 268435456 may be" in refusal(path)


def test_of_parquet_only_what_is_read_has_limits(tmp_path):
    import pyarrow
    from pyarrow import parquet

    path = tmp_path / "trace.parquet"
    payload = pyarrow.array([bytes(200_000)] * 2000)
    columns = {"lost": pyarrow.array(["0", "1"] * 1000, pyarrow.large_string())}
    parquet.write_table(
        pyarrow.table({**columns, "payload": payload}), path, use_dictionary=["lost"]
    )
    trace = read_trace(path)
    assert trace.rows == 2000
    assert rows_of(trace, "loss")["values"][:2] == [0, 1]


@pytest.mark.parametrize("text", ["string", "large_string"])
def test_long_texts_of_either_kind_are_refused(tmp_path, text):
    import pyarrow
    from pyarrow import parquet

    path = tmp_path / "trace.parquet"
    robots = pyarrow.array(["r" * 1000, "r1"], getattr(pyarrow, text)())
    parquet.write_table(pyarrow.table({"lost": [0, 1], "sender": robots}), path)
    assert "sender: has a text of 1000 bytes" in refusal(path)


def test_a_column_of_lists_or_of_a_name_that_another_has_is_refused(tmp_path):
    import pyarrow
    from pyarrow import parquet

    path = tmp_path / "trace.parquet"
    parquet.write_table(pyarrow.table({"lost": [[0], [1]]}), path)
    assert "lost: is of list" in refusal(path)
    two = [pyarrow.array([0, 1]), pyarrow.array([0, 1])]
    parquet.write_table(pyarrow.table(two, names=["lost", "lost"]), path)
    assert "two columns have one name" in refusal(path)


def test_without_pyarrow_parquet_is_refused_and_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    said = refusal(tmp_path / "trace.parquet")
    assert "needs pyarrow" in said
    assert loss_of(written(tmp_path, SAME)).values == (0, 1, 0)


CELLS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=5)


@settings(deadline=None, derandomize=True, max_examples=80)
@given(
    text=st.lists(
        st.sampled_from(["lost", "delay_s", "0", "1", "0.5", ",", ",,", "\n", '"', "r1"]) | CELLS,
        max_size=25,
    ).map("".join)
)
def test_whatever_is_in_a_file_it_is_taken_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_text(text, encoding="utf-8", newline="")
    for taken in (loss_of, delay_of):
        try:
            assert taken(path).model == "trace"
        except ScenarioError as error:
            assert "problem" in str(error)  # noqa: PT017
