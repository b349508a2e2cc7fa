"""The field tables of docs/protocol.md are those that the messages declare."""

import pytest
from helpers_paths import ROOT

from encircle.protocol import describe
from encircle.protocol.codec import BYTES_MAX
from encircle.protocol.messages import End

PAGE = (ROOT / describe.PAGE).read_text(encoding="utf-8")


def test_the_tables_of_the_page_are_current():
    assert describe.current(PAGE) == PAGE, "run python -m encircle.protocol.describe --write"


def test_a_table_has_a_row_for_each_field_with_its_type_unit_and_meaning():
    assert describe.table(End).splitlines()[2:4] == [
        "| `robot` | text |  | the robot this is for |",
        "| `tick` | count |  | the last tick |",
    ]


@pytest.mark.parametrize("kind", BYTES_MAX, ids=lambda kind: kind.__name__)
def test_a_row_that_is_missing_or_wrong_is_written_anew_and_the_rest_stays(kind):
    row = describe.table(kind).splitlines(keepends=True)[2]
    assert describe.current(PAGE.replace(row, "")) == PAGE
    assert describe.current(PAGE.replace(row, "| `colour` | text | | none |\n")) == PAGE


def test_a_page_without_a_place_for_a_table_is_refused():
    with pytest.raises(ValueError, match="0 places for <!-- fields of Setup"):
        describe.current("# The wire\n")


def test_the_command_checks_and_writes(tmp_path, monkeypatch, capsys):
    (tmp_path / "docs").mkdir()
    page = tmp_path / describe.PAGE
    monkeypatch.chdir(tmp_path)
    assert describe.main([]) == 1
    page.write_text(PAGE.replace("| `tick` | count |", "| `tock` | count |"), encoding="utf-8")
    assert describe.main([]) == 1
    assert describe.main(["--write"]) == 0
    assert page.read_text(encoding="utf-8") == PAGE
    assert describe.main([]) == 0
    assert describe.main(["--read"]) == 2
    assert "--write" in capsys.readouterr().err
