"""The paper's five simulations: run, drawn, and compared with what the paper claims.

Simulations 1 to 3 are single runs, checked in ``encircle.paper.claims``. For simulation 4 the
capture rate is measured too. For simulation 5 execution times are measured over many paired runs
(``encircle.paper.execution_times``).
"""

import json
import textwrap
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from encircle.figures.run_figures import TimeCurve, draw_execution_times, draw_trajectories
from encircle.paper.claims import (
    ClaimCheck,
    ClaimStatus,
    Simulation,
    check_no_overlap,
    check_simulation_1,
    check_simulation_2,
    check_simulation_3,
    run_and_read,
    status_of,
)
from encircle.paper.execution_times import (
    JITTER_M,
    NOISE_M_STD,
    POLICIES,
    SLOW_STEP_M,
    SURROUNDED_M,
    X_OF_R3_M,
    XI_STAR,
    ExecutionTimes,
    MeanInterval,
    capture_count,
    execution_times_as_dict,
    measure_captures,
    measure_execution_times,
)
from encircle.progress import Tell, no_progress
from encircle.protocol.process.interrupts import check, signals_held
from encircle.runlog.ground_truth import GroundTruth
from encircle.statistics.comparisons import Verdict, rate_difference
from encircle.whole_directory import emptied_on_failure
from encircle.world.recording.recording import Recording
from encircle.world.recording.run_directory import create, versions

RANDOM_STARTS = 200
LINE_CHARACTERS_MAX = 98
STATUS_OF_VERDICT = {
    Verdict.HIGHER: ClaimStatus.YES,
    Verdict.LOWER: ClaimStatus.NO,
    Verdict.UNDECIDED: ClaimStatus.UNDECIDED,
}
STATUS_MARKS = {
    ClaimStatus.YES: "yes",
    ClaimStatus.NO: "NO",
    ClaimStatus.UNDECIDED: "undecided",
    ClaimStatus.NO_CLAIM: "",
}


@dataclass(frozen=True, slots=True)
class PaperReport:
    """What ``encircle reproduce`` has checked: directory, paired seeds, duration, simulations."""

    out: Path
    seeds: int
    wall_s: float
    simulations: tuple[Simulation, ...]

    def as_dict(self) -> dict[str, Any]:
        """The report for JSON: every number of the text, and the numbers behind them."""
        return {
            "out": str(self.out),
            "seeds": self.seeds,
            "wall_s": self.wall_s,
            "versions": versions(),
            "simulations": {
                s.name: {
                    "paper": s.paper,
                    "figure": str(s.figure),
                    "findings": [{"holds": f.holds, "text": f.text} for f in s.checks],
                    **s.facts,
                }
                for s in self.simulations
            },
        }

    def text(self) -> str:
        """The report for a terminal, at most 100 columns wide."""
        lines = [
            f"The paper's simulations 1 to 5; {self.seeds} paired seeds in 5 ({self.wall_s:.0f} s)",
            "yes: as the paper says; NO: not so here; undecided: these runs do not tell it.",
            "Without a mark: measured beside it. What is said of many runs goes by 95 % intervals.",
            "Starts, obstacles and the target's behaviour are not in the paper; they are ours.",
        ]
        for simulation in self.simulations:
            lines += ["", f"{simulation.facts['title']}  ({simulation.figure.name})"]
            lines += _wrapped(f"{'paper':>9} ", simulation.paper)
            for finding in simulation.checks:
                lines += _wrapped(f"{STATUS_MARKS[finding.holds]:>9} ", finding.text)
            lines += [f"  {line}" for line in simulation.table]
        return "\n".join(lines)


