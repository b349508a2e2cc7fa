"""``encircle certificates``: a private authority, and a certificate for each node of a lab."""

from collections.abc import Sequence
from pathlib import Path

from encircle.extras import needing
from encircle.protocol.process.log import say, say_error
from encircle.protocol.programs.option_values import whole_number
from encircle.protocol.programs.options import Options

DAYS = 30


def main(arguments: Sequence[str], program: str) -> int:
    """Make certificates; returns the exit status."""
    options = Options(
        program,
        "Make certificates for a lab: a private authority, and certificates for router, world,"
        " viewer and robots.",
        environment=False,
    )
    options.add(
        "directory", "where to put them; new or empty", read=Path, metavar="DIR", required=True
    )
    options.add("--robots", "for robots r1 to rN", read=whole_number, metavar="N", required=True)
    options.add_list(
        "--host",
        "a name or address at which router or world is reached; may be repeated",
        metavar="HOST",
    )
    options.add(
        "--days",
        f"how many days they are valid; {DAYS} if left out",
        read=whole_number,
        default=DAYS,
        metavar="N",
    )
    settings = options.parse(arguments)
    with needing("making certificates"):
        from encircle.network.certificates import (
            CertificateError,
            describe_certificates,
            make_certificates,
        )
    try:
        made = make_certificates(settings.directory, settings.robots, settings.host, settings.days)
    except CertificateError as error:
        say_error(f"encircle: {error}")
        return 2
    say(*describe_certificates(made).split("\n"))
    return 0
