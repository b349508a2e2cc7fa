"""The tutorial notebook: its cells do what stands below them."""

import pytest

pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

from helpers_notebooks import executed, is_progress, lasting_outputs, tutorial


def test_executed_again_it_shows_what_it_shows():
    """To put it right: ``python tests/helpers/helpers_notebooks.py``."""
    stored = [lasting_outputs(cell) for cell in tutorial().cells]
    assert any(stored)
    anew = executed(tutorial())
    for k, cell in enumerate(anew.cells):
        assert lasting_outputs(cell) == stored[k], f"cell {k}"
    # The study takes seconds, so that its bar was seen; what is left of a bar is one line.
    outputs = [output for cell in anew.cells for output in cell.get("outputs", [])]
    bars = [output["data"]["text/html"] for output in outputs if is_progress(output)]
    assert any("two-policies: 48 runs" in bar for bar in bars)
    assert not any("<progress" in bar for bar in bars)


def test_what_is_kept_is_small_and_has_no_path_of_a_machine():
    """No memory addresses either, which ``text/plain`` of an object has."""
    text = str([lasting_outputs(cell) for cell in tutorial().cells])
    assert len(text) < 100_000
    assert "/tmp" not in text
    assert " at 0x" not in text
