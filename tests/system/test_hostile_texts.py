"""Whatever comes over the wire, out of a file or from a plug-in is shown as visible characters.

The texts here clear the screen, set a window's title, add a line, turn the direction of reading and
look like Rich's marks. Every shell gets them in every place where a stranger can put them; what it
shows is read as it came.
"""

import ast
import json
import sys
import unicodedata
from contextlib import ExitStack
from pathlib import Path

import msgpack
import pytest
from helpers_agents import BODIES, TEAM
from helpers_paths import ROOT
from helpers_waiting import LONGEST_S
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Text

import encircle
from encircle.agents.brain.robot_core import RobotCore
from encircle.cli import display
from encircle.cli import main as cli
from encircle.cli.display import Display
from encircle.doctor import doctor
from encircle.figures.run_figures import draw_run
from encircle.live.rounds import Round
from encircle.live.scene_feed import SceneFeed
from encircle.live.updates import RunState
from encircle.network.transport_tables import plain_text
from encircle.protocol import VERSION
from encircle.protocol.codec import encode
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import End, Setup
from encircle.protocol.plugins import TARGET, TARGETS, PluginFailed
from encircle.protocol.process.log import bounded_log, printable, say, say_error
from encircle.protocol.programs import alive
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.queries import serve_queries
from encircle.protocol.zenoh.session import open_session
from encircle.runner.launch import free_endpoint
from encircle.studies.report import page
from encircle.world.arena.engine import build, initial, truth
from encircle.world.loading.load import load
from encircle.world.process.reports import json_reports
from encircle.world.recording.recorder import Recorder
from encircle.world.recording.run_directory import RECORDING

PACKAGES = ("agents", "encircle", "protocol", "world")
EVIL = "\x1b[2J\x1b]0;mine\x07\r\n\x9b31m[red]\N{RIGHT-TO-LEFT OVERRIDE}[/red]\x00\u2028 \x7f"
PIECE = EVIL.replace("/", "")
"""As a part of a key."""
RUN = "faulty"
BRIEF = {"ticks_max": 3, "team": {"robots": 4}, "target": {"behaviour": "still"}}


def assert_clean(text: str) -> None:
    """Nothing in it but characters that can be seen, and ends of lines."""
    for line in text.split("\n"):
        assert all(c.isprintable() or unicodedata.category(c) == "Zs" for c in line), ascii(line)


@given(st.text())
@settings(max_examples=200, deadline=None, derandomize=True)
def test_what_is_shown_can_be_seen_and_what_can_be_seen_is_shown_as_it_is(text):
    shown = printable(text)
    assert all(c.isprintable() or unicodedata.category(c) == "Zs" for c in shown)
    assert printable(shown) == shown
    if text.isprintable():
        assert shown == text


def test_every_character_that_controls_is_escaped():
    for code in range(sys.maxunicode + 1):
        c = chr(code)
        if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp"):
            assert printable(c) == ascii(c)[1:-1], hex(code)
    assert printable("zwölf Roboter, 25 \N{DEGREE SIGN}C") == "zwölf Roboter, 25 \N{DEGREE SIGN}C"


def test_lines_are_those_that_were_meant(capsys):
    say(f"a{EVIL}b", "c")
    say_error(f"d{EVIL}e")
    bounded_log()(f"f{EVIL}g")
    out, err = capsys.readouterr()
    for text, count in ((out, 2), (err, 2)):
        assert_clean(text)
        assert len(text.splitlines()) == count
    assert r"\x1b[2J" in out


def test_no_shell_prints_but_by_these():
    """``encircle.world.process.reports`` writes JSON, which escapes by itself."""
    writing = ("print", "sys.stdout.write", "sys.stderr.write", "stream.write", "write_line")
    found = [
        (str(path.relative_to(ROOT)), ast.unparse(node.func))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in writing
    ]
    assert sorted(found) == [
        ("protocol/process/log.py", "stream.write"),
        ("protocol/process/log.py", "write_line"),
        ("protocol/process/log.py", "write_line"),
        ("world/process/reports.py", "write_line"),
    ]


