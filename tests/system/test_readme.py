"""The README's robot and target of one's own: its file is written, and its commands are run."""

import re
import shlex
import tomllib

import pytest
from helpers_commands import command
from helpers_paths import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
SECTION = TEXT.split("## A robot or a target of your own\n")[1].split("\n## ")[0]
COMMANDS = re.findall(r"^    \.venv/bin/encircle (.*)$", SECTION, re.MULTILINE)
(CODE,) = re.findall(r"```python\n# my_robots\.py\n(.*?)```", SECTION, re.DOTALL)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "my_robots.py").write_text(CODE, encoding="utf-8")
    return tmp_path


def test_the_commands_run_one_hunt_and_one_check():
    assert [shlex.split(line)[0] for line in COMMANDS] == ["run", "check-policy"]


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_does_what_it_should(folder, line):
    done = command(*shlex.split(line), folder=folder)
    assert done.returncode == 0, done.stderr
    if line.startswith("run"):
        assert "5 over Zenoh" in done.stdout
    else:
        lines = done.stdout.splitlines()
        assert lines[-1] == "all is well"
        assert {line.split()[0] for line in lines[:-1]} == {"ok"}


def test_entry_points_name_what_the_file_has():
    (text,) = re.findall(r"```toml\n(.*?)```", SECTION, re.DOTALL)
    project = tomllib.loads(text)
    (module,) = project["tool"]["setuptools"]["py-modules"]
    for group in project["project"]["entry-points"].values():
        for value in group.values():
            assert value.startswith(f"{module}:")
            assert f"\ndef {value.split(':')[1]}(" in CODE
