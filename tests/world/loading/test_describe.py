"""docs/scenario.md: its tables are those of the declarations, and its examples can be run."""

import re
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel

from encircle.protocol.parameters import BODIES, Parameters, declared
from encircle.protocol.plugins import SHIPPED_POLICIES
from encircle.world.loading.declarations import field_docstrings, keys_of_model, tables_of
from encircle.world.loading.describe import PAGE, current, main, sections
from encircle.world.loading.load import load
from encircle.world.scenario.model import Scenario
from encircle.world.targets.behaviours import BUILT_IN

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / PAGE).read_text(encoding="utf-8")
BASE = {"team": {"robots": 4}}
EXAMPLES = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
UNITS = {
    "m": "_m", "s": "_s", "rad": "_rad", "ticks": "ticks", "tick": "tick", "m/s": "_mps",
    "m/s^2": "_mps2", "packets": "_packets", "packets/s": "packets_per_s", "B/s": "bytes_per_s",
    "m/sqrt(s)": "_m_per_sqrt_s", "dB": "_db",
}  # fmt: skip
NAMED_WITHOUT_UNIT = {"position", "positions", "waypoints", "values"}


def test_the_page_is_current():
    assert current(TEXT) == TEXT, "run python -m encircle.world.loading.describe --write"


def test_every_table_behaviour_and_parameter_is_described():
    names = {model.__name__ for model in tables_of(Scenario)}
    assert {"Scenario", "Obstacle", "Crash", "BurstLoss", "TraceDelay", "LinkOverride"} <= names
    names |= {"robot"} | {f"behaviour {name}" for name in BUILT_IN}
    assert set(sections()) == names | {f"policy {name}" for name in SHIPPED_POLICIES}
    for name in set(declared()) - set(BODIES):
        assert f"| `{name}` | " in sections()["robot"]


def test_each_key_stands_in_the_table_of_its_model_with_its_range_default_and_meaning():
    texts = sections()
    assert "| `noise_m_std` | number | m | from 0 to 100 | 0 | Standard" in texts["Sensing"]
    assert "| `radius_m` | number | m | above 0 to 100,000 | must be given |" in texts["Obstacle"]
    assert '| `motion` | text |  | `holonomic`, `unicycle` | `"holonomic"` |' in texts["Team"]
    assert "| `count` | whole number |  | from 2 |  | Robots that" in texts["Capture"]
    assert "| `robots` | whole number or table |  | from 1 to 256 |" in texts["Team"]
    assert "| `step_m_max` | number | m | above 0 to 100,000 |  | Its" in texts["RobotOverride"]
    assert "| `groups` | list of lists of text |" in texts["Partition"]
    assert "| `waypoints` | list of pairs of numbers | m |" in texts["behaviour patrol"]
    assert "| `window_ticks` | whole number | ticks | from 2 to 500 | 30 |" in texts["robot"]


def test_a_unit_is_the_one_in_the_name():
    rows = [row for text in sections().values() for row in re.findall(r"(?m)^\| `.*", text)]
    assert len(rows) > 100
    for row in rows:
        name, _type, unit = (cell.strip(" `") for cell in row.split("|")[1:4])
        if unit and name not in NAMED_WITHOUT_UNIT:
            assert UNITS[unit] in name, row
        endings = [ending for ending in UNITS.values() if ending[0] == "_"]
        if any(re.search(f"{ending}(_|$)", name) for ending in endings):
            assert unit, row


@pytest.mark.parametrize("text", EXAMPLES)
def test_an_example_is_a_scenario_that_can_be_run(text):
    tree = tomllib.loads(text)
    assert load({**BASE, **tree}).ids


def test_every_table_has_an_example():
    for name in sections():
        after = TEXT.split(f"<!-- keys of {name},")[1].split("<!-- end of keys -->\n")[1]
        assert after.lstrip().startswith("```toml"), name


def test_a_field_without_meaning_is_not_described():
    class Bare(BaseModel):
        """A table."""

        width_m: float

    with pytest.raises(TypeError, match="width_m: has no docstring"):
        keys_of_model(Bare)


def test_docstrings_are_read_for_every_parameter():
    assert set(field_docstrings(Parameters)) == set(declared())


def test_the_command_checks_and_writes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([]) == 1
    assert "docs/scenario.md" in capsys.readouterr().err
    PAGE.parent.mkdir()
    PAGE.write_text(TEXT.replace("Inner radius", "Outer radius"), encoding="utf-8")
    assert main([]) == 1
    assert "--write" in capsys.readouterr().err
    assert main(["--write"]) == main([]) == 0
    assert PAGE.read_text(encoding="utf-8") == TEXT
    assert main(["--read"]) == 2
    PAGE.write_text("# Nothing\n", encoding="utf-8")
    assert main(["--write"]) == 1
    assert "0 places for <!-- keys of Scenario" in capsys.readouterr().err
