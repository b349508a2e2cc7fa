"""The digest of a study's code: every edit of code that runs changes it, and nothing else does."""

import shutil
import subprocess
import sys
from pathlib import Path

import helpers_plugins as plugins
import pytest

import encircle
from encircle.protocol.plugins import STRATEGIES, TARGETS
from encircle.studies import sources
from encircle.studies import tasks as work
from encircle.studies.plan import StudyError
from encircle.studies.running import run_task
from encircle.studies.workers import StudyFailed, _checked_rows

CHASE = ((STRATEGIES, "chase"),)
MODULE = "from helper_of_chase.deep import gain\n" + plugins.STRATEGY
FILES = {
    "chasers.py": MODULE,
    "helper_of_chase/__init__.py": "",
    "helper_of_chase/deep/__init__.py": "gain = 1.0\n",
    "helper_of_chase/deep/table.csv": "1,2\n",
    "unrelated_to_chase.py": "x = 1\n",
}


def installed_in(folder, monkeypatch, files=FILES, value="chasers:chase", version="1.0"):
    folder.mkdir(parents=True, exist_ok=True)
    plugins.put_there(folder, files, [f"strategies chase = {value}"], version=version)
    plugins.make_importable(folder, monkeypatch)
    return folder


@pytest.fixture
def folder(tmp_path, monkeypatch):
    result = installed_in(tmp_path / "here", monkeypatch)
    yield result
    plugins.forget(result)


@pytest.mark.parametrize("name", [name for name in FILES if "unrelated" not in name])
def test_an_edit_of_any_source_of_a_plug_in_shows(folder, name):
    before = sources.code(CHASE)
    path = folder / name
    path.write_text(path.read_text() + "\n")
    assert sources.code(CHASE) != before
    path.write_text(FILES[name])
    assert sources.code(CHASE) == before


def test_what_the_plug_in_does_not_import_does_not_show(folder):
    before = sources.code(CHASE)
    (folder / "unrelated_to_chase.py").write_text("x = 2\n")
    cached = folder / "helper_of_chase" / "deep" / "__pycache__"
    cached.mkdir()
    (cached / "table.cpython-311.pyc").write_bytes(b"other")
    (folder / "helper_of_chase" / ".hidden").write_text("other")
    assert sources.code(CHASE) == before


def test_a_renamed_helper_shows_though_no_byte_is_another(folder):
    before = sources.code(CHASE)
    (folder / "helper_of_chase" / "deep" / "table.csv").rename(
        folder / "helper_of_chase" / "deep" / "tables.csv"
    )
    assert sources.code(CHASE) != before


def test_what_moves_from_one_file_to_the_next_shows(folder):
    helper = folder / "helper_of_chase"
    (helper / "a.py").write_text("x = 1\ny = 2\n")
    (helper / "b.py").write_text("z = 3\n")
    before = sources.code(CHASE)
    (helper / "a.py").write_text("x = 1\n")
    (helper / "b.py").write_text("y = 2\nz = 3\n")
    assert sources.code(CHASE) != before


def test_a_new_version_shows(folder, monkeypatch):
    before = sources.code(CHASE)
    shutil.rmtree(folder / "strangers-1.0.dist-info")
    installed_in(folder, monkeypatch, version="1.1")
    assert sources.code(CHASE) != before
    assert sources.versions(CHASE)["strangers"] == "1.1"


def test_where_the_sources_lie_does_not_show(folder, tmp_path, monkeypatch):
    before = sources.code(CHASE)
    moved = tmp_path / "elsewhere" / "deeper"
    shutil.copytree(folder, moved)
    with monkeypatch.context() as changed:
        changed.setattr(sys, "path", [p for p in sys.path if p != str(folder)])
        installed_in(moved, changed)
        plugins.forget(folder)
        assert sources.code(CHASE) == before
        (moved / "helper_of_chase" / "deep" / "__init__.py").write_text("gain = 2.0\n")
        assert sources.code(CHASE) != before


def test_a_helper_that_is_missing_shows_once_it_is_there(folder):
    (folder / "chasers.py").write_text("import perhaps_there\n" + MODULE)
    before = sources.code(CHASE)
    (folder / "perhaps_there.py").write_text("")
    assert sources.code(CHASE) != before


def test_other_installed_packages_go_by_their_versions(folder):
    (folder / "chasers.py").write_text(
        "import rich.table\nimport os\nimport encircle.agents\n" + MODULE
    )
    result = sources.versions(CHASE)
    assert result["rich"]
    files = sources._plugin_sources(CHASE).files
    assert not any(name.startswith(("rich/", "os", "encircle")) for name in files)


def test_relative_and_late_imports_are_followed(folder):
    (folder / "chasers.py").write_text(
        plugins.STRATEGY + "\n\ndef later():\n    import helper_of_chase.deep as d\n    return d\n"
    )
    assert "helper_of_chase/deep/__init__.py" in sources._plugin_sources(CHASE).files


