"""What docs/protocol.md says of the wire, against the code: bytes, digest, limits and the robot.

The page's own programs are taken out of it and run, so they cannot fall behind.
"""

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import encircle
from encircle.launch import free_endpoint
from protocol import VERSION
from protocol.codec import BYTES_MAX
from protocol.lanes import GATE, ROOM, ROUND, SHOWN, SURE
from protocol.lockstep import TABLE, Move, Phase
from protocol.security import configuration_file

PAGE = (Path(__file__).parents[1] / "docs" / "protocol.md").read_text(encoding="utf-8")
END_S_MAX = 60.0
HEX_COLUMNS = 47


def section(title):
    """The text under a heading, up to the next of its level."""
    return PAGE.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]


def program(title):
    return re.search(r"```python\n(.*?)```", section(title), re.DOTALL)[1]


def test_the_page_is_of_this_version_and_its_limits_are_the_codecs():
    assert f"It describes version {VERSION}," in PAGE
    rows = re.findall(r"^\| (\w+) \| ([\d,]+) \|$", section("Messages"), re.MULTILINE)
    limits = {kind: int(size.replace(",", "")) for kind, size in rows}
    assert limits == {kind.__name__: size for kind, size in BYTES_MAX.items()}


@pytest.mark.parametrize("kind", BYTES_MAX, ids=lambda kind: kind.__name__)
def test_every_field_has_its_row_in_the_order_of_the_wire(kind):
    text = re.search(rf"\n### {kind.__name__}\n(.*?)(\n### |\Z)", section("Messages"), re.DOTALL)[1]
    rows = re.findall(r"^\| (`.*?) \|", text, re.MULTILINE)
    named = [name.strip("`") for row in rows for name in row.split(", ")]
    assert named == list(kind.__slots__)


def test_the_table_of_a_round_is_the_codes():
    header, _, *rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in section("A round").split("\n### ")[0].splitlines()
        if line.startswith("|")
    ]
    printed = {
        (Phase(row[0]), Move(move)): Phase(after)
        for row in rows
        for move, after in zip(header[1:], row[1:], strict=True)
        if after
    }
    assert printed == TABLE


def test_the_rules_on_lanes_are_those_of_the_code():
    printed = json.loads(re.search(r"```json\n(.*?)```", section("Session"), re.DOTALL)[1])
    assert printed == json.loads(configuration_file(ROOM | GATE))
    rows = re.findall(r"^\| (\w+) \|[^|]*\| `(\w+)` \|", section("Session"), re.MULTILINE)
    assert rows == [("round", ROUND), ("sure", SURE), ("shown", SHOWN)]


def test_the_round_in_bytes_is_what_its_program_prints(capsys):
    exec(program("A round in bytes"), {})
    sent = {line.split(" ", 2)[2] for line in capsys.readouterr().out.splitlines()}
    text = section("A round in bytes")
    blocks = re.findall(r"```\n(.*?)```", text, re.DOTALL)
    printed = [" ".join(line[:HEX_COLUMNS].strip() for line in b.splitlines()) for b in blocks]
    assert len(printed) == 8
    for line in printed:
        assert line in sent
        assert len(bytes.fromhex(line)) in map(int, re.findall(r"(\d+) bytes", text))


@pytest.mark.parametrize(
    "changes",
    [
        [],
        ['channel.loss={model="bernoulli",rate=0.3}', "robot.detections=relay"],
        ["robot.publish=event", "robot.detections=relay", "seed=7", "title=Another"],
        ["robot.publish_every_ticks=3", "ticks_max=20", "sensing.noise_m_std=0.05"],
        ["robot.publish_every_ticks=2", "channel.duplication.rate=0.5"],
    ],
    ids=["plain", "relayed", "event", "third", "copied"],
)
def test_the_digest_of_a_recording_is_the_one_its_program_prints(
    changes, tmp_path, monkeypatch, capsys
):
    hunt = encircle.run("sim1", link="memory", out=tmp_path / "run", overrides=changes)
    (tmp_path / "digest.py").write_text(program("The digest"))
    monkeypatch.setattr(sys, "argv", ["digest.py", str(tmp_path / "run" / "recording.mcap")])
    runpy.run_path(str(tmp_path / "digest.py"), run_name="__main__")
    assert capsys.readouterr().out.strip() == hunt.digest


def test_the_whole_robot_of_the_page_takes_part_in_a_hunt(tmp_path):
    script = tmp_path / "my_robot.py"
    script.write_text(program("A whole robot"))
    endpoint = free_endpoint()
    world = subprocess.Popen(
        [
            *(sys.executable, "-m", "world", "sim1", "--listen", endpoint, "--run", "demo"),
            *("--set", "ticks_max=40", "--json"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    robots = [
        subprocess.Popen(
            [sys.executable, "-m", "agents", f"r{k}", "--connect", endpoint, "--run", "demo"],
            stderr=subprocess.DEVNULL,
        )
        for k in (1, 2, 3)
    ]
    robots.append(
        subprocess.Popen(
            [sys.executable, str(script), "r4", "demo", endpoint], stdout=subprocess.DEVNULL
        )
    )
    try:
        out, _ = world.communicate(timeout=END_S_MAX)
        statuses = [robot.wait(timeout=END_S_MAX) for robot in robots]
    finally:
        for process in (world, *robots):
            process.kill()
            process.wait()
    result = next(
        report["result"] for report in map(json.loads, out.splitlines()) if "result" in report
    )
    assert result["refused"] == {}
    assert result["ended"] in ("captured", "ticks")
    assert statuses == [0] * 4
