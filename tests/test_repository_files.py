"""Files at the top of the repository that programs of other people read."""

import re
import tomllib

import pytest
import yaml
from helpers_paths import ROOT
from packaging.requirements import Requirement
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


def test_everything_that_building_and_running_need_is_pinned():
    """`make setup` builds without isolation: what builds has to be pinned with the rest."""
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    pins = dict(line.split("==") for line in lines if not line.startswith("#"))
    pinned = {canonicalize_name(name): version for name, version in pins.items()}
    extras = PROJECT["optional-dependencies"].values()
    needed = sum(extras, DESCRIPTION["build-system"]["requires"] + PROJECT["dependencies"])
    for requirement in map(Requirement, needed):
        version = pinned.get(canonicalize_name(requirement.name))
        assert version is not None, f"{requirement} is not in requirements.txt"
        assert requirement.specifier.contains(version), f"{requirement}: pinned is {version}"
