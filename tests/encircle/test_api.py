"""The names that ``encircle`` exports: each is there when it is used, and stands in docs/api.md."""

import re
import subprocess
import sys

import pytest
from helpers_waiting import completed
from signatures import ENTRY, PAGE, rewritten

import encircle

README = PAGE.parents[1] / "README.md"
LATE = {"numpy", "scipy", "zenoh", "pydantic", "matplotlib", "rich", "pandas"}


@pytest.mark.parametrize("name", encircle.__all__)
def test_every_name_is_there(name):
    assert getattr(encircle, name) is not None
    assert name in dir(encircle)


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        encircle.nothing  # noqa: B018


def test_every_name_has_one_entry_in_the_page_and_nothing_else_has():
    assert sorted(match[1] for match in ENTRY.finditer(PAGE.read_text())) == encircle.__all__


def test_every_name_stands_once_in_the_reference_that_the_site_has():
    reference = (PAGE.parent / "reference.md").read_text()
    assert (
        sorted(re.findall(r"^\.\. auto\w+:: encircle\.(\w+)$", reference, re.M)) == encircle.__all__
    )


def test_signatures_in_the_page_are_those_of_the_source():
    """To put them right: ``python tests/helpers/signatures.py``."""
    page = PAGE.read_text()
    assert page == rewritten(page)


@pytest.mark.parametrize("name", ["run", "resume", "load", "study"])
def test_the_page_names_every_error_that_a_docstring_names(name):
    errors = r"``(\w*(?:Error|Failed|Interrupted|Remark))``"
    raised = set(re.findall(errors, getattr(encircle, name).__doc__))
    assert raised
    entry = PAGE.read_text().split(f"### `{name}`")[1].split("\n### ")[0]
    assert {error for error in raised if f"`{error}`" not in entry} == set()
    assert raised <= set(encircle.__all__)


def test_what_a_script_catches_is_what_is_raised(tmp_path):
    with pytest.raises(encircle.ScenarioError):
        encircle.load("nowhere")
    with pytest.raises(encircle.StudyError):
        encircle.study("nowhere")
    with pytest.raises(encircle.RunDirectoryError):
        encircle.resume(tmp_path, link="memory")
    with pytest.warns(encircle.ScenarioRemark) as warned:
        encircle.run({"ticks_max": 1, "team": {"robots": 2}}, link="memory")
    scenario = encircle.load({"ticks_max": 1, "team": {"robots": 2}})
    assert [str(warning.message) for warning in warned] == encircle.remarks_on(scenario)


def test_the_package_by_itself_loads_nothing_heavy():
    code = "import sys, encircle; dir(encircle); print(*sys.modules)"
    done: subprocess.CompletedProcess[str] = completed([sys.executable, "-c", code])
    assert not LATE & set(done.stdout.split())


def test_the_readme_imports_only_what_is_exported():
    imported = re.findall(r"^from encircle import (.*)$", README.read_text(), re.MULTILINE)
    used = re.findall(r"\bencircle\.([a-z]\w*)\(|`encircle\.(\w+)`", README.read_text())
    names = {name.strip() for line in imported for name in line.split(",")}
    names |= {name for pair in used for name in pair if name}
    assert imported
    assert names - set(encircle.__all__) == set()
