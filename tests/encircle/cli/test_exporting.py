"""``encircle export`` as a person or a script meets it; each format has tests of its own."""

import json
import sys
from importlib import import_module
from inspect import signature

import pytest
from helpers_waiting import completed
from pyarrow import parquet

import encircle
from encircle.cli.exporting import FORMATS, Format
from encircle.cli.main import main
from encircle.protocol import VERSION
from encircle.protocol.plugin_files import FOLDERS
from encircle.world.recording.recorder import Recorder
from encircle.world.recording.recording import read_recording

LOSS = 'channel.loss={model="bernoulli", rate=0.4}'
HIDDEN = {
    "html": "bokeh",
    "parquet": "pyarrow",
    "foxglove": "foxglove",
    "foxglove-layout": "foxglove",
    "rerun": "rerun",
    "rosbag2": "rosbags",
    "mp4": "av",
}
"""Of each format that needs an extra, a package without which it cannot be written."""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "hunt"
    encircle.run("sim1", link="memory", overrides=[LOSS, "ticks_max=6"], out=out)
    return out


@pytest.fixture
def cli(capsys):
    def call(*arguments):
        status = main(["export", *map(str, arguments)])
        said = capsys.readouterr()
        return status, said.out, said.err

    return call


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_is_a_function_with_options_of_its_own(name):
    form = FORMATS[name]
    first, second, *rest = signature(
        getattr(import_module(form.module), form.function)
    ).parameters.values()
    assert first.default is second.default is first.empty
    assert all(option.kind is option.KEYWORD_ONLY for option in rest)
    assert all(option.default is not option.empty for option in rest)
    assert form.suffix.startswith((".", "-"))
    assert len({f.suffix for f in FORMATS.values()}) == len(FORMATS)


def test_every_format_that_needs_an_extra_is_tried_without_it():
    assert set(HIDDEN) == {name for name, form in FORMATS.items() if form.extra}


@pytest.mark.parametrize("name", HIDDEN)
def test_without_a_package_one_line_says_how_to_get_it(name, run, tmp_path):
    module = HIDDEN[name]
    script = (
        f"import sys; sys.modules[{module!r}] = None; from encircle.cli.main import main;"
        f"sys.exit(main(['export', {str(run)!r}, '--to', {name!r}, '--out', 'out']))"
    )
    done = completed([sys.executable, "-c", script], cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"encircle: --to {name} needs ")
    assert done.stderr.endswith(f'pip install "encircle[{FORMATS[name].extra}]"\n')
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


def write(
    recording, out, *, text: str = "hello", times: int = 1, loud: bool = False, of: float | None = 1
):
    out.write_text(f"{recording.run} {text * times} {loud} {of!r}")


def fail(_recording, out):
    out.write_text("half")
    raise OSError(28, "No space left on device")


@pytest.fixture
def own(monkeypatch):
    monkeypatch.setitem(FORMATS, "own", Format("words", __name__, "", ".txt", "write"))
    monkeypatch.setitem(FORMATS, "bad", Format("nothing", __name__, "", ".bad", "fail"))
    monkeypatch.setitem(sys.modules, __name__, sys.modules[write.__module__])


def test_it_is_written_beside_the_recording_and_never_over_it(own, cli, run):
    status, said, _ = cli(run, "--to", "own")
    assert status == 0
    made = run / "hunt.txt"
    assert said.endswith(f": {made}\n")
    before = made.read_text()
    assert cli(run, "--to", "own") == (
        2,
        "",
        f"encircle: {made} is there already: choose another --out, nothing was changed\n",
    )
    assert made.read_text() == before
    # Of the recording itself, beside it as well.
    made.unlink()
    assert cli(run / "recording.mcap", "--to", "own")[0] == 0
    made.unlink()


def test_json_is_one_object(own, cli, run, tmp_path):
    out = tmp_path / "it"
    status, said, told = cli(run, "--to", "own", "--out", out, "--json")
    assert (status, told) == (0, "")
    answer = json.loads(said)
    assert answer.pop("run").startswith("run-")
    size = out.stat().st_size
    assert answer == {"format": "own", "out": str(out), "bytes": size, "complete": True}


@pytest.mark.parametrize(
    ("options", "written"),
    [
        ([], "hello False 1"),
        (["text=a=b", "times=3", "loud=yes", "of=2.5"], "a=ba=ba=b True 2.5"),
        (["text = 5 "], "5 False 1"),
    ],
)
def test_options_of_a_format_are_read_as_what_they_are(own, cli, run, tmp_path, options, written):
    given = [word for option in options for word in ("--option", option)]
    assert cli(run, "--to", "own", "--out", tmp_path / "it", *given)[0] == 0
    assert (tmp_path / "it").read_text().split(" ", 1)[1] == written


def test_a_file_is_not_written_under_another_formats_ending(cli, run, tmp_path):
    out = tmp_path / "hunt.avi"
    status, printed, told = cli(run, "--to", "mp4", "--out", out)
    assert (status, printed) == (2, "")
    assert told.endswith(f"--out {out}: what --to mp4 writes ends in .mp4\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--to", "parqet"], "no such format (did you mean 'parquet'?); there are html, "),
        (["--to", "own", "--option", "txt=1"], "no such option (did you mean 'text'?)"),
        (["--to", "own", "--option", "text"], "write NAME=VALUE"),
        (["--to", "own", "--option", "times=many"], "must be a whole number"),
        (["--to", "own", "--option", "of=much"], "must be a number"),
        (["--to", "own", "--option", "loud=perhaps"], "'perhaps' is not one of"),
        (["--to", "bad", "--option", "a=1"], "--to bad has no options"),
        ([], "--to is missing"),
    ],
)
def test_bad_usage_is_one_line(own, cli, run, tmp_path, arguments, said):
    status, printed, told = cli(run, *arguments, "--out", tmp_path / "it")
    assert (status, printed) == (2, "")
    assert said in told
    assert told.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_leaves_nothing(own, cli, run, tmp_path):
    status, _, told = cli(run, "--to", "bad", "--out", tmp_path / "it")
    assert status == 2
    assert told == f"encircle: {tmp_path / 'it'} cannot be written: No space left on device\n"
    assert cli(run, "--to", "own", "--out", tmp_path / "a" / "it")[0] == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("length", [250, 300])
