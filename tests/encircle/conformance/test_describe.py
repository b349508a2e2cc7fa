"""docs/policies.md: what a policy gets and answers, and those that ship, are those of the code."""

import re
from typing import NamedTuple

import pytest
from helpers_paths import ROOT

from encircle import Decision, Peer, View
from encircle.conformance import describe
from encircle.protocol.plugins import SHIPPED_POLICIES

PAGE = (ROOT / describe.PAGE).read_text(encoding="utf-8")
PARTS = describe.sections()


def test_the_page_is_current():
    assert describe.current(PAGE) == PAGE, "run python -m encircle.conformance.describe --write"


@pytest.mark.parametrize("cls", [View, Peer, Decision], ids=lambda cls: cls.__name__)
def test_each_field_has_a_row_in_its_order(cls):
    rows = re.findall(r"^\| `(\w+)` \| `(.+)` \| (.*) \| (.+) \|$", PARTS[cls.__name__], re.M)
    properties = [name for name, value in vars(cls).items() if isinstance(value, property)]
    assert [row[0] for row in rows] == [*cls._fields, *properties]
    assert {row[0] for row in rows if row[2].strip()} == set(cls._field_defaults)


def test_a_row_has_type_default_and_meaning():
    assert r"| `target` | `Estimate \| None` |  | The estimate of the target" in PARTS["View"]
    assert "| `last_step` | `Point` | `(0.0, 0.0)` | What it did" in PARTS["View"]
    assert "| `peers` | `tuple[Peer, ...]` |  | The peers that" in PARTS["View"]


def test_a_field_without_meaning_is_not_described():
    class Bare(NamedTuple):
        width_m: float

    with pytest.raises(TypeError, match=r"Bare\.width_m: has no docstring"):
        describe.fields_table(Bare)


def test_each_shipped_policy_has_a_row_with_parameters_payload_and_source():
    rows = dict(re.findall(r"^\| `(\S+)` \| (.+) \|$", PARTS["policies"], re.M))
    assert list(rows) == list(SHIPPED_POLICIES)
    _, own, said, source = rows["intents"].split(" | ")
    assert own == "[`reclaim_ticks`](scenario.md#strategy--intents)"
    # A map of two: its head, two texts of one byte more than their letters, two small numbers.
    assert said.endswith(f"; at most {1 + 1 + len('point') + 1 + 1 + len('points') + 1} B")
    assert source.endswith("[theory](../agents/policies/intents.py)")
    _, own, said, source = rows["pursuit"].split(" | ")
    assert (own, said) == ("none", "nothing")
    assert source == "our own, as a baseline; [theory](../agents/policies/paper.py)"


def test_where_a_row_leads_is_there():
    headings = re.findall(r"^#+ (.*)$", (ROOT / "docs/scenario.md").read_text(), re.M)
    anchors = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}
    assert set(re.findall(r"scenario\.md#([\w-]+)", PAGE)) <= anchors
    for file in re.findall(r"\]\(\.\./([^)#]+)", PAGE):
        assert (ROOT / file).is_file()


def test_the_first_sentence_ends_where_no_name_is_cut():
    text = "Theory.\n\nSource: A, B, New J. Phys. 19\n(2017) 053, arXiv 1.2. Other.\n\nMore."
    assert describe.sentence(text, "Source") == "A, B, New J. Phys. 19 (2017) 053, arXiv 1.2."
    assert describe.sentence(text, "Payload") == ""


def test_the_command_checks_and_writes(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(describe, "sections", lambda: PARTS)
    monkeypatch.chdir(tmp_path)
    page = tmp_path / describe.PAGE
    assert describe.main([]) == 1
    page.parent.mkdir()
    page.write_text(PAGE.replace("| `tick` | `int` |", "| `tock` | `int` |"), encoding="utf-8")
    assert describe.main([]) == 1
    assert "--write" in capsys.readouterr().err
    assert describe.main(["--write"]) == describe.main([]) == 0
    assert page.read_text(encoding="utf-8") == PAGE
