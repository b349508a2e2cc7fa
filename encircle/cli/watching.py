"""The options by which a hunt is shown on a page, of ``encircle run --watch`` and ``watch``."""

from argparse import ArgumentTypeError, Namespace
from typing import TYPE_CHECKING

from encircle.extras import needing
from encircle.protocol.programs.option_values import one_of, seconds, whole_number_in
from encircle.protocol.programs.options import Options

if TYPE_CHECKING:
    from encircle.viewer.showing import ShowOptions

PORT_MAX = 65535
ENDS = ("stay", "closed", "run")


def add_show_options(options: Options) -> None:
    """Add the options that ``show_options`` reads."""
    options.add(
        "--port",
        "serve the page at this port; any that is free if left out",
        read=whole_number_in(1, PORT_MAX),
        metavar="N",
    )
    options.add(
        "--host",
        "serve the page at this address; 127.0.0.1, which only this machine reaches, if left out."
        " Elsewhere everybody who reaches it can look on, and nobody can change the run",
        read=host_name,
        metavar="ADDRESS",
    )
    options.add_flag("--no-browser", "do not open a browser")
    options.add(
        "--watch-end",
        "stop to serve the page: stay (at Ctrl-C), closed (when the run is over and no page is open"
        " any more) or run (when the run is over); stay if left out",
        read=one_of(ENDS),
        metavar="WHEN",
    )


def add_start_option(options: Options) -> None:
    """Add the option of a command whose hunt begins with the page."""
    options.add(
        "--watch-start",
        "with --watch: begin when a page is open, or after this long, in s; 10 if a browser is"
        " opened, at once if not",
        read=seconds,
        metavar="S",
    )


def given_show_options(settings: Namespace) -> list[str]:
    """Which of the options are given, for a command that shows nothing."""
    given = {
        "--port": settings.port,
        "--host": settings.host,
        "--no-browser": settings.no_browser,
        "--watch-end": settings.watch_end,
        "--watch-start": settings.watch_start,
    }
    return [name for name, value in given.items() if value]


def show_options(settings: Namespace, what: str) -> "ShowOptions":
    """What the options say; ``MissingExtra`` if ``what`` cannot be had here."""
    with needing(what, "viewer"):
        from encircle.viewer.addresses import LOOPBACK
        from encircle.viewer.page_files import BOKEH_SCRIPTS, page_text
        from encircle.viewer.showing import ShowOptions, WatchEnd

        page_text(BOKEH_SCRIPTS[0])
    return ShowOptions(
        settings.port or 0,
        settings.host or LOOPBACK,
        not settings.no_browser,
        WatchEnd(settings.watch_end or ENDS[0]),
        getattr(settings, "watch_start", None),
    )


def host_name(value: str) -> str:
    """An address or name of this machine; ``ArgumentTypeError`` for what cannot be one."""
    if not value or any(c.isspace() or c in "/:?#[]@" for c in value.replace(":", "", 9)):
        raise ArgumentTypeError(f"{value!r} is not an address or name of this machine")
    return value
