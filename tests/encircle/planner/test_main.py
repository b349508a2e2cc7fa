"""The planner's command line: what it says and ends with when it is used wrongly."""

import pytest

from encircle.planner.__main__ import main


def test_a_study_that_is_not_there_is_bad_usage_in_a_line_that_names_it(capsys):
    assert main(["no-such-study"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("encircle.planner: study 'no-such-study' is neither a file nor")
    assert said.err.count("\n") == 1


def test_its_help_is_for_who_uses_it(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert "``" not in capsys.readouterr().out
