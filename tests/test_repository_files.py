"""Files at the top of the repository that programs of other people read."""

import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

import pytest
import yaml
from helpers_paths import ROOT
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

DESCRIPTION = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = DESCRIPTION["project"]
MAKEFILE = (ROOT / "Makefile").read_text()
TARGETS = re.findall(r"^\.PHONY: (.*)$", MAKEFILE, re.MULTILINE)[0].split()


def test_the_citation_has_what_the_format_requires_and_is_of_this_version():
    """Citation File Format 1.2: these keys are required, and a reference needs three of them."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["cff-version"] == "1.2.0"
    assert citation["type"] in ("software", "dataset")
    assert str(citation["version"]) == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert all(
        reference.keys() >= {"type", "title", "authors"} for reference in citation["references"]
    )
    [paper] = citation["references"]
    assert paper["title"] in " ".join((ROOT / "docs" / "paper.md").read_text().split())


def test_hooks_before_a_commit_download_nothing():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    assert [repository["repo"] for repository in hooks["repos"]] == ["local"]
    commands = [hook["entry"] for repository in hooks["repos"] for hook in repository["hooks"]]
    checks = MAKEFILE.split("\ncheck: setup\n")[1].split("\n\n")[0]
    assert [command.replace(".venv", "$(VENV)").split()[0] for command in commands] == [
        line.split()[0] for line in checks.strip().splitlines()
    ]


def test_style_is_not_asked_of_a_persons_own_files(tmp_path):
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for name in ("my_robots.py", "own/robots.py", "world/arena/new.py", "tests/test_new.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    ruff = [sys.executable, "-m", "ruff", "check", "--no-cache", "--show-files", "."]
    done = subprocess.run(ruff, cwd=tmp_path, capture_output=True, text=True, check=True)
    judged = {str(Path(line).relative_to(tmp_path)) for line in done.stdout.splitlines()}
    assert judged == {"pyproject.toml", "world/arena/new.py", "tests/test_new.py"}


@pytest.mark.parametrize("target", TARGETS)
def test_every_target_says_at_the_top_of_the_makefile_what_it_does(target):
    assert f"\n{target}:" in MAKEFILE
    if target != "clean":
        assert re.search(rf"^# make {target} +\w", MAKEFILE, re.MULTILINE)
        assert f"make {target}" in (ROOT / "README.md").read_text()


def test_the_changelog_begins_with_what_is_not_released():
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert headings[1].split()[0] == PROJECT["version"]


def pins():
    """The version of each package in requirements.txt, by its name."""
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    found = dict(line.split("==") for line in lines if not line.startswith("#"))
    return {canonicalize_name(name): version for name, version in found.items()}


def test_everything_that_building_and_running_need_is_pinned():
    """`make setup` builds without isolation: what builds has to be pinned with the rest."""
    pinned = pins()
    extras = PROJECT["optional-dependencies"].values()
    needed = sum(extras, DESCRIPTION["build-system"]["requires"] + PROJECT["dependencies"])
    for requirement in map(Requirement, needed):
        version = pinned.get(canonicalize_name(requirement.name))
        assert version is not None, f"{requirement} is not in requirements.txt"
        assert requirement.specifier.contains(version), f"{requirement}: pinned is {version}"


@pytest.mark.parametrize("name", sorted(pins()))
def test_what_is_pinned_is_for_the_first_python_that_will_do(name):
    """A system's Python 3.11 may be an early one: Debian 12 has 3.11.2."""
    try:
        # A package may have put its own reader in place, which raises where Python's gives None.
        wanted = metadata(name).get("Requires-Python", "")
    except PackageNotFoundError:
        pytest.fail(f"{name} is pinned and not installed")
    first = PROJECT["requires-python"].removeprefix(">=") + ".0"
    assert SpecifierSet(wanted).contains(first), f"{name} needs Python {wanted}"
