"""What shows in hunts: what a policy says, whether runs are replayed and resumed, its time."""

import tempfile
import time
import warnings
from collections.abc import Iterator
from math import hypot
from pathlib import Path
from statistics import median
from typing import Any

import msgpack

from encircle.agents.policies.interface import Policy, View
from encircle.agents.policies.paper import xi_star
from encircle.check_results import CheckResult
from encircle.conformance.purity import PURE_ADVICE, Parts
from encircle.conformance.subject import Subject
from encircle.protocol.messages import QUANTA_PER_M, QUANTUM_M
from encircle.protocol.plugins import PluginFailed
from encircle.protocol.wire.limits import SAY_BYTES_MAX
from encircle.replay.replaying import replay
from encircle.runner.hunts import resume, run
from encircle.runner.testimony import RunFailed
from encircle.world.loading.remarks import ScenarioRemark
from encircle.world.recording.run_directory import RunDirectoryError
from encircle.world.scenario.model import Scenario

CUT_SHARE = 0.6
TIMED_MAX = 400
US_PER_NS, US_PER_S = 1e-3, 1e6
NEAR_LIMIT_SHARE = 0.8
RECORDING = "recording.mcap"


def check_payload(parts: Parts, robots: int) -> list[CheckResult]:
    """How large what it says is, and whether its numbers are the same on every machine."""
    said = [(p, k, d.say) for p in parts for k, d in enumerate(p.decisions) if d.say]
    if not said:
        return [CheckResult("payload", "ok", "it says nothing, which costs no bytes")]
    sizes = [len(msgpack.packb(say)) for _, _, say in said]
    largest = max(range(len(said)), key=sizes.__getitem__)
    part, k, _ = said[largest]
    text = (
        f"at most {sizes[largest]} of {SAY_BYTES_MAX} bytes ({part.robot} at tick"
        f" {part.views[k].tick}, {part.scene}), {sum(sizes) / len(sizes):.0f} in the mean; the"
        f" largest team here has {robots} robots"
    )
    if sizes[largest] > NEAR_LIMIT_SHARE * SAY_BYTES_MAX:
        advice = "a larger team, or a longer hunt, may need more: see --robots"
        results = [CheckResult("payload", "note", text, advice)]
    else:
        results = [CheckResult("payload", "ok", text)]
    unrounded = next((x for _, _, say in said for x in _floats(say) if not _is_rounded(x)), None)
    if unrounded is not None:
        results.append(
            CheckResult(
                "payload",
                "note",
                f"it says {unrounded!r}, no multiple of {QUANTUM_M:g} (2^-20)",
                "another machine's mathematics may differ in the last bit, and so the digest:"
                " round by encircle.protocol.messages.quantise_m",
            )
        )
    return results


def check_steps(parts: Parts) -> CheckResult:
    """How many steps are longer than the robot can make; these are shortened."""
    steps = [(d.step, v) for p in parts for v, d in zip(p.views, p.decisions, strict=True)]
    # Lengths in m on both sides; what is no longer than a micron more is not meant.
    longer = sum(hypot(*step) > v.parameters.step_m_max + QUANTUM_M for step, v in steps)
    if not longer:
        return CheckResult("steps", "ok", "none is longer than step_m_max")
    share = 100 * longer / len(steps)
    return CheckResult("steps", "ok", f"{share:.0f} % are longer than step_m_max, and shortened")


def check_replay(scenario: Scenario) -> list[CheckResult]:
    """A recorded hunt: fresh brains are to decide the same, and resumed it is to end the same."""
    with tempfile.TemporaryDirectory(prefix="encircle-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", ScenarioRemark)
        whole, cut = Path(folder) / "whole", Path(folder) / "cut"
        try:
            hunt = run(scenario, link="memory", out=whole)
            check = replay(whole)
        except (RunFailed, PluginFailed) as error:
            return [CheckResult("replay", "wrong", f"in another hunt {error}", PURE_ADVICE)]
        results = [CheckResult("replay", "ok", f"{check.compared} messages decided the same again")]
        if not check.same:
            tick, robot, channel = check.differences[0]
            results = [
                CheckResult(
                    "replay",
                    "wrong",
                    f"{channel} of {robot} at tick {tick} is decided otherwise when it is replayed",
                    PURE_ADVICE,
                )
            ]
        cut.mkdir()
        recorded = (whole / RECORDING).read_bytes()
        (cut / RECORDING).write_bytes(recorded[: int(CUT_SHARE * len(recorded))])
        try:
            same = resume(cut, link="memory").digest == hunt.digest
        except (RunFailed, PluginFailed, RunDirectoryError):
            same = False
        if same:
            text = f"cut off and resumed, a hunt of {hunt.result.ticks} ticks ends the same"
            return [*results, CheckResult("resume", "ok", text)]
        text = "a hunt that was cut off and resumed comes to another end"
        advice = "what a robot knows before the cut must follow from the views it has had"
        return [*results, CheckResult("resume", "wrong", text, advice)]


def check_time(subject: Subject, parts: Parts) -> CheckResult:
    """Time of a decision beside the default policy's, on the same views in turn.

    Of each view the shorter of two: the rest is the machine's.
    """
    own_us: list[float] = []
    default_us: list[float] = []
    for part in parts:
        memory: Any = None
        for view in part.views[: max(0, TIMED_MAX - len(own_us))]:
            own, default = [], []
            for _ in range(2):
                passed_us, answer = _timed(subject.ask, memory, view)
                own.append(passed_us)
                default.append(_timed(xi_star, None, view)[0])
            own_us.append(min(own))
            default_us.append(min(default))
            memory = answer[0]
    ratio = median(a / b for a, b in zip(own_us, default_us, strict=True))
    text = (
        f"{median(own_us):.0f} us a decision, {ratio:.1f} times the default's"
        f" (medians of {len(own_us)}); at most {max(own_us):.0f} us, the default"
        f" {max(default_us):.0f} us"
    )
    if max(own_us) > parts[0].views[0].tick_s * US_PER_S:
        advice = "by the clock a robot that is later than a tick repeats its last step"
        return CheckResult("time", "note", text, advice)
    return CheckResult("time", "ok", text)


def _timed(policy: Policy, memory: Any, view: View) -> tuple[float, Any]:
    """How long a decision takes, in us, and the answer."""
    begun = time.perf_counter_ns()
    answer = policy(memory, view)
    return (time.perf_counter_ns() - begun) * US_PER_NS, answer


def _floats(value: Any) -> Iterator[float]:
    if isinstance(value, float):
        yield value
    elif isinstance(value, dict):
        for part in value.values():
            yield from _floats(part)
    elif isinstance(value, tuple):
        for part in value:
            yield from _floats(part)


def _is_rounded(value: float) -> bool:
    return (value * QUANTA_PER_M).is_integer()
