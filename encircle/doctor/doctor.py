"""``encircle doctor``: check this machine and a run's network, and say what to do.

The checks come in the order in which a start can fail: installed packages, memory and disk, ports
to listen on, endpoints to connect to, which nodes of a run are there, whether all have one protocol
version, how far apart their clocks are. The doctor takes no part in a run and changes nothing.
Every check has a time limit. Some library calls have none of their own, such as the lookup of a
host name, so checks of the network run in a thread that can be left behind.
"""

import os
import sys
import threading
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from encircle.check_results import CheckResult, as_json, as_lines, well
from encircle.doctor.machine import check_machine
from encircle.doctor.network import check_connecting, check_exposure, check_listening
from encircle.doctor.run import check_nodes
from encircle.protocol.process.log import say
from encircle.protocol.programs.option_values import name_of, seconds
from encircle.protocol.programs.options import Options, endpoints_of, identity
from encircle.protocol.zenoh.configuration import configured_endpoints
from encircle.protocol.zenoh.endpoints import (
    ConfigurationError,
    Endpoints,
    Identity,
    loopback_endpoint,
)

CHECK_S_MAX = 3.0
ASKING_S_MAX = 30.0
"""Time limit for queries to all nodes of a run, in addition to the time for one check."""
RUNS = Path("runs")


def main(arguments: Sequence[str] | None = None, program: str = "encircle doctor") -> int:
    """Run the checks and print their results; returns 0 if all is well, 1 if something is wrong."""
    options = _options(program)
    settings = options.parse(arguments)
    if settings.robot is not None and settings.run is None:
        options.error(f"--robot {settings.robot}: its --run is missing")
    networked = settings.connect or settings.listen or settings.zenoh_config
    if settings.run is not None and not networked:
        options.error(f"--run {settings.run}: where? Give --connect, --listen or --zenoh-config")
    examination = _Examination(settings.check_timeout)
    try:
        # First without certificates: unusable ones are a result of a check, not wrong usage.
        without_certificates = Namespace(**(vars(settings) | {"certificates": None}))
        endpoints = (
            endpoints_of(without_certificates, settings.check_timeout) if networked else None
        )
        examination.results += check_machine(settings.runs or RUNS, settings.runs is not None)
        usable, own = _checked_identity(examination, settings)
        if endpoints is not None and usable:
            _check_network(examination, replace(endpoints, identity=own), settings)
    except ConfigurationError as error:
        options.error(str(error))
    status = 0 if examination.well else 1
    say(*([as_json(examination.results)] if settings.json else as_lines(examination.results)))
    if examination.stuck:
        # A thread that still waits in a library must not keep this process alive.
        os._exit(status)
    return status


def _options(program: str) -> Options:
    options = Options(program, "Examine this machine, and a run's network, and say what to do.")
    options.add_endpoints()
    options.add("--run", "name of the run that should be there", read=name_of("run"))
    options.add("--robot", "a robot that should be there", read=name_of("robot"), metavar="ID")
    options.add("--runs", "directory that runs are recorded in", read=Path, metavar="DIR")
    options.add(
        "--check-timeout",
        f"wait this long for each answer, in s; {CHECK_S_MAX:g} if left out",
        read=seconds,
        default=CHECK_S_MAX,
        metavar="S",
    )
    options.add_flag("--json", "print one JSON object")
    return options


class _Examination:
    """The results so far, and whether some check has not ended."""

    def __init__(self, s_max: float) -> None:
        self.s_max = s_max
        self.results: list[CheckResult] = []
        self.stuck = False

    @property
    def well(self) -> bool:
        """Whether no result is wrong."""
        return well(self.results)

    def add(
        self,
        check: str,
        subject: str,
        examine: Callable[..., list[CheckResult]],
        *arguments: Any,
        more_s: float = 0.0,
    ) -> list[CheckResult]:
        """Run a check with a time limit, store its results and return them.

        A check that does not end gives a result that says so.
        """
        s_max = 2.0 * self.s_max + more_s
        results = with_timeout(s_max, partial(examine, *arguments))
        if results is None:
            self.stuck = True
            message = f"{subject}: no end after {s_max:g} s"
            results = [
                CheckResult(check, "wrong", message, "is the network, or its name server, there?")
            ]
        self.results += results
        return results


def _check_network(examination: _Examination, endpoints: Endpoints, settings: Namespace) -> None:
    """Check the endpoints, and the nodes that can be reached there."""
    s_max = examination.s_max
    examination.results += check_exposure(endpoints)
    listening, connecting = configured_endpoints(replace(endpoints, without_authentication=True))
    busy = [
        loopback_endpoint(endpoint)
        for endpoint in listening
        if any(
            f.level != "ok" for f in examination.add("ports", endpoint, check_listening, endpoint)
        )
    ]
    # Without endpoints to connect to, connect to those that listen here and are in use.
    reached = [
        endpoint
        for endpoint in connecting or busy
        if not any(
            f.level == "wrong"
            for f in examination.add("endpoints", endpoint, check_connecting, endpoint, s_max)
        )
    ]
    for endpoint in reached:
        single = replace(endpoints, listen=(), connect=(endpoint,), mode="client")
        arguments = (single, settings.run, settings.robot, s_max, ASKING_S_MAX)
        examination.add("run", endpoint, check_nodes, *arguments, more_s=ASKING_S_MAX)


def _checked_identity(
    examination: _Examination, settings: Namespace
) -> tuple[bool, Identity | None]:
    """Whether certificates are usable or none are named, and which.

    A robot's own if its key is here, otherwise those of a viewer.
    """
    directory, robot = settings.certificates, settings.robot
    if directory is None:
        return True, None
    own = robot is not None and (directory / f"{robot}.key").exists()
    try:
        found = identity(directory, robot if own else None)
    except ConfigurationError as error:
        advice = "docs/security.md says which files each node needs, and how to make them"
        examination.results.append(CheckResult("certificates", "wrong", str(error), advice))
        return False, None
    whose = f"robot {robot}" if own else "a viewer"
    message = f"those of {whose} in {directory} can be used"
    examination.results.append(CheckResult("certificates", "ok", message))
    return True, found


def with_timeout(
    s_max: float, examine: Callable[[], list[CheckResult]]
) -> list[CheckResult] | None:
    """What a function returns, or None if it has not returned after ``s_max`` seconds.

    The function then goes on in its thread. An exception that it raises in time is raised here.
    """
    results: list[list[CheckResult]] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            results.append(examine())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, name="doctor", daemon=True)
    thread.start()
    thread.join(s_max)
    if errors:
        raise errors[0]
    return results[0] if results else None


if __name__ == "__main__":
    sys.exit(main())
