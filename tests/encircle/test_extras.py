"""Packages of extras: the table is that of pyproject.toml; a missing one is told in one line."""

import re
import subprocess
import sys
import tomllib

import pytest
from helpers_paths import ROOT

from encircle.cli.main import main
from encircle.extras import PACKAGES, MissingExtra, missing_line, needing

EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
NAMES = {
    extra: {re.match(r"[\w-]+", line)[0] for line in lines}
    for extra, lines in EXTRAS.items()
    if extra != "docs"  # nothing of ours imports those
}
BROUGHT_ALONG = {"gymnasium": "pettingzoo"}
"""Packages that others depend on."""


def test_the_table_has_the_packages_of_all_extras():
    listed = {package.distribution for package in PACKAGES.values()}
    assert listed - BROUGHT_ALONG.keys() == set.union(*NAMES.values())
    for distribution, extra in PACKAGES.values():
        assert BROUGHT_ALONG.get(distribution, distribution) in NAMES[extra]


@pytest.mark.parametrize(
    ("module", "extra", "line"),
    [
        ("rerun", None, '--to it needs rerun-sdk: pip install "encircle[export]"'),
        ("rerun.blueprint", None, '--to it needs rerun-sdk: pip install "encircle[export]"'),
        ("pyarrow", "export", '--to it needs pyarrow: pip install "encircle[export]"'),
        ("PIL.Image", None, '--to it needs pillow: pip install "encircle[export]"'),
    ],
)
def test_what_is_missing_is_told_with_the_way_to_get_it(module, extra, line):
    with pytest.raises(MissingExtra) as raised, needing("--to it", extra):
        raise ModuleNotFoundError("no", name=module)
    assert str(raised.value) == line


def test_a_module_of_no_extra_is_somebody_elses_error():
    with pytest.raises(ModuleNotFoundError, match="no such"), needing("--to it"):
        raise ModuleNotFoundError("no such", name="my_own")
    assert missing_line(ModuleNotFoundError("no name")) is None


@pytest.mark.parametrize(
    ("module", "status", "said"),
    [
        ("tornado.web", 2, 'encircle: this command needs tornado: pip install "encircle[viewer]"'),
        ("rich", 2, "encircle: this command needs rich, which an image for nodes leaves out"),
    ],
)
def test_the_command_line_says_so_in_one_line(monkeypatch, capsys, module, status, said):
    def missing(_arguments, _program):
        raise ModuleNotFoundError("no", name=module)

    monkeypatch.setattr("encircle.cli.scenarios.main", missing)
    assert main(["scenarios"]) == status
    printed = capsys.readouterr()
    assert printed.err.startswith(said)
    assert printed.err.count("\n") == 1
    assert printed.out == ""


@pytest.mark.parametrize(
    ("words", "what"), [(["watch", "x"], "watch"), (["run", "sim1", "--watch"], "run --watch")]
)
def test_a_command_that_shows_a_page_says_so_before_anything(monkeypatch, capsys, words, what):
    monkeypatch.setitem(sys.modules, "bokeh.util.paths", None)
    assert main(words) == 2
    line = f'encircle: {what} needs bokeh: pip install "encircle[viewer]"\n'
    assert capsys.readouterr().err == line


def test_a_study_from_python_says_so_too():
    """In a fresh interpreter, where nothing of a study is loaded yet."""
    script = "import sys; sys.modules['pyarrow'] = None; import encircle; encircle.study('loss')"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stderr.splitlines()[-1].endswith(
        'MissingExtra: encircle.study needs pyarrow: pip install "encircle[studies]"'
    )
