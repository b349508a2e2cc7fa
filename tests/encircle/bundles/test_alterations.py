"""Whatever is altered in a bundle is found, also where the alteration is covered up."""

import base64
import io
import json
import math

import pytest
from helpers_bundles import (
    covered_up,
    csv_rows,
    members_of,
    verified,
    with_hashes,
    with_rows,
    written,
)
from PIL import Image

from encircle.bundles.bundle_file import MANIFEST, NUMBERS, PLAN, REPORT, TABLE, BundleError


def found_in(members, path, monkeypatch, rows=0):
    """(where, what, given, recomputed) of all that differs."""
    found = verified(written(members, path), monkeypatch, rows)
    assert found.count == len(found.differences)
    return [tuple(one) for one in found.differences]


@pytest.fixture
def members(bundle):
    return members_of(bundle)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "altered.zip"


def test_an_unaltered_bundle_agrees_and_all_its_rows_run_again(bundle, monkeypatch):
    found = verified(bundle, monkeypatch, None)
    assert (found.count, found.differences) == (0, [])
    assert found.numbers["rows"] == {"of": 8, "rerun": 8, "different": 0, "seed": 1}
    assert found.numbers["figures"]["different"] == 0 < found.numbers["figures"]["of"]
    # Nothing but the time that runs took is left unchecked.
    assert [line.partition(",")[0] for line in found.unchecked] == ["wall_s"]


@pytest.mark.parametrize("name", [PLAN, TABLE, NUMBERS, REPORT, "report/summary.csv"])
def test_a_member_that_is_altered_and_nothing_else_has_another_hash(
    members, path, monkeypatch, name
):
    members[name] = members[name].replace(b"loss", b"lost", 1)
    differences = found_in(members, path, monkeypatch)
    assert (name, "hash") in {one[:2] for one in differences}


def test_a_number_in_the_table_no_longer_fits_the_report(members, path, monkeypatch):
    def alter(rows):
        rows[2]["path_m_mean"] += 0.001

    differences = found_in(with_hashes(with_rows(members, alter)), path, monkeypatch)
    numbers = [one for one in differences if one[0] == NUMBERS]
    assert {one[1] for one in numbers} >= {"cells 0 means path_m_mean value"}
    value = next(one for one in numbers if one[1] == "cells 0 means path_m_mean value")
    # Of four runs, one is 1 mm longer.
    assert float(value[3]) - float(value[2]) == pytest.approx(0.00025)


def test_a_number_that_is_covered_up_is_found_by_running_the_row(
    members, path, monkeypatch, tmp_path
):
    def alter(rows):
        rows[5]["age_ticks_mean"] = math.nextafter(rows[5]["age_ticks_mean"], math.inf)

    covered = covered_up(with_rows(members, alter), tmp_path / "t")
    assert found_in(covered, path, monkeypatch) == []
    ((where, column, given, own),) = found_in(covered, path, monkeypatch, rows=None)
    assert (where, column) == ("row of cell 1, loss = 0.9, seed 2", "age_ticks_mean")
    assert float(given) == math.nextafter(float(own), math.inf)


def test_a_digest_is_found_by_running_the_row(members, path, monkeypatch, tmp_path):
    def alter(rows):
        rows[3]["digest"] = rows[2]["digest"]

    covered = covered_up(with_rows(members, alter), tmp_path / "t")
    ((where, column, _, _),) = found_in(covered, path, monkeypatch, rows=None)
    assert (where, column) == ("row of cell 0, loss = 0.0, seed 4", "digest")


def test_rows_of_two_seeds_that_were_swapped_are_found_by_running_them(
    members, path, monkeypatch, tmp_path
):
    def swap(rows):
        rows[0]["seed"], rows[1]["seed"] = 2, 1
        rows[:2] = rows[1::-1]

    covered = covered_up(with_rows(members, swap), tmp_path / "t")
    differences = found_in(covered, path, monkeypatch, rows=None)
    assert {one[0] for one in differences} == {
        "row of cell 0, loss = 0.0, seed 1",
        "row of cell 0, loss = 0.0, seed 2",
    }


