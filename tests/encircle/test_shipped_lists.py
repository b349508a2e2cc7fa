"""Lists of what is shipped, read without the models: they say what the models say."""

import sys

import pytest
from helpers_waiting import completed

from encircle.cli.shipped import Listed, listed_scenarios, listed_studies
from encircle.studies.plan_files import load_plan, shipped_studies
from encircle.world.loading.files import shipped
from encircle.world.loading.load import load

HEAVY = ("numpy", "scipy", "pydantic", "pandas", "matplotlib", "rich", "zenoh", "mcap")


def test_scenarios_are_listed_as_they_are():
    scenarios = {name: load(name) for name in shipped()}
    expected = [Listed(name, len(s.ids), s.title) for name, s in scenarios.items()]
    assert listed_scenarios() == expected


def test_studies_are_listed_as_they_are():
    plans = {name: load_plan(name) for name in shipped_studies()}
    assert listed_studies() == [Listed(name, p.runs, p.title) for name, p in plans.items()]


@pytest.mark.parametrize("command", ["scenarios", "study"])
def test_a_list_waits_for_no_library(command):
    script = (
        "import sys; from encircle.cli.main import main;"
        f"status = main([{command!r}]); print(*sys.modules, file=sys.stderr); sys.exit(status)"
    )
    done = completed([sys.executable, "-c", script])
    assert done.returncode == 0
    assert set(HEAVY).isdisjoint(done.stderr.split())
