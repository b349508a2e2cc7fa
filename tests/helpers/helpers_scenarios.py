"""Scenarios drawn at random, by seed: every kind of every stage that a scenario can name.

Each part of a scenario has a function that draws it, and each kind of loss, delay, event, motion,
behaviour and parameter an entry; ``tests/world/scenario/test_scenarios_drawn.py`` holds them
against the models, so that a kind that is added there is missed here. Left out is what cannot be
repeated: runs by the clock, and robots that hear each other directly.
"""

import random
from collections.abc import Callable
from math import cos, pi, sin
from typing import Any

from encircle.world.arena.engine import build
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

TRIES_MAX = 50
ROBOTS = range(2, 9)
TICKS = (25, 60)
TRACE_ROWS_MAX = 12
Draws = random.Random
Tree = dict[str, Any]
DrawnFigure = Callable[[Draws], Any]


def scenario_of(seed: int) -> Scenario:
    """The scenario of a seed; some random teams cannot be placed, then the next draw counts."""
    draws = random.Random(f"scenario {seed}")
    for _ in range(TRIES_MAX):
        tree = _tree(draws)
        try:
            scenario = load(tree)
            build(scenario, scenario.seed)
        except ScenarioError:
            continue
        return scenario
    raise AssertionError(f"no scenario for seed {seed} in {TRIES_MAX} tries")


def _tree(draws: Draws) -> Tree:
    count, ticks = draws.choice(ROBOTS), draws.randint(*TICKS)
    ids = [f"r{k + 1}" for k in range(count)]
    radius_m = draws.choice((0.5, 0.3))
    tree = {
        "title": f"Drawn, with {count} robots",
        "description": "One of many",
        "seed": draws.randrange(2**32),
        "tick_s": draws.choice((0.1, 0.1, 0.04, 0.5)),
        "ticks_max": ticks,
        "team": _team(draws, count, radius_m),
        "target": _target(draws),
        "sensing": {"rays": draws.choice((8, 12, 24)), "noise_m_std": draws.choice((0.0, 0.1))},
        "obstacles": [
            {"position": [draws.uniform(-8, 8), draws.uniform(8.5, 12)], "radius_m": 1.0}
            for _ in range(draws.randint(0, 2))
        ],
        "robot": drawn_parameters(draws),
        "channel": drawn_channel(draws, ids),
        "events": _events(draws, ids, ticks),
        "capture": {"stop_distance_m": draws.choice((1.3, 1.5, 2.0))},
    }
    if _sometimes(draws):
        tree["capture"]["count"] = draws.randint(2, count)
    tree["sensing"] |= _some(draws, LOCALISATION, 0.2)
    if _sometimes(draws):
        singles = draws.sample(ids, draws.randint(1, count))
        robots: Tree = {robot: _some(draws, SINGLE_ROBOT, 0.5) for robot in singles}
        if "robots" in tree["team"]:
            robots["count"] = count
        tree["team"]["robots"] = robots
    return tree


def _sometimes(draws: Draws, share: float = 0.3) -> bool:
    return draws.random() < share


def _some(draws: Draws, table: dict[str, DrawnFigure], share: float) -> Tree:
    return {name: draw(draws) for name, draw in table.items() if _sometimes(draws, share)}


# The bodies.


def _team(draws: Draws, count: int, radius_m: float) -> Tree:
    team: Tree = {
        "strategy": draws.choice(STRATEGIES),
        "motion": draws.choice(MOTIONS),
        "radius_m": radius_m,
        **_some(draws, TEAM, 0.3),
    }
    if _sometimes(draws):
        turn, apart = draws.uniform(0, 2 * pi), 2 * pi / count
        away_m = [draws.uniform(3.0, 7.0) for _ in range(count)]
        bearings = [turn + k * apart for k in range(count)]
        team["positions"] = [
            [m * cos(b), m * sin(b)] for m, b in zip(away_m, bearings, strict=True)
        ]
        team["jitter_m"] = draws.choice((0.0, 0.2))
    else:
        team["robots"] = count
        team["placement"] = {"distance_m_min": 2.0, "distance_m_max": draws.choice((4.0, 7.0))}
    return team


