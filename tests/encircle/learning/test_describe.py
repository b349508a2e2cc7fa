"""docs/learning.md: its tables are those of the code, and its program runs."""

import re

from helpers_paths import ROOT

from encircle.learning import Layout, Reward, describe

PAGE = (ROOT / describe.PAGE).read_text(encoding="utf-8")
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def test_the_page_is_current():
    assert describe.current(PAGE) == PAGE, "run python -m encircle.learning.describe --write"


def test_the_tables_hold_every_number_in_its_order():
    names = []
    for part in ("own", "target", "peer", "told", "scan"):
        names += re.findall(r"^\| `([\w{}]+)` \|", describe.sections()[part], re.M)
    own = Layout(1).size
    wanted = [*names[:own], *(f"peer1_{name}" for name in names[own:-1]), names[-1]]
    fields = [field.name for field in Layout(2, 1, 1).fields()]
    assert [name.format(0) for name in wanted] == fields


def test_the_page_says_how_many_numbers_a_team_of_four_has():
    assert f"= {Layout(4).size} numbers without payload and scan" in PAGE


def test_each_weight_of_the_reward_has_a_row():
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \| (.+) \|$", describe.sections()["reward"], re.M)
    assert [(name, float(default)) for name, default, _ in rows] == [
        (name, getattr(Reward(), name)) for name in Reward.__slots__
    ]


def test_the_first_program_comes_to_an_end(capsys):
    exec(compile(PROGRAMS[0], "docs/learning.md", "exec"), {})
    captured, digest = capsys.readouterr().out.split()
    assert captured in ("True", "False")
    assert len(digest) == 32
