"""A derandomised test is given the same values whatever was imported before it."""

import sys

from hypothesis import given, settings
from hypothesis import strategies as st

SOURCE = "NUMBERS = (0.1234567891, 98765.4321, 123.456, 0.000123321)\n"


def drawn() -> list[float]:
    found = []

    @settings(max_examples=200, derandomize=True, database=None)
    @given(st.floats(0.0, 1e6))
    def draw(value: float) -> None:
        found.append(value)

    draw()
    return found


def test_what_is_imported_in_between_changes_no_draw(tmp_path, monkeypatch):
    before = drawn()
    (tmp_path / "full_of_numbers.py").write_text(SOURCE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    __import__("full_of_numbers")
    try:
        assert drawn() == before
    finally:
        del sys.modules["full_of_numbers"]
