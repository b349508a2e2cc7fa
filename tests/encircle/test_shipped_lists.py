"""Lists of what is shipped, read without the models: they say what the models say."""

import json
import sys

import pytest
from helpers_waiting import completed

from encircle.cli.main import main
from encircle.cli.shipped import Listed, listed_profiles, listed_scenarios, listed_studies
from encircle.studies.plan_files import load_plan, shipped_studies
from encircle.world.loading.files import shipped
from encircle.world.loading.load import load
from encircle.world.loading.profiles import profiles

HEAVY = ("numpy", "scipy", "pydantic", "pandas", "matplotlib", "rich", "zenoh", "mcap")


def test_scenarios_are_listed_as_they_are():
    scenarios = {name: load(name) for name in shipped()}
    expected = [Listed(name, len(s.ids), s.title) for name, s in scenarios.items()]
    assert listed_scenarios() == expected


def test_studies_are_listed_as_they_are():
    plans = {name: load_plan(name) for name in shipped_studies()}
    assert listed_studies() == [Listed(name, p.runs, p.title) for name, p in plans.items()]


def test_profiles_are_listed_as_they_are(capsys):
    titles = {name: profile.title for name, profile in profiles().items()}
    assert listed_profiles() == titles
    assert main(["scenarios", "--profiles"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [tuple(line.split(maxsplit=1)) for line in lines] == list(titles.items())
    assert main(["scenarios", "--profiles", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == titles


@pytest.mark.parametrize("command", [["scenarios"], ["scenarios", "--profiles"], ["study"]])
def test_a_list_waits_for_no_library(command):
    script = (
        "import sys; from encircle.cli.main import main;"
        f"status = main({command!r}); print(*sys.modules, file=sys.stderr); sys.exit(status)"
    )
    done = completed([sys.executable, "-c", script])
    assert done.returncode == 0
    assert set(HEAVY).isdisjoint(done.stderr.split())