def test_a_capture_that_was_made_up_cannot_be_summed_up(members, path, monkeypatch):
    def alter(rows):
        captured = next(row for row in rows if row["captured"])
        captured["captured"] = 0.0

    differences = found_in(with_hashes(with_rows(members, alter)), path, monkeypatch)
    assert any(one[0].startswith("report") for one in differences)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda rows: rows.pop(6), ("row of cell 1, loss = 0.9, seed 3", "missing", "a row")),
        (
            lambda rows: rows.insert(1, dict(rows[0])),
            ("row of cell 0, loss = 0.0, seed 1", "2 times", "once"),
        ),
        (
            lambda rows: rows.append({**rows[-1], "seed": 5}),
            (
                "row of cell 1, loss = 0.9, seed 5",
                "a row",
                "the plan has no such cell or seed",
            ),
        ),
        (
            lambda rows: rows.append({**rows[-1], "cell": 2}),
            ("row of cell 2, seed 4", "a row", "the plan has no such cell or seed"),
        ),
        (
            lambda rows: rows[4].update(loss=0.0),
            ("row of cell 1, loss = 0.9, seed 1", "0.0", "0.9"),
        ),
        (
            lambda rows: rows[4].update(code="c0de"),
            ("row of cell 1, loss = 0.9, seed 1", "c0de", None),
        ),
    ],
    ids=["removed", "doubled", "foreign seed", "foreign cell", "arm", "code"],
)
def test_rows_are_those_of_the_plan(members, path, monkeypatch, change, expected):
    altered = with_hashes(with_rows(members, change))
    differences = found_in(altered, path, monkeypatch)
    where, given, own = expected
    assert any(
        one[0] == where and one[2] == given and own in (None, one[3]) for one in differences
    ), differences


def test_a_seed_of_a_row_leaves_one_missing_and_one_foreign(members, path, monkeypatch):
    def alter(rows):
        rows[0]["seed"] = 99

    differences = found_in(with_hashes(with_rows(members, alter)), path, monkeypatch)
    rows = {one[0]: one[2] for one in differences if one[0].startswith("row")}
    assert rows == {
        "row of cell 0, loss = 0.0, seed 99": "a row",
        "row of cell 0, loss = 0.0, seed 1": "missing",
    }


def altered_numbers(members, change):
    tree = json.loads(members[NUMBERS])
    change(tree)
    members[NUMBERS] = json.dumps(tree).encode()
    return with_hashes(members)


def test_an_interval_of_the_report_is_computed_again(members, path, monkeypatch):
    def widen(tree):
        tree["cells"][1]["capture_rate"][2] += 1e-6

    ((where, what, _, _),) = found_in(altered_numbers(members, widen), path, monkeypatch)
    assert (where, what) == (NUMBERS, "cells 1 capture_rate high")


def test_a_test_of_a_comparison_is_computed_again(members, path, monkeypatch):
    def lower(tree):
        tree["comparisons"][0]["order"]["p_corrected"] *= 0.5

    ((where, what, _, _),) = found_in(altered_numbers(members, lower), path, monkeypatch)
    assert (where, what) == (NUMBERS, "comparisons 0 order p_corrected")


def test_the_last_bit_of_a_number_of_the_report_is_no_difference(members, path, monkeypatch):
    """Another processor may add in another order."""

    def nudge(tree):
        interval = tree["cells"][1]["capture_rate"]
        interval[2] = math.nextafter(interval[2], 2.0)

    assert found_in(altered_numbers(members, nudge), path, monkeypatch) == []


def test_a_sentence_of_the_page_is_made_again(members, path, monkeypatch):
    assert b"undecided" in members[REPORT]
    members[REPORT] = members[REPORT].replace(b"undecided", b"higher", 1)
    ((where, what, given, own),) = found_in(with_hashes(members), path, monkeypatch)
    assert where == REPORT
    assert what.startswith("line ")
    assert "higher" in given
    assert "undecided" in own


def test_the_command_on_the_page_follows_from_the_plan(members, path, monkeypatch):
    members[REPORT] = members[REPORT].replace(b"encircle study small", b"rm -r study small")
    ((where, _, given, own),) = found_in(with_hashes(members), path, monkeypatch)
    assert where == REPORT
    assert "rm -r" in given
    assert "encircle study small --seeds 4" in own


def test_a_cell_of_a_csv_file_is_named_with_its_line_and_column(members, path, monkeypatch):
    name = "report/summary.csv"
    rows = csv_rows(members[name])
    column = rows[0].index("capture_rate_low")
    rows[1][column] = "0.5"
    members[name] = "\r\n".join(map(",".join, [*rows, []])).encode()
    ((where, what, given, _),) = found_in(with_hashes(members), path, monkeypatch)
    assert (where, what, given) == (name, "line 2, capture_rate_low", "0.5")


def repainted(content, pixels=3):
    with Image.open(io.BytesIO(content)) as picture:
        picture = picture.convert("RGBA")
    for k in range(pixels):
        picture.putpixel((10 + k, 10), (255, 0, 0, 255))
    out = io.BytesIO()
    picture.save(out, "PNG")
    return out.getvalue()


def test_a_figure_is_drawn_again(members, path, monkeypatch):
    name = next(name for name in members if name.endswith(".png"))
    members[name] = repainted(members[name])
    ((where, _, given, _),) = found_in(with_hashes(members), path, monkeypatch)
    assert where == name
    assert given.startswith("3 of ")


def test_a_figure_with_the_same_pixels_in_other_bytes_is_the_same(members, path, monkeypatch):
    name = next(name for name in members if name.endswith(".png"))
    before = members[name]
    members[name] = repainted(before, 0)
    assert members[name] != before
    assert found_in(with_hashes(members), path, monkeypatch) == []


