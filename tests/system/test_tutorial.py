"""docs/tutorial-policy.md: its files are written and its commands run, one after the other.

What a command prints is what stands below it, but for times and digests. The study has fewer seeds
here, so its numbers are others; of the containers it is looked at what the commands name.
"""

import re
import shlex
import sys
import tomllib
from pathlib import Path

import pytest
from helpers_commands import command
from helpers_paths import DOCS, ROOT
from helpers_waiting import completed

import encircle

PAGE = (DOCS / "tutorial-policy.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(console|python|toml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PROMPT = re.compile(r"^\[(\d+)\]\$ (.*)$", re.MULTILINE)
FILE = re.compile(r"# (\w+\.(?:py|toml))(, continued)?\n")
LEFT_OUT = "..."
FEW_SEEDS = "2"
TUNED_ON, TUNED_ON_FEW = "range(1, 21)", "range(1, 2)"
CONTAINERS = "docker compose up"


def commands_in(block):
    """(number, command, lines that it prints) of a block."""
    parts = PROMPT.split(block)[1:]
    return [
        (int(number), line, printed.strip("\n").split("\n") if printed.strip() else [])
        for number, line, printed in zip(parts[::3], parts[1::3], parts[2::3], strict=True)
    ]


COMMANDS = [
    c for kind, block in BLOCK.findall(PAGE) if kind == "console" for c in commands_in(block)
]


def write_file(folder, block):
    match = FILE.match(block)
    assert match, f"a block that does not begin with its file's name: {block[:60]!r}"
    file = folder / match[1]
    assert file.exists() == bool(match[2])
    before = file.read_text() + "\n\n" if match[2] else ""
    file.write_text(before + block)


def execute(folder, line):
    """What a command of the page prints; what is long is run with less."""
    words = shlex.split(line)
    if words[:2] == ["encircle", "study"]:
        words += ["--seeds", FEW_SEEDS]
    if words[0] == "encircle":
        done = command(*words[1:], folder=folder)
    else:
        if words[0] == "python":
            script = folder / words[1]
            script.write_text(script.read_text().replace(TUNED_ON, TUNED_ON_FEW))
            words[0] = sys.executable
        done = completed(words, cwd=folder)
    assert done.returncode == 0, f"{line}: {done.stderr}"
    return done.stdout.rstrip("\n").split("\n")


def without_numbers(line):
    return re.sub(r"[-+]?\d[\d.]*(?:e-\d+)?", "#", line)


def without_digest(line):
    return re.sub(r"\b[0-9a-f]{32}\b", "DIGEST", line).rstrip()


def assert_printed(line, told, printed):
    """That the lines of the page, with what was left out, are those that were printed."""
    if line.startswith("encircle run"):
        told, printed = ([without_digest(x) for x in lines] for lines in (told, printed))
    elif line.startswith("encircle study"):
        told = [x for x in told if x.startswith(("report ", "table "))]
        told = [LEFT_OUT, *told]
        assert len(told) > 1
    else:
        told, printed = ([without_numbers(x) for x in lines] for lines in (told, printed))
    pattern = "\n".join(".*" if x == LEFT_OUT else re.escape(x) for x in told)
    assert re.fullmatch(pattern, "\n".join(printed), re.DOTALL), f"{line}\n" + "\n".join(printed)


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """The folder of a reader who has done all that the page says, and what commands printed."""
    folder = tmp_path_factory.mktemp("gaps")
    printed = {}
    for kind, block in BLOCK.findall(PAGE):
        if kind != "console":
            write_file(folder, block)
            continue
        for number, line, _ in commands_in(block):
            if CONTAINERS not in line and line != "cd ..":
                printed[number] = execute(folder, line)
    return folder, printed


def test_commands_are_numbered():
    assert [number for number, _, _ in COMMANDS] == list(range(1, len(COMMANDS) + 1))


@pytest.mark.parametrize(("number", "line", "told"), COMMANDS, ids=[str(c[0]) for c in COMMANDS])
def test_a_command_prints_what_the_page_says(followed, number, line, told):
    _, printed = followed
    if number in printed:
        assert_printed(line, told, printed[number])
    else:
        assert told == []


def test_a_hunt_in_memory_and_one_over_zenoh_are_the_same(followed):
    digests = [re.search(r"[0-9a-f]{32}", "\n".join(followed[1][n]))[0] for n in (1, 2)]
    assert digests[0] == digests[1]
    told = [re.search(r"[0-9a-f]{32}", "\n".join(c[2]))[0] for c in COMMANDS[:2]]
    assert told[0] == told[1]


def test_a_study_with_another_baseline_runs_nothing_anew(followed):
    folder, printed = followed
    first, second = (n for n, line, _ in COMMANDS if line.startswith("encircle study"))
    runs = 12 * int(FEW_SEEDS)
    assert printed[first][0] == f"{runs} runs in 12 cells, {runs} of them now"
    assert printed[second][0] == f"{runs} runs in 12 cells, 0 of them now"
    assert tomllib.loads((folder / "gaps.toml").read_text())["baseline"] == "wide"


def test_files_that_the_page_names_are_there(followed):
    folder, _ = followed
    for file in set(re.findall(r"`(runs/[^`]+)`", PAGE)):
        assert (folder / file).is_file()
    for file in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", PAGE):
        assert (DOCS / file).is_file()


def test_containers_get_what_the_compose_file_takes(followed):
    folder, _ = followed
    (line,) = (line for _, line, _ in COMMANDS if CONTAINERS in line)
    settings = dict(word.split("=", 1) for word in shlex.split(line)[: -len(CONTAINERS.split())])
    compose = (ROOT / "docker-compose.yml").read_text()
    for name in settings:
        assert f"${{{name}:-" in compose
    assert "ENCIRCLE_POLICIES=/files" in (ROOT / "Dockerfile").read_text()
    assert Path(settings["ENCIRCLE_FILES"]).name == "gaps"
    file = folder / Path(settings["ENCIRCLE_SCENARIO"]).relative_to("/files")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        scenario = encircle.load(file, settings["ENCIRCLE_SET"].split(";"))
    assert scenario.team.strategy == "my_robots.py:gap"
    assert scenario.team.policy_parameters == {"aside": 0.95}
