"""Checks of what the paper claims about its simulations 1 to 3.

Each check is computed from the ground truth of one recorded run. A claim that does not hold is
reported as not holding. The paper does not give starts, obstacles or the target's behaviour, so the
runs use the paper's method in scenarios of ours, which are not the paper's own. Simulations 4 and 5
are in ``encircle.paper.reproduce``.
"""

from dataclasses import dataclass
from enum import StrEnum
from math import degrees, hypot, remainder, tau
from pathlib import Path
from typing import Any

import numpy as np

from encircle.figures.run_figures import draw_snapshots, draw_trajectories
from encircle.protocol.codec import decode
from encircle.protocol.messages import Observation
from encircle.runlog.ground_truth import (
    GroundTruth,
    estimates_agree,
    ground_truth_of,
    points_shared,
)
from encircle.runner.hunts import run
from encircle.world.recording.recording import Recording, read_recording

TURN_TICKS = 5
TURN_DEG_MIN = 20.0
HEADING_RIGHT_DEG_MAX = 45.0
ESTIMATE_ERROR_M_MAX = 0.5


class ClaimStatus(StrEnum):
    """Whether a claim of the paper holds here.

    A claim about many runs is undecided unless a confidence interval decides it. A claim about
    a single run holds or does not. ``NO_CLAIM`` marks a number that is reported without a
    claim.
    """

    YES = "yes"
    NO = "no"
    UNDECIDED = "undecided"
    NO_CLAIM = "no claim"


def status_of(so: bool) -> ClaimStatus:
    """The status of a claim about a single run or a count of runs."""
    return ClaimStatus.YES if so else ClaimStatus.NO


@dataclass(frozen=True, slots=True)
class ClaimCheck:
    """A claim's status, and a sentence with the numbers."""

    holds: ClaimStatus
    text: str


@dataclass(frozen=True, slots=True)
class Simulation:
    """One simulation: what the paper says, its figure, the checks, and the facts behind them.

    ``facts``: numbers for JSON, by name. ``table``: lines of text for the report.
    """

    name: str
    paper: str
    figure: Path
    checks: tuple[ClaimCheck, ...]
    facts: dict[str, Any]
    table: tuple[str, ...] = ()


def run_and_read(out: Path, name: str) -> tuple[Recording, GroundTruth, dict[str, Any]]:
    """Run a shipped scenario and read its recording.

    Returns recording, ground truth, and the facts that all simulations report.
    """
    hunt = run(name, link="memory", out=out / name)
    recording = read_recording(out / name)
    ground_truth = ground_truth_of(recording)
    gap_m, gap_tick, pair = ground_truth.least_gap()
    observed = recording.of_channel("observation")
    first = [decode(Observation, p, recording.run) for tick, _, p in observed if tick == 0]
    facts = {
        "title": hunt.scenario.title,
        "digest": hunt.digest,
        "seed": hunt.seed,
        "captured": hunt.captured,
        "capture_tick": hunt.capture_tick,
        "ticks": hunt.result.ticks,
        "detecting_at_start": [o.robot for o in first if o.target is not None],
        "least_gap_m": gap_m,
        "least_gap_tick": gap_tick,
        "least_gap_pair": list(pair),
        "contact_ticks": _contact_ticks(ground_truth),
    }
    return recording, ground_truth, facts


def _contact_ticks(ground_truth: GroundTruth) -> dict[str, int]:
    """At how many ticks two bodies touched, by the kinds of the two, such as ``obstacle-robot``."""
    counts: dict[str, int] = {}
    for pairs in ground_truth.contacts:
        kinds = {"-".join(sorted(_body_kind(name) for name in pair)) for pair in pairs}
        for kind in sorted(kinds):
            counts[kind] = counts.get(kind, 0) + 1
    return counts


def _body_kind(name: str) -> str:
    return "target" if name == "target" else name.split("-")[0] if "-" in name else "robot"


def check_capture(ground_truth: GroundTruth) -> ClaimCheck:
    """Whether and when the target was captured."""
    return ClaimCheck(status_of(ground_truth.captured), ground_truth.outcome)


