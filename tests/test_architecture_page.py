"""The map of rooms in docs/architecture.md is that of the folders."""

import re

import pytest
from helpers_paths import ROOT

PACKAGES = ("agents", "encircle", "protocol", "world")
FILES_MAX = 16
PAGES = sorted((ROOT / "docs").rglob("*.md")) + sorted(ROOT.glob("*.md"))
FOLDERS = "|".join((*PACKAGES, "tests", "bench", "docs"))
PATH = re.compile(rf"`((?:{FOLDERS})/[\w/-]+\.(?:py|md|toml|yml|json))`")


def rooms():
    """Every folder of code, as the page writes it. ``encircle/agents`` and the like are links."""
    for package in PACKAGES:
        for path in [ROOT / package, *(ROOT / package).rglob("*")]:
            through_link = any(
                (ROOT / "encircle" / name) in (path, *path.parents) for name in PACKAGES
            )
            if (path / "__init__.py").exists() and not through_link:
                yield f"{path.relative_to(ROOT)}/"


def test_every_room_has_a_line_and_every_line_a_room():
    text = (ROOT / "docs" / "architecture.md").read_text().split("## Rooms")[1].split("\n## ")[0]
    lines = re.findall(r"^\| `([\w/]+/)` \| [^|]+ \| [^|]+ \|$", text, re.MULTILINE)
    bare = {room for room in rooms() if not holds_modules(room)}
    assert sorted(lines) == sorted(set(rooms()) - bare)


def holds_modules(room):
    names = {path.name for path in (ROOT / room).glob("*.py")}
    return bool(names - {"__init__.py", "__main__.py"})


@pytest.mark.parametrize("room", sorted(rooms()))
def test_no_room_is_too_full(room):
    modules = [path for path in (ROOT / room).glob("*.py") if path.name != "__init__.py"]
    assert len(modules) <= FILES_MAX


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_a_page_names_are_there(page):
    """The changelog tells of what was."""
    named = PATH.findall(page.read_text()) if page.name != "CHANGELOG.md" else []
    assert [name for name in named if not (ROOT / name).exists()] == []
