"""The report's numbers as data: those of the summary, whole, and as JSON can hold them."""

import csv
import json
from contextlib import closing
from math import isnan

import numpy as np
import pytest
from helpers_studies import ARMS, LOSS, filled, loss_only, never, study_plan

from encircle.statistics.intervals import wilson_interval
from encircle.studies.csv_files import write_cells, write_comparisons
from encircle.studies.report.numbers import report_numbers
from encircle.studies.report.sentences import summary_sentences
from encircle.studies.summary import summarise


def numbers_of(plan, folder, truth=loss_only):
    with closing(filled(plan, folder, truth)) as table:
        summary = summarise(plan, table)
    tree = report_numbers(summary)
    # As it is written: nothing that is not JSON.
    return summary, json.loads(json.dumps(tree, allow_nan=False))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    plan = study_plan(axes=[LOSS], strategies=["xi-star", "xi-0", "xi-1"], seeds=20)
    return numbers_of(plan, tmp_path_factory.mktemp("numbers"))


def same(text, number):
    """Whether a number of a CSV file is one of these, rounded."""
    if number is None:
        return isnan(float(text))
    return float(text) == pytest.approx(float(number), rel=1e-9)


def lines_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_cell_has_the_numbers_of_its_line_in_the_csv_file(made, tmp_path):
    summary, tree = made
    write_cells(summary, tmp_path / "cells.csv")
    lines = lines_of(tmp_path / "cells.csv")
    assert len(lines) == len(tree["cells"]) == 15
    for line, cell in zip(lines, tree["cells"], strict=True):
        intervals = {key: cell[key] for key in ("capture_rate", "time_s_restricted")}
        intervals |= cell["means"]
        for name, interval in intervals.items():
            for end, number in zip(("", "_low", "_high"), interval, strict=True):
                assert same(line[f"{name}{end}"], number), (name, end)
        assert same(line["median_s"], cell["survival"]["median_s"])


def test_every_comparison_has_the_numbers_of_its_line_in_the_csv_file(made, tmp_path):
    summary, tree = made
    write_comparisons(summary, tmp_path / "c.csv")
    lines = lines_of(tmp_path / "c.csv")
    ones = [*tree["comparisons"], *tree["overall"]]
    assert len(lines) == len(ones) == 12
    columns = {"rate": "capture_rate", "order": "later_less_earlier", "time_s": "time_s_restricted"}
    for line, one in zip(lines, ones, strict=True):
        for outcome, column in columns.items():
            test = one[outcome]
            numbers = [*test["difference"], test["p"], test["p_corrected"]]
            for end, number in zip(
                ("difference", "low", "high", "p", "p_corrected"), numbers, strict=True
            ):
                assert same(line[f"{column}_{end}"], number)
            assert line[f"{column}_decision"] == test["decision"]


def test_a_capture_rate_has_wilsons_interval(made):
    summary, tree = made
    for cell, captured in zip(tree["cells"], summary.captured, strict=True):
        assert cell["capture_rate"] == list(wilson_interval(captured.mean(), captured.size))


def test_sentences_and_tolerances_are_those_of_the_page(made):
    summary, tree = made
    assert tree["sentences"] == summary_sentences(summary)
    assert [one["others"]["strategy"] for one in tree["tolerances"]] == ["xi-star", "xi-0", "xi-1"]


def test_what_is_undefined_or_open_is_said_in_words_that_json_has(tmp_path):
    _, tree = numbers_of(study_plan(axes=[LOSS], seeds=10), tmp_path / "never", never)
    assert tree["cells"][0]["means"]["capture_s"] == [None, None, None]
    assert {one["level"][1] for one in tree["tolerances"]} == {"-inf"}
    assert tree["cells"][0]["survival"]["median_s"] is None


def test_a_study_of_names_has_levels_as_text(tmp_path):
    _, tree = numbers_of(study_plan(axes=[ARMS], seeds=4), tmp_path / "arms")
    assert [cell["levels"]["radio"] for cell in tree["cells"]] == [a["name"] for a in ARMS["arms"]]
    assert tree["comparisons"] == tree["overall"] == []


def test_survival_never_rises(made):
    _, tree = made
    for cell in tree["cells"]:
        shares = [share for share, _, _ in cell["survival"]["free"]]
        assert np.all(np.diff(shares) <= 0.0)
        assert np.all(np.diff(cell["survival"]["time_s"]) > 0.0)