def check_no_overlap(facts: dict[str, Any]) -> ClaimCheck:
    """Whether bodies stayed apart at every tick, and at how many ticks they touched."""
    touched = ", ".join(f"{kind} at {n}" for kind, n in facts["contact_ticks"].items()) or "none"
    gap_m, pair = facts["least_gap_m"], " and ".join(facts["least_gap_pair"])
    which = f"{pair} at tick {facts['least_gap_tick']}; ticks with contact: {touched}"
    if gap_m < 0.0:
        return ClaimCheck(ClaimStatus.NO, f"bodies overlapped by {-1000.0 * gap_m:.3f} mm: {which}")
    return ClaimCheck(
        ClaimStatus.NO_CLAIM,
        f"no bodies overlapped: least free distance {1000 * gap_m:.3f} mm, {which}",
    )


def check_simulation_1(
    out: Path, recording: Recording, ground_truth: GroundTruth, facts: dict[str, Any]
) -> Simulation:
    """Check simulation 1: where the target runs and when it turns; draws Fig. 3 into ``out``."""
    seen = ground_truth.first_sight("r3")
    detecting = facts["detecting_at_start"]
    only = f"only {detecting[0]}" if len(detecting) == 1 else ", ".join(detecting) or "no robot"
    checks = [
        ClaimCheck(status_of(detecting == ["r1"]), f"at the start {only} detects the target"),
        *_check_turn(ground_truth, seen, facts),
        check_capture(ground_truth),
        check_no_overlap(facts),
    ]
    last, met = ground_truth.last_tick, ground_truth.last_tick // 2 if seen is None else seen
    ticks = [0, max(0, met - 1), min(met + TURN_TICKS, last), last]
    captions = (
        "start",
        "r3 not yet detected",
        "r3 detected",
        "captured" if ground_truth.captured else "end",
    )
    figure = draw_snapshots(recording, ticks, out / "fig3.png", captions)
    paper = (
        "Initially only R1 can detect the target, which tries to escape toward the right, changes"
        " its direction after it finds R3, and is captured (Fig. 3)."
    )
    return Simulation("sim1", paper, figure, tuple(checks), facts)


def _check_turn(
    ground_truth: GroundTruth, seen: int | None, facts: dict[str, Any]
) -> list[ClaimCheck]:
    """Where the target runs until it detects r3 at tick ``seen``, and how it turns then."""
    facts["target_detects_r3_tick"] = seen
    if not seen:
        return [
            ClaimCheck(
                ClaimStatus.NO, "the target does not come upon r3: there is no turn to measure"
            )
        ]
    run_x, run_y = (ground_truth.target[ground_truth.row(seen)] - ground_truth.target[0]).tolist()
    heading = degrees(float(np.arctan2(run_y, run_x)))
    # The target can react to r3 with the step from tick `seen` at the earliest.
    before, first = ground_truth.heading_rad(seen - 1), ground_truth.heading_rad(seen)
    last = min(seen + TURN_TICKS, ground_truth.last_tick) - 1
    turn = degrees(remainder(ground_truth.heading_rad(last) - before, tau))
    at_once = degrees(remainder(first - before, tau))
    earlier = ground_truth.heading_rad(max(0, seen - 1 - TURN_TICKS))
    drift = degrees(remainder(before - earlier, tau))
    others = [
        r for r in ground_truth.arena.ids if r != "r3" and (ground_truth.first_sight(r) or 0) > 0
    ]
    also = [
        f"{r} from tick {t}" for r in others if (t := ground_truth.first_sight(r)) and t <= last
    ]
    facts.update(
        target_heading_deg=heading, turn_deg=turn, first_turn_deg=at_once, earlier_turn_deg=drift
    )
    return [
        ClaimCheck(
            status_of(abs(heading) <= HEADING_RIGHT_DEG_MAX),
            f"until it detects r3 the target runs {hypot(run_x, run_y):.1f} m towards"
            f" {heading:+.0f} deg (0 is right)",
        ),
        ClaimCheck(
            status_of(abs(turn) >= TURN_DEG_MIN),
            f"it detects r3 at tick {seen} and turns {turn:+.0f} deg in {TURN_TICKS} ticks,"
            f" {at_once:+.0f} of them at once; in as many ticks before: {drift:+.0f} deg"
            + (f"; by then it also detects {', '.join(also)}" if also else ""),
        ),
    ]