STRATEGIES = (
    *("xi-star", "xi-0", "xi-1", "xi-3", "pursuit"),
    *("auction", "hungarian-consensus", "intents"),
    *("closed-ring", "voronoi", "group-chase"),
)
MOTIONS = ("holonomic", "unicycle")
TEAM: dict[str, DrawnFigure] = {
    "turn_rad_max": lambda draws: draws.uniform(0.1, 1.5),
    "step_m_max": lambda draws: draws.uniform(0.15, 0.5),
    "sensing_range_m": lambda draws: draws.uniform(3.0, 9.0),
    "hold_ticks_max": lambda draws: draws.randint(0, 9),
}


SINGLE_ROBOT: dict[str, DrawnFigure] = {
    "strategy": lambda draws: draws.choice(STRATEGIES),
    "step_m_max": lambda draws: draws.uniform(0.05, 0.5),
    "sensing_range_m": lambda draws: draws.uniform(1.0, 9.0),
    "radio_range_m": lambda draws: draws.uniform(2.0, 9.0),
    "loss_rate": lambda draws: draws.uniform(0.0, 1.0),
}
LOCALISATION: dict[str, DrawnFigure] = {
    "localisation_noise_m_std": lambda draws: draws.uniform(0.0, 0.5),
    "localisation_drift_m_per_sqrt_s": lambda draws: draws.uniform(0.0, 0.5),
}


def _target(draws: Draws) -> Tree:
    behaviour = draws.choice(tuple(BEHAVIOURS))
    parameters = {name: draw(draws) for name, draw in BEHAVIOURS[behaviour].items()}
    return {
        "behaviour": behaviour,
        "parameters": parameters,
        "position": draws.choice(([0.0, 0.0], [0.25, -0.5])),
        "step_m_max": draws.choice((0.1, 0.2, 0.35)),
        **_some(draws, TARGET, 0.3),
    }


def _place(draws: Draws) -> list[float]:
    return [draws.uniform(-4, 4), draws.uniform(-4, 4)]


BEHAVIOURS: dict[str, dict[str, DrawnFigure]] = {
    "flee": {"obstacle_range_m": lambda draws: draws.uniform(0.5, 3.0)},
    "gap": {"obstacle_range_m": lambda draws: draws.uniform(0.5, 3.0)},
    "straight": {},
    "patrol": {"waypoints": lambda draws: [_place(draws) for _ in range(draws.randint(1, 4))]},
    "still": {},
}
TARGET: dict[str, DrawnFigure] = {
    "heading_rad": lambda draws: draws.uniform(-pi, pi),
    "radius_m": lambda draws: draws.uniform(0.2, 0.7),
    "sensing_range_m": lambda draws: draws.uniform(2.0, 9.0),
}

# The robots' parameters.


def drawn_parameters(draws: Draws) -> Tree:
    """The robots' parameters: mostly a few, sometimes many, often none."""
    robot = _some(draws, PARAMETERS, draws.choice((0.0, 0.1, 0.4)))
    if str(robot.get("detections")).startswith("fuse"):
        robot.pop("publish", None)  # estimates are told always
    return robot


def _one_of(*choices: Any) -> DrawnFigure:
    return lambda draws: draws.choice(choices)


def _number(low: float, high: float) -> DrawnFigure:
    return lambda draws: draws.uniform(low, high)


def _whole(low: int, high: int) -> DrawnFigure:
    return lambda draws: draws.randint(low, high)


