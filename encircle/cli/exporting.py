"""``encircle export``: a recording written in another format.

A format is a row of ``FORMATS``: a function ``export(recording, out, *, ...)`` that writes to a
path at which there is nothing yet. Its keyword-only arguments are the format's own options, set by
``--option NAME=VALUE``; those of videos have options of the command as well.
"""

import json
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

from encircle.cli.reading import doubts_told, prints_elsewhere, read_or_tell
from encircle.extras import needing
from encircle.protocol.errors import did_you_mean
from encircle.protocol.process.interrupts import signals_held
from encircle.protocol.process.log import say
from encircle.protocol.programs.option_values import yes_or_no
from encircle.protocol.programs.options import Options

if TYPE_CHECKING:
    from encircle.world.recording.recording import Recording


class Format(NamedTuple):
    """A format: what it is for, where its function is, which extra it needs ("" for none).

    ``suffix``: what is put after the run's name to name the file or directory.
    """

    summary: str
    module: str
    extra: str
    suffix: str
    function: str = "export"


FORMATS: dict[str, Format] = {
    "html": Format("the page, in one file", "encircle.viewer.html_export", "viewer", ".html"),
    "parquet": Format(
        "tables for pandas and others", "encircle.exports.parquet", "studies", "-parquet"
    ),
    "foxglove": Format(
        "MCAP for Foxglove and PlotJuggler",
        "encircle.exports.foxglove_file",
        "export",
        "-foxglove.mcap",
    ),
    "foxglove-layout": Format(
        "panels for Foxglove that show these",
        "encircle.exports.foxglove_layout",
        "export",
        "-foxglove-layout.json",
    ),
    "rerun": Format(
        "a file for Rerun, with its views", "encircle.exports.rerun_file", "export", ".rrd"
    ),
    "rosbag2": Format(
        "a ROS 2 bag of standard types", "encircle.exports.rosbag2_directory", "export", "-rosbag2"
    ),
    "mp4": Format(
        "a video for talks and pages", "encircle.exports.video", "export", ".mp4", "export_mp4"
    ),
    "gif": Format(
        "an animation, smaller and coarser", "encircle.exports.video", "", ".gif", "export_gif"
    ),
    "png": Format(
        "a picture of one tick of a video", "encircle.exports.video", "", ".png", "export_png"
    ),
}
VIDEO_OPTIONS = {
    "fps": ("pictures per second; 30, of gif 12, if left out", "N"),
    "speed": ("seconds of the run in a second; 1 if left out", "X"),
    "size": ("pixels; 1280x720, of gif 800x450, if left out", "WxH"),
    "belief": ("draw the world as this robot believes it, over the truth", "ROBOT"),
    "tick": ("of png: which, as 20.5; the last one if left out", "T"),
    "theme": ("light, the default, or dark", "THEME"),
}
"""What they are for, and what their values are called in the help."""


def main(arguments: Sequence[str], program: str) -> int:
    """Write a recording in another format; returns the exit status."""
    options = _options(program)
    settings = options.parse(arguments)
    form = FORMATS.get(settings.to)
    if form is None:
        hint = did_you_mean(settings.to, FORMATS)
        options.error(f"--to {settings.to}: no such format{hint}; there are {', '.join(FORMATS)}")
    # Imported late: a mistyped command need not wait for the recording's reader.
    from encircle.exports.refused_option import OptionRefused
    from encircle.whole_files import check_new, made_whole

    out = settings.out or default_out(settings.run, form)
    ending = f".{form.suffix.rpartition('.')[2]}"
    if form.suffix.endswith(ending) and out.suffix not in ("", ending):
        options.error(f"--out {out}: what --to {settings.to} writes ends in {ending}")
    check_new(out)
    with needing(f"--to {settings.to}", form.extra or None):
        export = getattr(import_module(form.module), form.function)
        texts = _own_texts(settings)
        given = _own_options(options, export, settings.to, texts)
        recording = read_or_tell(settings.run)
        try:
            with prints_elsewhere(), signals_held(), doubts_told(), made_whole(out) as unfinished:
                export(recording, unfinished, **given)
        except OptionRefused as error:
            options.error(f"{_as_typed(texts, error.option)}: {error.problem}")
    _show(recording, settings.to, out, settings.json)
    return 0