def check_simulation_2(
    out: Path, recording: Recording, ground_truth: GroundTruth, facts: dict[str, Any]
) -> Simulation:
    """Check simulation 2: collisions and shared encirclement points; draws Fig. 4 into ``out``."""
    shared, ticks = points_shared(recording)
    count = len(ground_truth.arena.ids)
    nearest_m = float(ground_truth.gaps[:, :count, count + 1 :].min())
    contacts = facts["contact_ticks"]
    touched = {kind: contacts.get(kind, 0) for kind in ("robot-robot", "obstacle-robot")}
    facts.update(robot_obstacle_gap_m=nearest_m, ticks_encircling=ticks, ticks_point_shared=shared)
    checks = (
        check_capture(ground_truth),
        ClaimCheck(
            status_of(not any(touched.values())),
            f"no collision: robots touched one another at {touched['robot-robot']} ticks and"
            f" obstacles at {touched['obstacle-robot']}, nearest {nearest_m:.2f} m",
        ),
        ClaimCheck(
            status_of(shared == 0),
            f"encirclement points are coordinated: at {shared} of {ticks} ticks with two or more"
            " robots encircling did two of them make for the same point",
        ),
        check_no_overlap(facts),
    )
    paper = (
        "Three robots among obstacles achieve effective coordination by reasonable arrangement of"
        " encirclement points (Fig. 4)."
    )
    return Simulation("sim2", paper, draw_trajectories(recording, out / "fig4.png"), checks, facts)


def check_simulation_3(
    out: Path, recording: Recording, ground_truth: GroundTruth, facts: dict[str, Any]
) -> Simulation:
    """Check simulation 3: the target is moved by hand; draws Fig. 5 into ``out``.

    ``out`` must already hold the run of simulation 1.
    """
    undisturbed = ground_truth_of(read_recording(out / "sim1"))
    moved = ground_truth.moved_by_hand[0] if ground_truth.moved_by_hand else ground_truth.last_tick
    row = ground_truth.row(moved)
    same = np.array_equal(ground_truth.positions[:row], undisturbed.positions[:row])
    far_m = float(np.hypot(*(ground_truth.target[row] - ground_truth.target[row - 1])))
    caught_up = estimates_agree(recording, ground_truth, moved, ESTIMATE_ERROR_M_MAX)
    reach = np.hypot(*(ground_truth.robots - ground_truth.target[:, None]).transpose(2, 0, 1))
    before_m, after_m = float(reach[row - 1].max()), float(reach[row].max())
    other = undisturbed.outcome
    facts.update(moved_tick=moved, moved_m=far_m, caught_up_tick=caught_up, same_until_moved=same)
    checks = (
        ClaimCheck(
            status_of(same), f"as simulation 1 up to tick {moved - 1}, position by position"
        ),
        ClaimCheck(
            ClaimStatus.NO_CLAIM,
            f"at tick {moved} the target is moved by {far_m:.1f} m: the farthest robot was"
            f" {before_m:.1f} m from it and is now {after_m:.1f} m",
        ),
        ClaimCheck(
            status_of(caught_up is not None),
            "the robots adjust: "
            + (
                f"all estimates are within {ESTIMATE_ERROR_M_MAX} m of the target at tick"
                f" {caught_up}"
                if caught_up is not None
                else f"never are all estimates within {ESTIMATE_ERROR_M_MAX} m of the target again"
            ),
        ),
        ClaimCheck(
            status_of(ground_truth.captured),
            f"{ground_truth.outcome}, {ground_truth.last_tick - moved} ticks after the move"
            f" (undisturbed: {other})",
        ),
        check_no_overlap(facts),
    )
    last = ground_truth.last_tick
    ticks = [0, moved - 1, min(moved + TURN_TICKS, last), last]
    captions = (
        "start",
        "before the move",
        "after the move",
        "captured" if ground_truth.captured else "end",
    )
    figure = draw_snapshots(recording, ticks, out / "fig5.png", captions)
    paper = (
        "Under the same conditions as simulation 1 the target is moved manually to a new position;"
        " the robots make timely adjustment and capture it (Fig. 5)."
    )
    return Simulation("sim3", paper, figure, checks, facts)
