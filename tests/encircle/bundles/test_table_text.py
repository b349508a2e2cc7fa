"""The table as text: every number comes back bit for bit, and nothing else is read."""

import struct
from math import inf, nan

import pytest
from helpers_bundles import TREE
from hypothesis import given
from hypothesis import strategies as st

from encircle.bundles import table_text as module
from encircle.bundles.bundle_file import BundleError
from encircle.bundles.table_text import columns_of, equal, read_table, table_text
from encircle.studies.plan_files import load_plan

PLAN = load_plan(TREE)
TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=30)


def row(**changes):
    return {
        "cell": 0,
        "loss": 0.0,
        "seed": 1,
        "digest": "ab",
        "captured": 1.0,
        "ticks": 7,
        "failed": "",
        "age_ticks_mean": nan,
        "path_m_mean": 1.5,
        "delay_s_mean": 0.1,
        "wall_s": 0.1,
        "code": "c0de",
        "versions": '{"python": "3.11"}',
        **changes,
    }


def bits(value):
    return struct.pack("<d", value) if isinstance(value, float) else value


@given(st.floats(allow_nan=False), st.integers(0, 2**63 - 1), TEXT)
def test_what_is_written_is_read_again_bit_for_bit(number, seed, text):
    written = row(path_m_mean=number, seed=seed, failed=text)
    (read,) = read_table(PLAN, table_text(PLAN, [written]).encode())
    assert list(read) == list(columns_of(PLAN))
    for name, value in written.items():
        assert type(read[name]) is type(value)
        assert bits(read[name]) == bits(value) or name == "age_ticks_mean"


def test_an_axis_of_names_stays_text():
    plan = load_plan({**TREE, "strategies": ["xi-star", "pursuit"]})
    text = table_text(plan, [row(strategy="pursuit")])
    assert read_table(plan, text.encode())[0]["strategy"] == "pursuit"


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("seed", "-1"),
        ("seed", "1.0"),
        ("seed", "٣"),
        ("seed", "1" * 5000),
        ("ticks", ""),
        ("cell", "0x1"),
        ("path_m_mean", "1_0"),
        ("path_m_mean", "NaN"),
        ("path_m_mean", "infinity"),
        ("path_m_mean", " 1"),
        ("path_m_mean", "1e9999"),
        ("path_m_mean", "one"),
        ("path_m_mean", ""),
    ],
)
def test_what_is_no_number_of_its_kind_is_refused_with_line_and_column(column, value):
    header, line = table_text(PLAN, [row()]).splitlines()
    cells = line.split(",", len(columns_of(PLAN)) - 1)
    cells[list(columns_of(PLAN)).index(column)] = value
    with pytest.raises(BundleError, match=f"line 2, {column} = "):
        read_table(PLAN, f"{header}\n{','.join(cells)}\n".encode())


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "no column cell"),
        (b"cell,seed\n", "no column loss"),
        (table_text(PLAN, []).replace("digest", "digest,more").encode(), "a column more"),
        (table_text(PLAN, []).replace("cell,loss", "loss,cell").encode(), "another order"),
        (table_text(PLAN, []).encode() + b"1,2\n", "2 values under 13 names"),
        (table_text(PLAN, []).encode() + b'"', "cannot be read"),
        (b"\xff", "cannot be read"),
        (table_text(PLAN, []).encode() + b"1" * 200_000, "cannot be read"),
    ],
)
def test_what_is_no_table_of_the_plan_is_refused(content, match):
    with pytest.raises(BundleError, match=match):
        read_table(PLAN, content)


def test_rows_have_a_limit(monkeypatch):
    monkeypatch.setattr(module, "ROWS_MAX", 2)
    text = table_text(PLAN, [row(seed=k) for k in (1, 2, 3)])
    with pytest.raises(BundleError, match="more than 2 rows"):
        read_table(PLAN, text.encode())


def test_undefined_numbers_are_equal_and_nothing_else_is_that_is_not():
    assert equal(nan, nan)
    assert equal(inf, inf)
    assert equal("a", "a")
    assert not equal(nan, 0.0)
    assert not equal(1.0, 1.0 + 2**-52)