def test_a_figure_of_another_matplotlib_is_not_checked_and_that_is_said(members, path, monkeypatch):
    name = next(name for name in members if name.endswith(".png"))
    members[name] = repainted(members[name])
    tree = json.loads(members[MANIFEST])
    members[MANIFEST] = json.dumps(
        {**tree, "drawn_with": {"matplotlib": "1.0", "numpy": "1.0"}}
    ).encode()
    found = verified(written(with_hashes(members), path), monkeypatch)
    assert found.count == 0
    assert any(line.startswith(f"{name}: drawn by matplotlib 1.0") for line in found.unchecked)


def test_neither_is_one_in_the_page_of_another_matplotlib(members, path, monkeypatch):
    name = next(name for name in members if name.endswith(".png"))
    old, new = (base64.b64encode(c) for c in (members[name], repainted(members[name])))
    members[REPORT] = members[REPORT].replace(old, new)
    tree = json.loads(members[MANIFEST])
    tree["drawn_with"]["matplotlib"] = "1.0"
    members[MANIFEST] = json.dumps(tree).encode()
    found = verified(written(with_hashes(members), path), monkeypatch)
    assert found.count == 0
    assert any(line.startswith(f"{REPORT}, picture") for line in found.unchecked)


@pytest.mark.parametrize("name", ["report/figures/survival.png", "report/comparisons.csv"])
def test_a_part_of_the_report_that_is_missing_is_named(members, path, monkeypatch, name):
    del members[name]
    assert (name, "", "missing", "the report has it") in found_in(
        with_hashes(members), path, monkeypatch
    )


def test_a_figure_inside_the_page_is_compared_too(members, path, monkeypatch):
    """Whoever reads the page sees that one."""
    name = next(name for name in members if name.endswith(".png"))
    old, new = (base64.b64encode(c) for c in (members[name], repainted(members[name])))
    assert old in members[REPORT]
    members[REPORT] = members[REPORT].replace(old, new)
    ((where, what, given, _),) = found_in(with_hashes(members), path, monkeypatch)
    assert (where, what.split()[0]) == (REPORT, "picture")
    assert given.startswith("3 of ")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("study", "other"),
        ("fingerprint", "0" * 16),
        ("code", "0" * 16),
        ("versions", {"python": "2.7"}),
        ("cells", 3),
        ("seeds", 5),
        ("runs", 9),
        ("sample", {"seed": 0, "recordings": 1}),
        ("policies", ["policies/evil.py"]),
        ("more", 1),
    ],
)
def test_a_key_of_the_manifest_follows_from_the_rest(members, path, monkeypatch, key, value):
    tree = json.loads(members[MANIFEST])
    members[MANIFEST] = json.dumps({**tree, key: value}).encode()
    differences = found_in(members, path, monkeypatch)
    assert differences
    assert {one[0] for one in differences} <= {MANIFEST, *differences[0][:1]}


def test_a_plan_that_was_altered_has_another_fingerprint(members, path, monkeypatch):
    tree = json.loads(members[PLAN])
    tree["set"]["ticks_max"] = 60
    members[PLAN] = json.dumps(tree).encode()
    differences = found_in(with_hashes(members), path, monkeypatch)
    assert (MANIFEST, "fingerprint") in {one[:2] for one in differences}


def test_a_plan_that_was_altered_and_covered_up_gives_other_runs(
    members, path, monkeypatch, tmp_path
):
    tree = json.loads(members[PLAN])
    tree["set"]["team.jitter_m"] = 0.4
    members[PLAN] = json.dumps(tree).encode()
    covered = covered_up(members, tmp_path / "t")
    assert found_in(covered, path, monkeypatch) == []
    differences = found_in(covered, path, monkeypatch, rows=2)
    assert {one[1] for one in differences} >= {"digest"}
    assert len({one[0] for one in differences}) == 2


def test_a_broken_plan_or_table_is_a_difference(members, path, monkeypatch):
    for name, content in ((PLAN, b"{"), (TABLE, b"cell\n"), (PLAN, b"[" * 100_000)):
        altered = {**members, name: content}
        found = verified(written(altered, path), monkeypatch)
        assert found.count > 0
        assert any("cannot be read" in line for line in found.unchecked)


def test_a_file_that_is_cut_off_or_has_a_wrong_byte_is_no_whole_bundle(bundle, path, monkeypatch):
    content = bundle.read_bytes()
    path.write_bytes(content[:-100])
    with pytest.raises(BundleError, match="no whole bundle"):
        verified(path, monkeypatch)
    middle = bytearray(content)
    middle[len(content) // 2] ^= 0xFF
    path.write_bytes(middle)
    with pytest.raises(BundleError, match="no whole bundle"):
        verified(path, monkeypatch)