def test_only_what_a_study_uses_counts(folder):
    tree = {"scenario": "sim1", "seeds": 1, "set": {"ticks_max": 3}}
    assert encircle.study(tree).plan.plugins == ()
    used = encircle.study({**tree, "strategies": ["xi-0", "chase"]}).plan.plugins
    assert used == CHASE
    assert sources.code(()) != sources.code(CHASE)


def test_our_own_sources_count_however_deep_they_lie(tmp_path, monkeypatch):
    before = sources.code()
    package = tmp_path / "world"
    shutil.copytree(Path(sys.modules["encircle.world"].__file__).parent, package)
    result = dict(sources._own_files())
    assert "encircle.world/arena/engine.py" in result
    monkeypatch.setattr(sources, "find_spec", _found_in(package, sources.find_spec))
    assert sources.code() == before
    (package / "channel_rooms" / "deep").mkdir(parents=True)
    (package / "channel_rooms" / "deep" / "stage.py").write_text("x = 1\n")
    changed = sources.code()
    assert changed != before
    (package / "channel_rooms" / "deep" / "stage.py").write_text("x = 2\n")
    assert sources.code() not in (before, changed)


def _found_in(package, find_spec):
    from importlib.machinery import ModuleSpec

    def result(name):
        if name != f"encircle.{package.name}":
            return find_spec(name)
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = [str(package)]
        return spec

    return result


def test_everything_that_a_run_of_a_study_imports_of_ours_counts():
    """A process of its own imports the study's code and lists the imported modules."""
    lines = (
        "import sys, encircle; before = {*sys.modules}",
        "import encircle.studies.running, encircle.runlog.recorded_log",
        "new = {*sys.modules} - before",
        "print(*(m for m in new if m.split('.')[0] == 'encircle'))",
    )
    process = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True
    )
    files = (name.removesuffix(".py").removesuffix("/__init__") for name in sources._own_files())
    counted = {name.replace("/", ".") for name in files}
    # A run neither reads recordings nor computes digests of sources.
    left_out = {"encircle.studies", "encircle.studies.sources", "encircle.replay.replaying"}
    assert {*process.stdout.split()} - counted - left_out == set()


def test_a_study_does_not_mix_rows_of_an_edited_plug_in(folder, tmp_path):
    tree = {
        "scenario": "sim1",
        "seeds": 1,
        "strategies": ["chase"],
        "set": {"ticks_max": 3},
        "measures": ["captured"],
    }
    study = encircle.study(tree, tmp_path / "t")
    assert study.run(workers=1) == 1
    assert study.run(workers=1) == 0
    table_bytes = (tmp_path / "t" / "table.parquet").read_bytes()
    helper = folder / "helper_of_chase" / "deep" / "__init__.py"
    helper.write_text("gain = 1.5\n")
    with pytest.raises(StudyError, match=r"holds runs of code .* choose another --out"):
        study.run(workers=1)
    assert (tmp_path / "t" / "table.parquet").read_bytes() == table_bytes
    helper.write_text("gain = 1.0\n")
    assert study.run(workers=1) == 0


def test_a_worker_tells_what_it_has_imported_though_the_file_is_another_now(folder):
    study = encircle.study({"scenario": "sim1", "strategies": ["chase"], "set": {"ticks_max": 2}})
    plan = study.plan
    work.code_and_versions.cache_clear()
    task = work.Task(
        0,
        plan.levels(0),
        plan.scenario_of(0).model_dump_json(exclude_unset=True),
        (1,),
        ("captured",),
        plan.plugins,
    )
    first, rows = run_task(task)
    assert first == rows[0]["code"] == sources.code(CHASE)
    (folder / "chasers.py").write_text(MODULE + "\n")
    again, _ = run_task(task)
    assert again == first != sources.code(CHASE)
    with pytest.raises(StudyFailed, match=f"runs code {first}"):
        _checked_rows((again, rows), sources.code(CHASE))
    work.code_and_versions.cache_clear()


def test_a_target_of_another_package_counts_too(tmp_path, monkeypatch):
    folder = tmp_path / "targets"
    plugins.put_there(
        folder,
        {
            "drifters/__init__.py": "",
            "drifters/slow.py": "def drift(m, v):\n    return m, (0, 0)\n",
        },
        ["targets drift = drifters.slow:drift"],
    )
    plugins.make_importable(folder, monkeypatch)
    plan = encircle.study({"scenario": "sim1", "set": {"target.behaviour": "drift"}}).plan
    assert plan.plugins == ((TARGETS, "drift"),)
    before = sources.code(plan.plugins)
    (folder / "drifters" / "slow.py").write_text("def drift(m, v):\n    return m, (0, 1)\n")
    assert sources.code(plan.plugins) != before
    plugins.forget(folder)
