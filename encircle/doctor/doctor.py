"""``encircle doctor``: look at this machine and at a run's network, and say what to do.

It asks what can go wrong, in the order in which it would: what is installed, memory and disk, ports
to listen on, endpoints to connect to, who of a run is there, whether all speak one version, how far
apart the clocks are. It takes no part in a run and changes nothing. Every step is bounded in time,
also those whose library is not, such as a name server's answer.
"""

import json
import os
import sys
import threading
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from encircle.doctor.machine import CheckResult, machine
from encircle.doctor.network import connecting_to, exposure, listening_on
from encircle.doctor.run import nodes
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
"""How long the parties of a run are asked altogether, on top of the time for one check."""
RUNS = Path("runs")


def main(arguments: Sequence[str] | None = None, program: str = "encircle doctor") -> int:
    """Examine, and print what was found; returns 0 if all is well, 1 if something is wrong."""
    options = _options(program)
    found = options.parse(arguments)
    if found.robot is not None and found.run is None:
        options.error(f"--robot {found.robot}: its --run is missing")
    networked = found.connect or found.listen or found.zenoh_config
    if found.run is not None and not networked:
        options.error(f"--run {found.run}: where? Give --connect, --listen or --zenoh-config")
    examination = _Examination(found.check_timeout)
    try:
        # Without certificates at first: those that will not do are a finding, not a wrong usage.
        plain = Namespace(**(vars(found) | {"certificates": None}))
        where = endpoints_of(plain, found.check_timeout) if networked else None
        examination.findings += machine(found.runs or RUNS, found.runs is not None)
        if where is not None:
            _network(examination, where, found)
    except ConfigurationError as error:
        options.error(str(error))
    status = 0 if examination.well else 1
    say(*([as_json(examination)] if found.json else as_lines(examination)))
    if examination.stuck:
        # What still waits somewhere in a library must not keep this process.
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
    """What was found so far, and whether some step has not come back."""

    def __init__(self, s_max: float) -> None:
        self.s_max = s_max
        self.findings: list[CheckResult] = []
        self.stuck = False

    @property
    def well(self) -> bool:
        return all(finding.level != "wrong" for finding in self.findings)

    def add(
        self,
        check: str,
        what: str,
        look: Callable[..., list[CheckResult]],
        *arguments: Any,
        more_s: float = 0.0,
    ) -> list[CheckResult]:
        """Add, and return, what a step finds, or that it did not end."""
        s_max = 2.0 * self.s_max + more_s
        found = with_timeout(s_max, partial(look, *arguments))
        if found is None:
            self.stuck = True
            message = f"{what}: no end after {s_max:g} s"
            found = [
                CheckResult(check, "wrong", message, "is the network, or its name server, there?")
            ]
        self.findings += found
        return found


def _network(examination: _Examination, where: Endpoints, found: Namespace) -> None:
    """Everything about endpoints, and about those who are behind them."""
    s_max = examination.s_max
    try:
        where = replace(where, identity=_identity(found))
    except ConfigurationError as error:
        advice = "docs/security.md says which files each party needs, and how to make them"
        examination.findings.append(CheckResult("certificates", "wrong", str(error), advice))
        return
    examination.findings += exposure(where)
    listening, connecting = configured_endpoints(replace(where, without_authentication=True))
    busy = [
        loopback_endpoint(endpoint)
        for endpoint in listening
        if any(f.level != "ok" for f in examination.add("ports", endpoint, listening_on, endpoint))
    ]
    # Who only listens is looked for where it listens, as by ``encircle alive``.
    reached = [
        endpoint
        for endpoint in connecting or busy
        if not any(
            f.level == "wrong"
            for f in examination.add("endpoints", endpoint, connecting_to, endpoint, s_max)
        )
    ]
    for endpoint in reached:
        one = replace(where, listen=(), connect=(endpoint,), mode="client")
        asking = (one, found.run, found.robot, s_max, ASKING_S_MAX)
        examination.add("run", endpoint, nodes, *asking, more_s=ASKING_S_MAX)


def _identity(found: Namespace) -> Identity | None:
    """On a robot's host its own certificate is there, elsewhere that of an onlooker."""
    directory, robot = found.certificates, found.robot
    own = directory is not None and robot is not None and (directory / f"{robot}.key").exists()
    return identity(directory, robot if own else None)


def with_timeout(s_max: float, look: Callable[[], list[CheckResult]]) -> list[CheckResult] | None:
    """What a function returns, or None if it has not returned after ``s_max`` seconds.

    It then goes on in its thread; whatever it raises is raised here.
    """
    results: list[list[CheckResult]] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            results.append(look())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, name="doctor", daemon=True)
    thread.start()
    thread.join(s_max)
    if errors:
        raise errors[0]
    return results[0] if results else None


def as_json(examination: _Examination) -> str:
    """One object: whether all is well, and the findings."""
    findings = [finding._asdict() for finding in examination.findings]
    return json.dumps({"well": examination.well, "findings": findings})


def as_lines(examination: _Examination) -> list[str]:
    """A line for each finding, and one below it that says what to do; then the verdict."""
    lines = []
    for check, level, message, advice in examination.findings:
        lines.append(f"{level:5}  {check}: {message}")
        if advice:
            lines.append(f"       -> {advice}")
    wrong = sum(level == "wrong" for _, level, _, _ in examination.findings)
    verdict = (
        "all is well"
        if not wrong
        else f"{wrong} {'thing is' if wrong == 1 else 'things are'} wrong"
    )
    return [*lines, verdict]


if __name__ == "__main__":
    sys.exit(main())