def test_json_lines_escape_by_themselves(capsys):
    with json_reports() as report:
        report({"result": {"ended": f"failed: {EVIL}"}})
    line = capsys.readouterr().out
    assert_clean(line)
    assert json.loads(line)["result"]["ended"] == f"failed: {EVIL}"


def test_a_robot_that_refuses_logs_what_cannot_move_the_cursor(capsys):
    robot = RobotCore("r1", RUN, bounded_log(1000))
    key = robot_key(RUN, "r1", "setup")
    sound = Setup("r1", TEAM, 0.1, "xi-star", BODIES)
    robot.receive(key, encode(sound, RUN))
    body = msgpack.unpackb(encode(sound, RUN))
    wrong = [
        *({**body, name: EVIL} for name in body),
        {**body, EVIL: 1},
        {**body, "parameters": BODIES | {EVIL: EVIL}},
        {**body, "team": [*TEAM, EVIL]},
        {**body, "team": ["r2", EVIL[:8]]},
    ]
    for message in wrong:
        robot.receive(key, msgpack.packb(message))
    for where in (PIECE, robot_key(RUN, PIECE, "end"), robot_key(PIECE, "r1", "end")):
        robot.receive(where, b"")
    robot.receive(robot_key(RUN, "r1", "end"), encode(End(EVIL, 1, "ticks"), RUN))
    said = capsys.readouterr().err
    assert_clean(said)
    assert len(said.splitlines()) == sum(robot.refused.values()) == len(wrong) + 4


def test_robots_and_world_as_processes_show_what_strangers_sent_as_it_is(hunt):
    hunt.start_router()
    hunt.start_world("--connect")
    for robot in TEAM:
        hunt.start_robot(robot)
    hunt.wait_for_ticks()
    with ExitStack() as stack:
        stranger = stack.enter_context(open_session(Endpoints(connect=(hunt.endpoint,))))
        stranger.put(robot_key(RUN, PIECE, "pose"), b"")
        stranger.put(robot_key(RUN, "r1", f"pose{PIECE}"), b"")
        token = stranger.liveliness().declare_token(robot_key(RUN, f"r{PIECE}", "alive"))
        hunt.world.wait_until(lambda world: world.said.count("2J") >= 3)
        token.undeclare()
        end = encode(End("r2", 1, f"failed: {EVIL}"), RUN)
        stranger.put(robot_key(RUN, "r2", "end"), end)
        assert hunt.robots["r2"].end() == 1
    for node in (hunt.world, *hunt.robots.values()):
        assert_clean(node.said)
    last = hunt.robots["r2"].said.splitlines()[-1]
    assert last == f"robot r2: run {RUN} ended: failed: {printable(EVIL)}"


def test_the_doctor_and_alive_show_who_calls_itself_what_as_it_is(capsys):
    endpoint = free_endpoint()
    with ExitStack() as stack:
        stranger = stack.enter_context(open_session(Endpoints(listen=(endpoint,))))
        about = {"v": 99, "party": EVIL, "versions": {EVIL: EVIL}, "received_us": 1, "sent_us": 1}
        keys = [world_key(RUN, "alive"), robot_key(RUN, "r1", "alive")]
        keys += [world_key(PIECE, "alive"), robot_key(RUN, PIECE, "alive")]
        for key in keys:
            stack.callback(stranger.liveliness().declare_token(key).undeclare)
        for key in (world_key(RUN, "about"), robot_key(RUN, "*", "about")):
            stack.callback(serve_queries(stranger, key, lambda: msgpack.packb(about)).undeclare)
        where = ["--connect", endpoint, "--check-timeout", f"{LONGEST_S}"]
        doctor.main([*where, "--run", RUN])
        doctor.main(where)
        assert alive.main(["world", *where, "--run", RUN]) == 0
    out, err = capsys.readouterr()
    assert_clean(out + err)
    assert f"run {RUN}: world, r1" in out
    for arguments in (["world", "--connect", f"tcp/{EVIL}:1", "--run", "x"], [EVIL]):
        with pytest.raises(SystemExit):
            alive.main(arguments)
    assert_clean(capsys.readouterr().err)