def test_a_name_that_is_too_long_is_one_line(own, cli, run, tmp_path, length):
    out = tmp_path / (length * "x")
    assert cli(run, "--to", "own", "--out", out) == (
        2,
        "",
        f"encircle: {out} cannot be written: File name too long\n",
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "bytes_max"),
    [*((name, 600) for name in FORMATS), ("foxglove", 10_000)],
)
def test_a_disk_that_is_full_is_told_of_and_leaves_nothing(name, bytes_max, run, tmp_path):
    # No file may become longer than this, which comes to the same.
    script = (
        "import resource, sys; from encircle.cli.main import main;"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({bytes_max}, {bytes_max}));"
        f"sys.exit(main(['export', {str(run)!r}, '--to', {name!r}, '--out', 'out']))"
    )
    done = completed([sys.executable, "-c", script], cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("encircle: ")]
    assert [line[:33] for line in said] == ["encircle: out cannot be written: "]
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("share", [0.75, 0.999])
def test_what_rerun_only_warns_of_is_an_error_too(cli, run, tmp_path, share):
    # It writes blueprint, data and a footer, the latter two in a thread of its own.
    whole = tmp_path / "whole"
    assert cli(run, "--to", "rerun", "--out", whole)[0] == 0
    limit = int(share * whole.stat().st_size)
    script = (
        "import resource, sys; from encircle.cli.main import main;"
        "from encircle.exports import rerun_file; rerun_file.ROOM_BYTES = 1000;"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}));"
        f"sys.exit(main(['export', {str(run)!r}, '--to', 'rerun', '--out', 'out']))"
    )
    done = completed([sys.executable, "-c", script], cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "\nencircle: out cannot be written: " in f"\n{done.stderr}"
    assert [path.name for path in tmp_path.iterdir()] == ["whole"]


def test_a_recording_that_is_cut_off_is_told_of_and_written_as_far_as_it_goes(
    own, cli, run, tmp_path
):
    whole = (run / "recording.mcap").read_bytes()
    cut = tmp_path / "recording.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    status, said, told = cli(cut, "--to", "own", "--out", tmp_path / "it", "--json")
    assert status == 0
    assert json.loads(said)["complete"] is False
    assert told.startswith(f"encircle: {cut} is cut off or damaged: it can be read up to tick ")
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "cannot be read: No such file or directory"),
        (b"", "is not a recording of this program"),
        (b"something else\n" * 99, "is not a recording of this program"),
    ],
)
def test_what_is_no_recording_is_refused(own, cli, tmp_path, content, said):
    path = tmp_path / "recording.mcap"
    if content is not None:
        path.write_bytes(content)
    status, printed, told = cli(path, "--to", "own", "--out", tmp_path / "it")
    assert (status, printed) == (2, "")
    assert said in told
    assert told.count("\n") == 1
    assert not (tmp_path / "it").exists()


def test_a_recording_of_another_version_is_refused(cli, run, tmp_path):
    recording, other = read_recording(run), tmp_path / "recording.mcap"
    metadata = {
        "run": recording.run,
        "seed": str(recording.seed),
        "scenario": recording.scenario.model_dump_json(),
    }
    recorder = Recorder(other, recording.scenario.tick_s, metadata)
    for tick, topic, payload in recording.messages:
        key = f"encircle/{recording.run}/{topic}"
        assert payload.count(b"\xa1v" + bytes([VERSION])) >= 1
        changed = payload.replace(b"\xa1v" + bytes([VERSION]), b"\xa1v\x63", 1)
        recorder.record(tick, key, changed)
    recorder.close()
    status, printed, told = cli(other, "--to", "parquet", "--out", tmp_path / "it")
    assert (status, printed) == (2, "")
    assert told.startswith(f"encircle: {other}: robots/r1/setup of tick 0: ")
    assert "version 99" in told
    assert told.count("\n") == 1
    assert not (tmp_path / "it").exists()


def test_beliefs_that_cannot_be_worked_out_are_left_out_with_a_line(cli, tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDERS, str(tmp_path))
    policy = (
        "from encircle.agents.policies.paper import xi_star\n\n\n"
        "def mine(memory, view):\n    return xi_star(memory, view)\n"
    )
    (tmp_path / "mine.py").write_text(policy, encoding="utf-8")
    changes = ["ticks_max=4", "team.strategy=mine.py:mine"]
    encircle.run("sim1", link="memory", overrides=changes, out=tmp_path / "run")
    (tmp_path / "mine.py").write_text(policy + "# edited since\n", encoding="utf-8")
    status, printed, told = cli(tmp_path / "run", "--to", "parquet", "--json")
    assert status == 0
    out = json.loads(printed)["out"]
    line = "what r1, r2, r3, r4 believed is left out, at some ticks or all: what r1 believes is not"
    assert told.startswith(f"encircle: {tmp_path / 'run' / 'recording.mcap'}: {line} known: ")
    assert told.count("\n") == 1
    assert parquet.read_table(f"{out}/beliefs.parquet").num_rows == 0
    assert parquet.read_table(f"{out}/decisions.parquet").num_rows == 16
