"""The log for strangers' messages ends, and says so."""

import pytest

from encircle.protocol.process.log import LINES_MAX, bounded_log


def lines_logged(capsys, log, count):
    for number in range(count):
        log(f"line {number}")
    captured = capsys.readouterr()
    assert captured.out == "", "standard output belongs to results"
    return captured.err.splitlines()


@pytest.mark.parametrize("limit", [1, 3, LINES_MAX])
def test_as_many_lines_as_allowed_are_shown_then_one_that_says_so_then_none(capsys, limit):
    shown = lines_logged(capsys, bounded_log(limit), 4 * limit)
    assert shown[:limit] == [f"line {number}" for number in range(limit)]
    assert len(shown) == limit + 1
    assert "not shown" in shown[-1]


def test_below_the_limit_nothing_is_said_about_it(capsys):
    assert lines_logged(capsys, bounded_log(5), 4) == [f"line {number}" for number in range(4)]


def test_the_default_limit_is_the_named_one(capsys):
    assert len(lines_logged(capsys, bounded_log(), LINES_MAX + 10)) == LINES_MAX + 1


def test_logs_count_for_themselves(capsys):
    first, second = bounded_log(1), bounded_log(1)
    lines_logged(capsys, first, 3)
    assert lines_logged(capsys, second, 1)[0] == "line 0"