def reproduce(
    out: Path,
    seeds: int,
    *,
    random_starts: int = RANDOM_STARTS,
    x_m: Sequence[float] = X_OF_R3_M,
    progress: Callable[[str], AbstractContextManager[Tell]] = lambda _name: nullcontext(
        no_progress
    ),
) -> PaperReport:
    """Run the paper's simulations into the directory ``out``, which must be new or empty.

    ``seeds``: paired runs for each start of R3 and policy in simulation 5, at least 2.
    ``random_starts``: runs behind each rate of simulation 4. ``x_m``: starts of R3 in m in
    simulation 5. ``progress`` is entered with the name of each simulation, and its value is
    called with numbers of runs. The function starts processes, so a script calls it under ``if
    __name__ == "__main__"``. If it is interrupted, it leaves nothing in ``out``. Raises
    ``RunDirectoryError`` if ``out`` is not empty and ``Interrupted`` after Ctrl-C.
    """
    assert seeds >= 2, f"{seeds} seeds give no interval"
    begin_s = time.perf_counter()
    with signals_held(), emptied_on_failure(create(out)):
        simulations = []
        for number, judge in enumerate(
            (check_simulation_1, check_simulation_2, check_simulation_3), start=1
        ):
            with progress(f"simulation {number}"):
                simulations.append(judge(out, *run_and_read(out, f"sim{number}")))
            check()
        with progress("simulation 4") as tell:
            simulations.append(
                _check_simulation_4(out, *run_and_read(out, "sim4"), random_starts, tell)
            )
        with progress("simulation 5") as tell:
            simulations.append(
                _check_simulation_5(out, *run_and_read(out, "sim5")[1:], x_m, seeds, tell)
            )
        report = PaperReport(out, seeds, time.perf_counter() - begin_s, tuple(simulations))
        (out / "report.txt").write_text(report.text() + "\n", encoding="utf-8")
        as_json = json.dumps(report.as_dict(), indent=2, allow_nan=False)
        (out / "report.json").write_text(as_json + "\n", encoding="utf-8")
    return report


def _check_simulation_4(
    out: Path,
    recording: Recording,
    ground_truth: GroundTruth,
    facts: dict[str, Any],
    runs: int,
    tell: Tell,
) -> Simulation:
    captured = measure_captures(runs, tell)
    rates = {name: capture_count(flags) for name, flags in captured.items()}
    slower = rate_difference(captured["fast"], captured["slow"])
    facts["capture_rates"] = {name: count._asdict() for name, count in rates.items()}
    facts["slow_minus_fast"] = {**slower.mean._asdict(), "p": slower.p}
    target, team = ground_truth.scenario.target, ground_truth.scenario.team
    faster = 100.0 * (target.step_m_max / team.step_m_max - 1.0)
    fast, slow, near = rates["fast"], rates["slow"], rates["near"]
    low_m, high_m = team.placement.distance_m_min, team.placement.distance_m_max
    checks = (
        ClaimCheck(
            status_of(ground_truth.captured),
            f"target {faster:.0f} % faster than the robots, from one chosen start:"
            f" {ground_truth.outcome}",
        ),
        ClaimCheck(
            ClaimStatus.NO_CLAIM,
            f"from that start, every robot moved by up to {JITTER_M} m per axis: captured (within"
            f" {ground_truth.scenario.ticks_max} ticks) {near}",
        ),
        ClaimCheck(
            ClaimStatus.NO_CLAIM,
            f"from random starts {low_m:g} to {high_m:g} m away: captured {fast}"
            + ("; most fail, so that success hangs on the start" if fast.high < 0.5 else ""),
        ),
        ClaimCheck(
            STATUS_OF_VERDICT[slower.uncorrected_verdict],
            "the faster the target, the likelier it escapes: from the same random starts at a step"
            f" of {SLOW_STEP_M} m captured {slow}; {slower.mean.signed_text(100.0)} points, by"
            " start",
        ),
        check_no_overlap(facts),
    )
    paper = (
        "With a target 30 percent faster the task is completed smoothly; the higher its speed, the"
        " larger the possibility of its being out of the encirclement (Fig. 6)."
    )
    return Simulation("sim4", paper, draw_trajectories(recording, out / "fig6.png"), checks, facts)


def _check_simulation_5(
    out: Path,
    ground_truth: GroundTruth,
    facts: dict[str, Any],
    x_m: Sequence[float],
    seeds: int,
    tell: Tell,
) -> Simulation:
    times, exact = measure_execution_times(x_m, seeds, tell)
    curves = [
        TimeCurve(
            label,
            times.x_m,
            np.array([times.typical(k, policy) for k in range(len(x_m))]),
            np.array([times.mean(k, policy) for k in range(len(x_m))]),
            tuple(times.missed[:, policy].tolist()),
        )
        for policy, label in enumerate(POLICIES.values())
    ]
    facts["execution_times"] = execution_times_as_dict(times, exact)
    checks = (
        ClaimCheck(status_of(bool(times.captured.all())), _captures_text(times)),
        *_check_fastest(times, exact),
        ClaimCheck(ClaimStatus.NO_CLAIM, f"the scenario as shipped, xi*: {ground_truth.outcome}"),
        check_no_overlap(facts),
    )
    paper = (
        "In the environment of simulation 1 with R3 at different initial x, all four approaches"
        " fulfil the task, and the proposed one (xi*) achieves a shorter execution time (Fig. 7)."
    )
    figure = draw_execution_times(curves, out / "fig7.png")
    return Simulation("sim5", paper, figure, checks, facts, _table(times))


