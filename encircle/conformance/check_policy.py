"""``encircle check-policy NAME``: whether a policy keeps to what the interface asks of it.

As PettingZoo's ``api_test`` does for environments: the policy is asked on real views in every way
in which its answer must not change, and in the situations that break readers' policies. What is
wrong gets an explanation. A question that makes no sense after what was seen is left out.
"""

import sys
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout

from encircle.check_results import CheckResult, as_json, as_lines, well
from encircle.protocol.process.log import say
from encircle.protocol.programs.option_values import whole_number_in
from encircle.protocol.programs.options import Options

ROBOTS_MAX = 100
OWN = "team.policy_parameters."
PURITY_FIRST = "left out until the same question has one answer"


def main(arguments: Sequence[str] | None = None, program: str = "encircle check-policy") -> int:
    """Examine a policy and print the results; returns 0 if all is well, 1 if not."""
    options = Options(
        program,
        "Examine a policy: is it pure, does it survive what hunts bring, what does it cost?",
        environment=False,
    )
    options.add(
        "policy",
        "a shipped name, that of a plug-in, or path/file.py:function",
        metavar="NAME",
        required=True,
    )
    options.add_list(
        "--set", "set an own parameter of the policy; may be repeated", metavar="NAME=VALUE"
    )
    options.add(
        "--robots",
        "size of the largest team",
        read=whole_number_in(2, ROBOTS_MAX),
        metavar="N",
    )
    options.add_flag("--json", "print one JSON object")
    settings = options.parse(arguments)
    # Imported late: a mistyped command need not wait for the brains.
    from encircle.conformance.subject import NoSuchPolicy
    from encircle.world.scenario.errors import ScenarioError

    try:
        # What a policy prints is not the result.
        with redirect_stdout(sys.stderr):
            results = list(examined(settings.policy, settings.set, settings.robots))
    except NoSuchPolicy as error:
        options.error(str(error))
    except ScenarioError as error:
        _, *problems = str(error).split("\n")
        options.error("; ".join(line.strip().replace(OWN, "--set ") for line in problems))
    say(*([as_json(results)] if settings.json else as_lines(results)))
    return 0 if well(results) else 1


def examined(
    name: str, own: Sequence[str] = (), robots: int | None = None
) -> Iterator[CheckResult]:
    """The results of all checks of the policy of that name.

    ``own``: its own parameters as ``NAME=VALUE``; ``robots``: size of the largest team.
    ``NoSuchPolicy`` if nothing has that name, ``ScenarioError`` if a parameter is not right.
    """
    from encircle.conformance import failures, hunts, outside, purity, scenes, strangers
    from encircle.conformance.subject import Subject, found

    function, result = found(name)
    yield result
    if function is None:
        return
    large = robots or scenes.LARGE_TEAM
    scenarios = scenes.scenarios(name, own, large)
    plain = scenarios["plain"]
    subject = Subject(name, function, plain.policy_parameters_of(plain.ids[0]))
    recorded = scenes.record(scenarios)
    yield from failures.check_decisions(subject, recorded)
    parts = [part for part in recorded.participations if part.views]
    if not parts:
        return
    guarded = failures.guarded
    yield from guarded("outside", subject, outside.check_outside, parts)
    yield purity.check_inputs(parts)
    (same,) = guarded("same answer", subject, purity.check_twice, parts)
    yield same
    if same.level == "wrong":
        yield CheckResult("order, memory, fresh process, replay, resume", "note", PURITY_FIRST)
    else:
        yield from guarded("order", subject, purity.check_order, parts)
        yield from guarded("memory", subject, purity.check_memory, parts)
        yield from purity.check_processes(subject, parts)
    if not recorded.failures:
        yield from strangers.check_strangers(subject, parts)
        if same.level != "wrong":
            yield from hunts.check_replay(scenarios["bad radio"])
    yield from hunts.check_payload(parts, large)
    yield hunts.check_steps(parts)
    yield from guarded("time", subject, hunts.check_time, parts)


if __name__ == "__main__":
    sys.exit(main())