def state_at_start(scenario):
    """The truth at a run's first tick, as its world sends it."""
    arena = build(scenario, 1)
    return encode(truth(arena, initial(arena)), RUN)


def command(*arguments: str) -> None:
    """``encircle`` in this process, whatever its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["encircle", *arguments])
        cli.main()


def test_pages_and_notebooks_show_titles_and_reasons_as_they_are():
    scenario = load(BRIEF | {"title": EVIL, "description": EVIL})
    hunt = encircle.run(scenario, link="memory")
    feed = SceneFeed(scenario, 1, RUN)
    feed.take([Round(0, ((0, "world/state", state_at_start(scenario)),), True)])
    end = encode(End("r1", 0, f"failed: {EVIL}"), RUN)
    feed.take([Round(0, ((0, "robots/r1/end", end),), True)])
    frame = feed.finish()[-1]
    status = feed.status(RunState.ENDED, f"failed: {EVIL}", 0)
    for text in (feed.stage.title, status.text, *[event.text for event in frame.events]):
        assert_clean(text)
        assert "\n" not in text
        assert r"\x1b[2J" in text
    for shown in (hunt, scenario):
        assert_clean(shown._repr_html_())
        assert r"\u202e" in shown._repr_html_()


def test_a_run_shows_its_title_and_its_paths_as_they_are(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    scenario = tmp_path / "evil.json"
    tree = BRIEF | {"title": f"[red]$\\frac$ {EVIL}"}
    scenario.write_text(json.dumps(tree))
    out = tmp_path / "[bold]run[/bold]"
    command("run", str(scenario), "--link", "memory", "--out", str(out))
    told = capsys.readouterr()
    assert_clean(told.out + told.err)
    assert "[bold]run[/bold]" in told.out.replace("\n", "")
    assert "[red]$\\frac$ \\x1b[2J" in told.out.replace("\n", "")
    assert (out / "trajectory.png").exists()
    command("replay", str(out))
    command("replay", str(out), "--check")
    command("transport", str(out))
    command("run", str(tmp_path / f"{PIECE}.toml"))
    command("run", "sim1", "--set", f"title.{PIECE}={PIECE}")
    told = capsys.readouterr()
    assert_clean(told.out + told.err)
    assert "is not a recording" not in told.err


def recorded(folder: Path, run: str, topic: str, payload: bytes, title: str = "") -> Path:
    """A recording of one message, made by a stranger."""
    folder.mkdir()
    scenario = load(BRIEF | {"title": title})
    metadata = {
        "run": run,
        "seed": "1",
        "scenario": scenario.model_dump_json(),
        "digest_header": "",
        "versions": json.dumps({EVIL: EVIL}),
    }
    recorder = Recorder(folder / RECORDING, 0.1, metadata)
    recorder._channels[topic] = recorder._writer.register_channel(topic, "msgpack", 0)
    recorder.record(0, topic, payload)
    recorder.close()
    return folder


SETUP = encode(Setup("r1", TEAM, 0.1, "xi-star", BODIES), "told")
RECORDINGS = {
    "run": (EVIL, "robots/r1/setup", SETUP),
    "topic": ("told", f"robots/{PIECE}/setup", SETUP),
    "short-topic": ("told", EVIL, SETUP),
    "foreign-robot": ("told", "robots/r77/pose", b""),
    "sender": ("told", "robots/r1/setup", encode(Setup(EVIL, TEAM, 0.1, "x", BODIES), "told")),
    "message": ("told", "robots/r1/command", msgpack.packb({EVIL: EVIL})),
    "state": ("told", "world/state", msgpack.packb({EVIL: EVIL})),
    "radio": ("told", "world/radio", msgpack.packb({"v": VERSION, "run": EVIL})),
    "end": ("told", "robots/r1/end", encode(End("r1", 1, f"failed: {EVIL}"), "told")),
}


@pytest.mark.parametrize("case", RECORDINGS)
def test_what_a_recording_says_is_shown_as_it_is_and_is_one_clear_line_if_it_is_wrong(
    case, tmp_path, capsys
):
    place = recorded(tmp_path / "run", *RECORDINGS[case], title=f"[red]{EVIL}")
    for arguments in (
        ("replay", str(place)),
        ("replay", str(place), "--json"),
        ("replay", str(place), "--check"),
        ("transport", str(place)),
        ("trace", str(place), "--out", str(tmp_path / "trace.csv")),
        ("run", "--resume", str(place), "--link", "memory"),
    ):
        command(*arguments)
    told = capsys.readouterr()
    assert_clean(told.out + told.err)
    assert "Traceback" not in told.err
    if case in ("run", "topic", "short-topic"):
        assert "not part of the protocol" in told.err or "is not a recording" in told.err
        assert told.out == ""


def test_the_figure_of_a_run_shows_how_it_ended_as_it_is(tmp_path, recwarn):
    out = tmp_path / "run"
    encircle.run(BRIEF | {"title": f"$\\frac$ {EVIL}"}, link="memory", out=out)
    draw_run(out, tmp_path / "figure.png")
    # A character without a picture is warned of.
    assert [str(w.message) for w in recwarn if "Glyph" in str(w.message)] == []


def test_a_running_hunt_shows_what_it_is_told_as_it_is(capsys):
    shown = Display(load(BRIEF), "zenoh")
    for report in (
        {"log": f"world refused {EVIL}"},
        {"departure": [1, f"r1{EVIL}", f"lost: {EVIL}"]},
        {"departure": [2, "r2", "lost: no answer for 3 s"], "policy": f"policy {EVIL}"},
        {"started": {EVIL: 1}, "run": EVIL, "endpoint": EVIL},
    ):
        shown.update(report)
    said = capsys.readouterr().err
    assert_clean(said)
    assert "[red]" in said
    assert len(said.splitlines()) == 5
    assert "tick 2: robot r2 is lost: no answer for 3 s (policy " in said


def test_rich_finds_no_marks_of_its_own_in_it():
    console = Console(width=200)
    with console.capture() as captured:
        console.print(plain_text(f"[red]x[/red]{EVIL}"))
    assert captured.get().rstrip("\n") == f"[red]x[/red]{printable(EVIL)}"
    assert isinstance(plain_text(""), Text)
    assert display.plain_text is plain_text


def test_a_study_shows_its_texts_as_they_are(tmp_path, capsys):
    evil = "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in EVIL)
    study = tmp_path / "evil.toml"
    study.write_text(
        f'''
title = "{evil}"
question = "{evil} <script>"
scenario = "sim1"
seeds = 2
set = {{ ticks_max = 3 }}
[[axes]]
name = "arm"
label = "{evil}"
unit = "{evil}"
arms = [{{ name = "a{evil}", set = {{ ticks_max = 2 }} }}, {{ name = "b", set = {{}} }}]
'''
    )
    out = tmp_path / "study"
    command("study", str(study), "--out", str(out), "--workers", "1")
    told = capsys.readouterr()
    report = (out / "report.html").read_text(encoding="utf-8")
    for text in (told.out, told.err, report):
        assert_clean(text)
    assert "2 cells" in told.out
    assert r"\x1b[2J" in report
    assert "<script>" not in report


def test_a_page_has_no_tags_and_no_control_characters_of_others():
    for text in (page.document(EVIL, [page.paragraph(f"<b>{EVIL}")]), page.preformatted(EVIL)):
        assert_clean(text)
        assert "<b>" not in text


def test_a_plug_in_that_fails_says_so_in_what_can_be_seen(monkeypatch, capsys):
    failed = PluginFailed(TARGETS, f"x{EVIL}", TARGET, 3, ValueError(EVIL))
    monkeypatch.setattr("encircle.cli.run.main", lambda *_: (_ for _ in ()).throw(failed))
    command("run")
    said = capsys.readouterr().err
    assert_clean(said)
    assert len(said.splitlines()) == 1
