"""What a person installs: a wheel with one name at top level, which runs as the repository does."""

import os
import shutil
import sys
import zipfile
from pathlib import Path

import pytest
from helpers_paths import ROOT
from helpers_waiting import completed

FILES = ("pyproject.toml", "README.md", "LICENSE")
FOLDERS = ("agents", "encircle", "protocol", "world")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Built from a copy, so that nothing is left in the repository."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in FILES:
        shutil.copy(ROOT / name, source / name)
    for name in FOLDERS:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=ignored)
    quiet = ("--quiet", "--disable-pip-version-check", "--no-build-isolation", "--no-deps")
    pip(source, "wheel", *quiet, "--wheel-dir", str(out), ".")
    (built,) = out.glob("*.whl")
    return built


def pip(folder, *arguments):
    done = completed([sys.executable, "-m", "pip", *arguments], cwd=folder)
    assert done.returncode == 0, done.stderr


def test_a_wheel_installs_encircle_and_nothing_else_at_top_level(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"encircle"}
    assert "encircle/py.typed" in names


def test_a_wheel_holds_every_module_and_every_shipped_file_once(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert len(names) == len(set(names))
    for folder in FOLDERS:
        below = "" if folder == "encircle" else "encircle/"
        for kind in ("*.py", "*.toml"):
            for path in (ROOT / folder).rglob(kind):
                assert f"{below}{path.relative_to(ROOT)}" in names


def test_what_is_installed_hunts_as_the_repository_does(wheel, tmp_path):
    place, here = tmp_path / "site", tmp_path / "here"
    here.mkdir()
    pip(here, "install", "--quiet", "--no-deps", "--target", str(place), str(wheel))
    code = (
        "import encircle; print(encircle.__file__);"
        "print(encircle.run('sim1', link='memory', overrides=['ticks_max=5']).digest)"
    )
    digests = []
    for path in (str(place), str(ROOT)):
        environment = os.environ | {"PYTHONPATH": path}
        done = completed([sys.executable, "-P", "-c", code], cwd=here, env=environment)
        assert done.returncode == 0, done.stderr
        file, digest = done.stdout.split()
        assert file.startswith(path)
        digests.append(digest)
    assert digests[0] == digests[1]


@pytest.mark.parametrize("name", ["agents", "protocol", "world"])
def test_the_folders_are_not_imported_by_their_own_names_unnoticed(name):
    code = f"import {name}"
    done = completed([sys.executable, "-c", code], cwd=ROOT)
    assert done.returncode == 1
    assert f"ImportError: the package is imported as encircle.{name}, not as {name}" in done.stderr