PARAMETERS: dict[str, DrawnFigure] = {
    "ring_radius_m": _number(2.0, 5.0),
    "xi_grid": _one_of([0.0, 2.0], [1.5], [0.0, 0.5, 1.0, 8.0]),
    "xi_weight": _number(0.0, 0.5),
    "near_factor": _number(1.0, 2.0),
    "deviation_gain": _number(0.5, 3.0),
    "enclosure_rad": _number(0.5 * pi, 1.5 * pi),
    "enclosure": _one_of("gap", "span", "printed"),
    "allowance_rad": _number(0.05, 0.6),
    "deviation_rad_max": _number(0.3, 1.5),
    "spline_samples": _whole(2, 6),
    "spline_spacing_ticks": _whole(1, 4),
    "spline_ends": _one_of("natural", "not-a-knot"),
    "measurement_m_std": _number(0.01, 0.2),
    "acceleration_mps2_std": _number(1.0, 20.0),
    "velocity_mps_std": _number(0.5, 5.0),
    "window_ticks": _whole(5, 40),
    "track_age_ticks_max": _whole(3, 40),
    "late_detections": _one_of("refilter", "ignore"),
    "detections": _one_of("own", "relay", "relay", "fuse", "fuse-naive"),
    "relay_age_ticks_max": _whole(1, 20),
    "publish": _one_of("always", "event", "event"),
    "publish_every_ticks": _whole(1, 4),
    "publish_error_m": _number(0.0, 1.0),
    "publish_age_ticks_max": _whole(2, 20),
    "peer_policy": _one_of("hold", "extrapolate"),
    "extrapolate_ticks_max": _whole(0, 20),
    "peer_age_ticks_max": _whole(2, 30),
    "assignment": _one_of("shortest", "shortest", "cyclic"),
    "switch_gain_m": _number(0.0, 2.0),
    "search": _one_of("hold", "spiral"),
    "silence_ticks_max": _whole(1, 20),
    "clearance_m": _number(0.0, 0.2),
}

# The radio.


def drawn_channel(draws: Draws, ids: list[str]) -> Tree:
    """The radio of a team."""
    channel: Tree = {
        "loss": _loss(draws, ids),
        "delay": _delay(draws, ids),
        "duplication": {"rate": draws.choice((0.0, 0.0, 0.3, 1.0))},
        "order": draws.choice(("free", "kept")),
        "links": [_link(draws, ids) for _ in range(draws.choice((0, 0, 1, 2)))],
    }
    if _sometimes(draws):
        channel["rate_limit"] = _some(draws, RATES, 0.5) or {"packets_per_s": 6.0}
        channel["rate_limit"]["queue_packets_max"] = draws.randint(0, 5)
    if _sometimes(draws, 0.2):
        channel["contention"] = {
            "access": draws.choice(("aloha", "slotted-aloha")),
            "packet_s": draws.uniform(0.001, 0.02),
        }
        if _sometimes(draws, 0.5):
            channel["contention"]["range_m"] = draws.uniform(4.0, 12.0)
    return channel


def _link(draws: Draws, ids: list[str]) -> Tree:
    ends = dict(zip(("sender", "receiver"), draws.sample(ids, 2), strict=True))
    link: Tree = {end: robot for end, robot in ends.items() if _sometimes(draws, 0.7)}
    if _sometimes(draws, 0.6):
        link["loss"] = _loss(draws, ids)
    if _sometimes(draws, 0.6):
        link["delay"] = _delay(draws, ids)
    return link


def _loss(draws: Draws, ids: list[str]) -> Tree:
    model = draws.choice((*LOSSES, "trace"))
    if model == "trace":
        return _trace(draws, ids, lambda: draws.randint(0, 1))
    return {"model": model, **{name: draw(draws) for name, draw in LOSSES[model].items()}}


def _delay(draws: Draws, ids: list[str]) -> Tree:
    model = draws.choice((*DELAYS, "trace"))
    if model == "trace":
        return _trace(draws, ids, lambda: draws.choice((None, *[draws.uniform(0, 1)] * 4)))
    keys = {name: draw(draws) for name, draw in DELAYS[model].items()}
    if "high_s" in keys:
        keys["high_s"] += keys["low_s"]
    return {"model": model, **keys}


