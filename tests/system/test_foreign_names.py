"""A person's own files beside which a command is run: no process of ours imports any of them.

Every file notes that it was imported, and fails. Where Python itself looks first into the working
directory, before any code of ours runs, names of its own modules are not ours to protect: ``python
-c`` and ``python -m`` with a ``typing.py`` there end in Python's own start-up or in the import of a
package, whatever that is. So the script ``encircle`` is tried with all names, the others with those
that Python has by then.
"""

import json
import os
import sys
from pathlib import Path

import pytest
from helpers_paths import ROOT
from helpers_waiting import completed

OURS = ("agents", "world", "protocol", "encircle_test", "tests")
PYTHONS = ("types", "random", "typing", "json", "socket", "queue", "secrets", "signal", "struct")
LIBRARIES = ("numpy", "scipy", "filterpy", "pydantic", "zenoh", "msgpack", "pandas", "mcap")
FILE = """\
import os
with open({record!r}, "a") as record:
    record.write(f"{{__name__}} by process {{os.getpid()}}\\n")
raise ImportError("this is a person's own file")
"""
STUDY = """\
scenario = "sim2"
seeds = 2
[set]
ticks_max = 5
"channel.loss.model" = "bernoulli"
[[axes]]
name = "loss"
key = "channel.loss.rate"
values = [0.0, 0.5]
"""
SCRIPT = (str(Path(sys.executable).with_name("encircle")),)
MODULE = (sys.executable, "-m", "encircle")


class Folder:
    """A directory with a person's files of these names."""

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        self.path, self._record = path / "here", path / "record"
        self.path.mkdir()
        for name in names:
            (self.path / f"{name}.py").write_text(FILE.format(record=str(self._record)))
        (self.path / "tiny.toml").write_text(STUDY)

    def run(self, *command: str) -> str:
        """What a command prints that is run there, with nothing of the person's imported."""
        done = completed(command, cwd=self.path, env=os.environ | {"PYTHONPATH": str(ROOT)})
        imported = self._record.read_text() if self._record.exists() else ""
        assert imported == "", (command, imported)
        assert done.returncode == 0, done.stderr
        return done.stdout


@pytest.fixture
def folder(tmp_path):
    return Folder(tmp_path, OURS + PYTHONS + LIBRARIES)


@pytest.mark.parametrize("link", ["zenoh", "memory"])
def test_a_hunt(folder, link):
    done = json.loads(folder.run(*SCRIPT, "run", "sim1", "--link", link, "--json"))
    assert done["captured"]


@pytest.mark.parametrize("how", [("--workers", "2"), ("--link", "zenoh")], ids="-".join)
def test_a_study(folder, how):
    done = json.loads(folder.run(*SCRIPT, "study", "tiny.toml", *how, "--json"))
    assert (done["ran"], done["failed"]) == (4, 0)


def test_a_list(folder):
    assert folder.run(*SCRIPT, "scenarios").startswith("sim1")


def test_python_m_encircle_where_python_itself_has_started(tmp_path):
    names = ("random", "secrets", "queue", "struct", "socket", "json")
    folder = Folder(tmp_path, OURS + LIBRARIES + names)
    for link in ("zenoh", "memory"):
        done = json.loads(folder.run(*MODULE, "run", "sim1", "--link", link, "--json"))
        assert done["captured"]
    done = json.loads(folder.run(*MODULE, "study", "tiny.toml", "--workers", "2", "--json"))
    assert (done["ran"], done["failed"]) == (4, 0)


def test_importing_the_package(tmp_path):
    folder = Folder(tmp_path, (*OURS, *LIBRARIES, "random", "secrets", "queue", "json"))
    assert folder.run(sys.executable, "-c", "import encircle; print('here')") == "here\n"


def test_a_script_of_a_persons_own(tmp_path):
    folder = Folder(tmp_path, OURS)
    code = "import encircle; print(encircle.run('sim2', overrides=['ticks_max=3']).result.ticks)"
    assert folder.run(sys.executable, "-c", code) == "3\n"
    (folder.path / "mine.py").write_text(code)
    assert folder.run(sys.executable, "mine.py") == "3\n"


def test_what_a_person_puts_on_pythonpath_counts(tmp_path):
    """It is how plug-ins are found that are not installed."""
    folder = Folder(tmp_path, OURS)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "sitecustomize.py").write_text(
        f"import os\nopen({str(tmp_path / 'found')!r}, 'a').write(f'{{os.getpid()}}\\n')\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(mine)))}
    command = (*SCRIPT, "run", "sim2", "--set", "ticks_max=3", "--json")
    done = completed(command, cwd=folder.path, env=environment)
    assert done.returncode == 0, done.stderr
    # The command and the one from which nodes are forked.
    assert len((tmp_path / "found").read_text().split()) == 2