def _captures_text(times: ExecutionTimes) -> str:
    """How many runs of each policy capture, as a sentence."""
    runs = times.captured.shape[0] * times.captured.shape[2]
    counts = times.captured.sum(axis=(0, 2)).tolist()
    each = ", ".join(f"{label} {n}" for label, n in zip(POLICIES.values(), counts, strict=True))
    missed = int((~times.captured).sum())
    surrounded = (
        f"; of {missed} without capture {times.surrounded_count} end with the target surrounded"
    )
    return (
        f"all fulfil the task: captures within {times.ticks_max} ticks in {runs} runs each (starts"
        f" moved by up to {JITTER_M} m per axis, detection noise {NOISE_M_STD} m, both paired):"
        f" {each}" + (surrounded + f", all robots within {SURROUNDED_M} m" if missed else "")
    )


def _check_fastest(times: ExecutionTimes, exact: ExecutionTimes) -> list[ClaimCheck]:
    """Whether xi* is fastest: in all, against each other policy, and in single exact runs."""
    others = [
        (policy, label) for policy, label in enumerate(POLICIES.values()) if policy != XI_STAR
    ]
    typical = [times.difference(policy) for policy, _ in others]
    mean = [times.difference_mean(policy) for policy, _ in others]
    details = []
    for (policy, label), typical_interval, mean_interval in zip(others, typical, mean, strict=True):
        earlier, later, level = times.order(policy)
        details.append(
            ClaimCheck(
                ClaimStatus.NO_CLAIM,
                f"{label} minus xi*, in ticks: typical {typical_interval:+}, mean"
                f" {mean_interval:+};"
                f" xi* is earlier in {earlier} pairs, later in {later}, level in {level}",
            )
        )
    ticks = exact.ticks[:, :, 0]
    best = ticks == ticks.min(axis=1)[:, None]
    alone = best[:, XI_STAR] & (best.sum(axis=1) == 1)
    return [
        _check_shorter("typical", times.overall(XI_STAR).mean, typical),
        _check_shorter("mean", times.overall_mean(XI_STAR).mean, mean),
        *details,
        ClaimCheck(
            ClaimStatus.NO_CLAIM,
            "one run per start without noise, as in Fig. 7: xi* is fastest at"
            f" {best[:, XI_STAR].sum()} of {len(ticks)} starts, alone at {alone.sum()};"
            f" {(~exact.captured).sum()} of {exact.captured.size} runs do not capture",
        ),
    ]


def _check_shorter(name: str, star_ticks: float, differences: Sequence[MeanInterval]) -> ClaimCheck:
    """Whether every other policy takes longer than xi*, by one kind of execution time."""
    longer, shorter = (
        sum(d.low > 0.0 for d in differences),
        sum(d.high < 0.0 for d in differences),
    )
    sizes = ", ".join(f"{100.0 * d.mean / star_ticks:+.1f} %" for d in differences)
    holds = (
        status_of(not shorter) if shorter or longer == len(differences) else ClaimStatus.UNDECIDED
    )
    return ClaimCheck(
        holds,
        f"by the {name} execution time xi* is decidedly shorter than {longer} of the"
        f" {len(differences)} others and longer than {shorter}, by intervals of 95 % for all three"
        f" together; they differ from its {star_ticks:.1f} ticks by {sizes}",
    )


def _table(times: ExecutionTimes) -> tuple[str, ...]:
    """Execution times as lines of text."""
    starts, policies = range(len(times.x_m)), range(len(POLICIES))
    rows = [("x (m)", list(POLICIES.values()))]
    for start_index in starts:
        cells = [f"{times.typical(start_index, policy)}" for policy in policies]
        missed = times.missed[start_index].tolist()
        marks = [f" ({n})" if n else "" for n in missed]
        rows.append(
            (f"{times.x_m[start_index]:.1f}", [c + m for c, m in zip(cells, marks, strict=True)])
        )
    rows.append(("all", [f"{times.overall(policy)}" for policy in policies]))
    rows.append(("mean", [f"{times.overall_mean(policy)}" for policy in policies]))
    lines = [f"{lead:>6}  " + "".join(f"{c:<22}" for c in cells).rstrip() for lead, cells in rows]
    return (
        "Typical execution time in ticks (mean of the middle half) [95 %];",
        f"(n): n runs without capture in {times.ticks_max} ticks; mean: these counted as"
        f" {times.ticks_max}, a lower bound.",
        "Intervals of means allow for runs without capture that the seeds do not show.",
        *lines,
    )


def _wrapped(lead: str, text: str) -> list[str]:
    return textwrap.wrap(
        text, LINE_CHARACTERS_MAX, initial_indent=lead, subsequent_indent=" " * len(lead)
    )