RATES: dict[str, DrawnFigure] = {
    "packets_per_s": _number(3.0, 30.0),
    "bytes_per_s": _number(300.0, 3000.0),
}
LOSSES: dict[str, dict[str, DrawnFigure]] = {
    "none": {},
    "bernoulli": {"rate": _number(0.0, 1.0)},
    "gilbert-elliott": {
        "good_to_bad": _number(0.0, 0.5),
        "bad_to_good": _number(0.1, 1.0),
        "loss_good": _number(0.0, 0.3),
        "loss_bad": _number(0.5, 1.0),
    },
    "burst": {"rate": _number(0.0, 0.5), "burst_packets": _number(1.0, 9.0)},
    "distance": {
        "midpoint_m": _number(2.0, 9.0),
        "width_m": _number(0.1, 3.0),
        "cutoff_m": _number(3.0, 12.0),
    },
    "range": {"cutoff_m": _number(3.0, 12.0)},
    "path-loss": {
        "range_m": _number(3.0, 12.0),
        "exponent": _number(1.5, 5.0),
        "fading": _one_of("rayleigh", "none"),
        "coherence_s": _one_of(0.0, 0.3),
        "shadowing_db": _one_of(0.0, 5.0),
        "shadowing_s": _one_of(0.5, 5.0),
    },
}
DELAYS: dict[str, dict[str, DrawnFigure]] = {
    "constant": {"mean_s": _one_of(0.0, 0.1, 0.26)},
    "uniform": {"low_s": _number(0.0, 0.3), "high_s": _number(0.0, 0.6)},
    "gamma": {"mean_s": _number(0.05, 0.6), "std_s": _number(0.05, 0.6)},
    "lognormal": {"mean_s": _number(0.05, 0.6), "std_s": _number(0.05, 0.6)},
    "normal": {"mean_s": _number(0.0, 0.6), "std_s": _number(0.05, 0.6)},
    # Longer ones too: detections then come too late for the filter's window.
    "exponential": {"mean_s": _one_of(0.0, 0.3, 2.0)},
}


def _trace(draws: Draws, ids: list[str], value: Callable[[], Any]) -> Tree:
    """Rows for all links, and sometimes others for one of them."""

    def rows() -> list[Any]:
        return [value() for _ in range(draws.randint(1, TRACE_ROWS_MAX))]

    trace: Tree = {"model": "trace", "values": rows(), "mode": draws.choice(REPLAYS)}
    if _sometimes(draws):
        sender, receiver = draws.sample(ids, 2)
        trace["links"] = [{"sender": sender, "receiver": receiver, "values": rows()}]
    return trace


REPLAYS = ("repeat", "shifted", "resample")

# What happens.


def _events(draws: Draws, ids: list[str], ticks: int) -> list[Tree]:
    def when() -> Tree:
        return {"tick": draws.randint(1, ticks), "ticks": draws.randint(1, 15)}

    events: list[Tree] = []
    for robot in draws.sample(ids, draws.randint(0, len(ids) // 2)):
        crash = {"kind": "crash", "robot": robot, **when()}
        if _sometimes(draws):
            del crash["ticks"]
        events.append(crash)
    if _sometimes(draws):
        events.append({"kind": "silence", "robot": draws.choice(ids), **when()})
    if _sometimes(draws, 0.4):
        ends = dict(zip(("sender", "receiver"), draws.sample(ids, 2), strict=True))
        named = {end: robot for end, robot in ends.items() if _sometimes(draws, 0.5)}
        events.append({"kind": "outage", **named, **when()})
    if _sometimes(draws):
        cut = draws.randint(1, len(ids) - 1)
        events.append({"kind": "partition", "groups": [ids[:cut], ids[cut:]], **when()})
    if _sometimes(draws, 0.2):
        events.append(
            {"kind": "move-target", "tick": draws.randint(1, ticks), "position": _place(draws)}
        )
    # Draws of their own: what is drawn after the events stays what it was before there were these.
    return events + _changes(random.Random(f"changes {ids} {ticks} {events}"), ticks)


CHANGES: dict[str, dict[str, DrawnFigure]] = {
    "loss": {"rate": _number(0.0, 1.0)},
    "delay": {"delay_s": _number(0.0, 1.0)},
    "range": {"range_m": _number(2.0, 12.0)},
    "heal": {},
}


def _changes(draws: Draws, ticks: int) -> list[Tree]:
    """Changes of the radio from a tick on, and what heals cuts."""
    changes: list[Tree] = []
    for kind, keys in CHANGES.items():
        for _ in range(draws.choice((0, 0, 0, 1, 2))):
            change: Tree = {"kind": kind, "tick": draws.randint(0, ticks)}
            if keys and _sometimes(draws, 0.5):
                change["ticks"] = draws.randint(1, 20)
            changes.append(change | _some(draws, keys, 0.8))
    return changes
