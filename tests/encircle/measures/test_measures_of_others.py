"""Measures as plug-ins: found by entry point, measured in studies, named in full when they fail."""

import re
import subprocess
import sys
import tomllib
from math import isnan

import pytest
from helpers_measures import standing
from helpers_paths import DOCS, ROOT
from helpers_plugins import forget, make_importable, put_there

from encircle.measures.registry import MEASURES, REGISTRY, measure, measure_named
from encircle.protocol.plugins import MEASURES_GROUP, PluginFailed, PluginLoadError
from encircle.studies.plan import StudyError
from encircle.studies.plan_files import load_plan
from encircle.studies.running import run_seed
from encircle.studies.sources import code, versions
from encircle.studies.tasks import Task
from encircle.world.loading.load import load

MODULE = """
from encircle.measures.common import in_unit


@in_unit("m")
def farthest_m_max(log):
    \"\"\"The largest distance of a robot from the origin.

    Over robots and ticks.
    \"\"\"
    return float((log.robots**2).sum(axis=-1).max() ** 0.5)


def nothing(log):
    return float("nan")


def fails(log):
    raise KeyError("no such thing")


def leaves(log):
    raise SystemExit("enough")


def text(log):
    return "3"


def endless(log):
    return float("inf")


number = 3
"""
NAMES = ("farthest_m_max", "nothing", "fails", "leaves", "text", "endless", "number")
ENTRIES = [f"measures {name} = yardsticks:{name}" for name in NAMES]
ENTRIES += ["measures absent = no_such_module:measure", "measures captured = yardsticks:nothing"]


@pytest.fixture
def others(tmp_path, monkeypatch):
    folder = put_there(tmp_path, {"yardsticks.py": MODULE}, ENTRIES)
    make_importable(folder, monkeypatch)
    yield folder
    measure_named.cache_clear()
    forget(folder)


def test_the_shipped_measures_are_the_declared_entry_points():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    declared = project["project"]["entry-points"][MEASURES_GROUP]
    assert list(declared) == list(MEASURES)
    for name, value in declared.items():
        function = measure_named(name).function
        assert value == f"{function.__module__}:{function.__name__}"


def test_a_measure_of_another_package_is_measured(others):
    log = standing(5)
    (value,) = measure(log, ["farthest_m_max"]).values()
    assert value == pytest.approx((log.robots**2).sum(axis=-1).max() ** 0.5)
    found = measure_named("farthest_m_max")
    assert (found.unit, found.description) == (
        "m",
        "The largest distance of a robot from the origin.",
    )
    assert isnan(measure(log, ["nothing"])["nothing"])
    assert (measure_named("nothing").unit, measure_named("nothing").description) == ("1", "")


def test_the_measure_in_the_documentation_can_be_had(tmp_path, monkeypatch):
    text = (DOCS / "measures.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"```python\n(# my_measures\.py\n.*?)```", text, re.DOTALL)
    (entry,) = re.findall(r'(?m)^target_path_m = "(.*)"$', text)
    entries = [f"measures target_path_m = {entry}"]
    make_importable(put_there(tmp_path, {"my_measures.py": source}, entries), monkeypatch)
    assert measure(standing(3), ["target_path_m"]) == {"target_path_m": 0.0}
    assert measure_named("target_path_m").unit == "m"
    measure_named.cache_clear()
    forget(tmp_path)


def test_by_default_the_shipped_ones_alone_are_measured_and_they_come_first(others):
    log = standing(5)
    assert list(measure(log)) == list(MEASURES)
    assert measure(log, ["captured"]) == {"captured": 0.0}
    assert REGISTRY.names()[: len(MEASURES)] == list(MEASURES)
    assert set(NAMES) < set(REGISTRY.names())


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("fails", "KeyError: 'no such thing'"),
        ("leaves", "SystemExit: enough"),
        ("text", "answered '3': must be a finite number, or NaN"),
        ("endless", "answered inf: must be a finite number, or NaN"),
    ],
)
def test_a_measure_that_fails_is_named_in_full(others, name, reason):
    with pytest.raises(PluginFailed) as caught:
        measure(standing(5), ["captured", name])
    whole = f"measure '{name}' (yardsticks:{name} of strangers 1.0) failed: {reason}"
    assert str(caught.value).startswith(whole)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("absent", "no_such_module:measure of strangers 1.0 cannot be loaded: ModuleNotFoundError"),
        ("number", "yardsticks:number of strangers 1.0 is int, must be a function"),
        ("farthest_m", "unknown measure (did you mean 'farthest_m_max'?); known are: "),
    ],
)
def test_a_measure_that_cannot_be_had_is_refused_before_a_run(others, name, reason):
    with pytest.raises(ValueError, match="measure") as caught:
        measure(standing(5), [name])
    assert f"measure '{name}': {reason}" in str(caught.value)
    with pytest.raises(StudyError) as caught:
        load_plan({"scenario": "sim1", "measures": [name]})
    assert f"measures: '{name}': {reason}" in str(caught.value)
    with pytest.raises((PluginLoadError, ValueError)):
        measure_named(name)


def test_a_study_counts_the_source_of_its_measures(others):
    plan = load_plan({"scenario": "sim1", "measures": ["captured", "farthest_m_max"]})
    used = ((MEASURES_GROUP, "farthest_m_max"),)
    assert plan.plugins == used
    assert load_plan({"scenario": "sim1", "measures": ["captured"]}).plugins == ()
    before = code(used)
    assert before != code()
    assert versions(used)["strangers"] == "1.0"
    (others / "yardsticks.py").write_text(MODULE + "\n# another", encoding="utf-8")
    assert code(used) != before


def test_a_column_of_a_study_is_no_axis(others):
    tree = {"scenario": "sim1", "measures": ["farthest_m_max"]}
    axis = {"name": "farthest_m_max", "key": "ticks_max", "values": [2]}
    with pytest.raises(StudyError, match=r"axes\.0\.name = 'farthest_m_max': is a column"):
        load_plan({**tree, "axes": [axis]})


def test_a_run_whose_measure_fails_is_a_failed_row_of_the_study(others):
    task = Task(0, {}, "", (1,), ("captured", "fails"), ((MEASURES_GROUP, "fails"),))
    row = run_seed(task, load("sim1", ["ticks_max=2"]), 1, ("code", "{}"))
    assert row["failed"].startswith("measure 'fails' (yardsticks:fails of strangers 1.0) failed: ")
    assert "no such thing" in row["trace"]
    assert "yardsticks.py" in row["trace"]


def test_names_are_listed_without_what_measuring_needs():
    program = (
        "import sys\n"
        "from encircle.measures.registry import MEASURES, REGISTRY\n"
        "assert REGISTRY.names() and REGISTRY.problem_with('captured') == ''\n"
        "print(len(MEASURES), 'scipy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.split() == [str(len(MEASURES)), "False"]