def default_out(run: Path, form: Format) -> Path:
    """Beside the recording, under the name of the run's directory."""
    directory = run if run.is_dir() else run.parent
    return directory / f"{directory.resolve().name or 'run'}{form.suffix}"


def _show(recording: "Recording", name: str, out: Path, as_json: bool) -> None:
    files = [path for path in out.rglob("*") if path.is_file()] if out.is_dir() else [out]
    size = sum(path.stat().st_size for path in files)
    if not as_json:
        say(f"{name}, {size / 1e6:.3g} MB: {out}")
        return
    answer = {"run": recording.run, "format": name, "out": str(out), "bytes": size}
    say(json.dumps({**answer, "complete": recording.complete}))


def _own_options(
    options: Options, export: Callable[..., None], name: str, texts: Sequence[tuple[str, str]]
) -> dict[str, Any]:
    """The format's own options as given; ends the command for one that it does not have.

    ``texts``: what was given on the command line, and ``NAME=VALUE`` that it stands for.
    """
    known = {
        key: parameter
        for key, parameter in signature(export).parameters.items()
        if parameter.kind is Parameter.KEYWORD_ONLY
    }
    given = {}
    for shown, text in texts:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals:
            options.error(f"{shown}: write NAME=VALUE")
        if key not in known:
            options.error(f"{shown}: --to {name} has {_listed(known, key)}")
        try:
            given[key] = _value(value.strip(), known[key].annotation)
        except (ValueError, ArgumentTypeError) as error:
            options.error(f"{shown}: {error}")
    return given


def _own_texts(settings: Namespace) -> list[tuple[str, str]]:
    """The format's own options as ``NAME=VALUE``, each after what was given on the command line."""
    texts = [(f"--option {text}", text) for text in settings.option]
    given = {name: getattr(settings, name) for name in VIDEO_OPTIONS}
    texts += [
        (f"--{name} {value}", f"{name}={value}")
        for name, value in given.items()
        if value is not None
    ]
    return texts + [("--no-packets", "packets=no")] * settings.no_packets


def _as_typed(texts: Sequence[tuple[str, str]], key: str) -> str:
    """One of the format's own options as it was given on the command line; the last one counts."""
    given = [shown for shown, text in texts if text.partition("=")[0].strip() == key]
    return given[-1] if given else key


def _listed(known: Mapping[str, Parameter], key: str) -> str:
    if not known:
        return "no options"
    return f"no such option{did_you_mean(key, known)}; it has {', '.join(known)}"


def _value(text: str, annotation: Any) -> Any:
    """A text read as what an option is annotated with; of several kinds the first that fits."""
    kinds = [kind for kind in get_args(annotation) or (annotation,) if kind is not type(None)]
    for kind in kinds:
        if kind is bool:
            return yes_or_no(text)
        try:
            return kind(text)
        except ValueError:
            continue
    wanted = " or ".join({int: "a whole number", float: "a number"}.get(k, "text") for k in kinds)
    raise ValueError(f"must be {wanted}")


def _options(program: str) -> Options:
    width = max(map(len, FORMATS))
    options = Options(
        program,
        "Write a recording in another format: "
        + "; ".join(f"{name:{width}} {form.summary}" for name, form in FORMATS.items()),
        environment=False,
    )
    options.add(
        "run", "a recorded run's directory or recording", read=Path, metavar="RUN", required=True
    )
    options.add("--to", "the format", metavar="FORMAT", required=True)
    options.add(
        "--out",
        "where to write it; beside the recording if left out",
        read=Path,
        metavar="PATH",
    )
    options.add_list("--option", "an option of the format; may be repeated", metavar="NAME=VALUE")
    for name, (text, metavar) in VIDEO_OPTIONS.items():
        options.add(f"--{name}", f"of videos: {text}", metavar=metavar)
    options.add_flag("--no-packets", "of videos: draw no packets")
    options.add_flag("--json", "print one JSON object")
    return options
