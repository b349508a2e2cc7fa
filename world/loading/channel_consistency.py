"""What contradicts itself in the radio's part of a scenario, each problem with key and value."""

from collections.abc import Iterable, Mapping, Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from encircle.world.scenario.channel_model import (
    ChannelModel,
    Crash,
    Delay,
    DelayRows,
    Loss,
    LossRows,
    Outage,
    Partition,
    Silence,
    delay_parts,
    loss_parts,
)
from encircle.world.scenario.fields import shown

SPREAD_MAX = 1e3
TRACE_ROWS_MAX = 200_000
LINKS_NAMED_MAX = 4

LOSS_KEYS: dict[str, set[str]] = {
    "none": set(),
    "bernoulli": {"rate"},
    "gilbert-elliott": {"good_to_bad", "bad_to_good", "loss_good", "loss_bad"},
    "burst": {"rate", "burst_packets"},
    "distance": {"midpoint_m", "width_m", "cutoff_m"},
    "range": {"cutoff_m"},
    "trace": {"mode", "values", "links"},
}
DELAY_KEYS: dict[str, set[str]] = {
    "constant": {"mean_s"},
    "uniform": {"low_s", "high_s"},
    "gamma": {"mean_s", "std_s"},
    "lognormal": {"mean_s", "std_s"},
    "normal": {"mean_s", "std_s"},
    "exponential": {"mean_s"},
    "trace": {"mode", "values", "links"},
}
NEEDED = {
    "burst": ("burst_packets",),
    "distance": ("midpoint_m", "width_m"),
    "range": ("cutoff_m",),
}


def problems_of_radio(
    channel: ChannelModel, events: Sequence[object], ids: Sequence[str]
) -> list[str]:
    """Contradictions in a channel and in the events that concern it; empty if there are none."""
    problems: list[str] = []
    tables: list[tuple[str, Loss | Delay | None]] = [
        ("channel.delay", channel.delay),
        ("channel.loss", channel.loss),
    ]
    for index, link in enumerate(channel.links):
        problems += _names(f"channel.links.{index}", link.sender, link.receiver, ids)
        tables.append((f"channel.links.{index}.delay", link.delay))
        tables.append((f"channel.links.{index}.loss", link.loss))
    for key, model in tables:
        if isinstance(model, Delay):
            problems += [*_delay(key, model), *_unused(key, model, DELAY_KEYS[model.model])]
        elif isinstance(model, Loss):
            problems += [*_loss(key, model), *_unused(key, model, LOSS_KEYS[model.model])]
    problems += _traces({key: model for key, model in tables if model is not None})
    for name, links, loss in loss_parts(channel, ids):
        problems += _rows_missing(name, links, loss, ids)
    for name, links, delay in delay_parts(channel, ids):
        problems += _rows_missing(name, links, delay, ids)
    limit = channel.rate_limit
    if limit is not None and limit.packets_per_s is None and limit.bytes_per_s is None:
        problems.append("channel.rate_limit: give packets_per_s, bytes_per_s or both")
    for index, event in enumerate(events):
        problems += _event(f"events.{index}", event, ids)
    return problems + _crashes(events)


def _loss(key: str, loss: Loss) -> list[str]:
    problems = [
        f"{key}.{name}: must be given for model {loss.model!r}"
        for name in NEEDED.get(loss.model, ())
        if getattr(loss, name) is None
    ]
    if loss.model == "burst" and loss.burst_packets is not None:
        # Good periods last a packet at least: no more than burst in every burst + 1 are lost.
        most = loss.burst_packets / (loss.burst_packets + 1.0)
        if loss.rate > most * (1.0 + 1e-12):
            problems.append(
                f"{key}.rate = {loss.rate}: with burst_packets = {loss.burst_packets:g} the rate"
                f" can be at most {most:.6g}, one packet between bursts"
            )
    return problems


def _delay(key: str, delay: Delay) -> list[str]:
    problems = []
    mean, spread = delay.mean_s, delay.std_s
    if delay.model in ("gamma", "lognormal"):
        if not (mean > 0.0 and spread > 0.0):
            problems.append(f"{key}: {delay.model} needs mean_s and std_s above 0")
        elif not 1 / SPREAD_MAX <= spread / mean <= SPREAD_MAX:
            problems.append(
                f"{key}.std_s = {spread}: must be from 1/{SPREAD_MAX:g} to"
                f" {SPREAD_MAX:g} times mean_s = {mean}"
            )
    if delay.model == "normal" and not spread > 0.0:
        problems.append(f"{key}.std_s = {spread}: must be above 0 for model 'normal'")
    if delay.model == "exponential" and "mean_s" not in delay.model_fields_set:
        # A mean of 0, no delay, is where a study of delays begins.
        problems.append(f"{key}.mean_s: must be given for model 'exponential'")
    if delay.model == "uniform" and delay.low_s > delay.high_s:
        problems.append(f"{key}.low_s = {delay.low_s}: must be at most high_s = {delay.high_s}")
    return problems


def _unused(key: str, model: Delay | Loss, used: set[str]) -> list[str]:
    """A value that its model ignores was surely meant to have an effect."""
    return [
        f"{key}.{name} = {shown(getattr(model, name))}: has no meaning for model {model.model!r},"
        f" which takes {', '.join(sorted(used)) or 'nothing'}"
        for name in sorted(model.model_fields_set - used - {"model"})
        if getattr(model, name) != type(model).model_fields[name].default
    ]


def _traces(tables: Mapping[str, Loss | Delay]) -> list[str]:
    problems, count = [], 0
    for key, table in tables.items():
        rows = {f"{key}.values": table.values} if table.values is not None else {}
        links: Sequence[LossRows | DelayRows] = table.links
        rows |= {f"{key}.links.{k}.values": link.values for k, link in enumerate(links)}
        for name, values in rows.items():
            count += len(values)
            if not values:
                problems.append(f"{name} = (): must have at least one row")
            elif isinstance(table, Delay) and all(value is None for value in values):
                problems.append(f"{name}: every packet was lost, so there is no delay to take")
    if count > TRACE_ROWS_MAX:
        problems.append(
            f"channel: the traces have {count} rows together, must be at most {TRACE_ROWS_MAX}"
        )
    return problems


def _rows_missing(
    key: str, links: NDArray[np.bool_], model: Loss | Delay, ids: Sequence[str]
) -> list[str]:
    """Links to which a trace applies that has no rows for them; and rows given twice."""
    if model.model != "trace":
        return []
    own = [(link.sender, link.receiver) for link in model.links]
    problems = [
        f"{key}.links.{index}: the link {s} -> {r} has rows already"
        for index, (s, r) in enumerate(own)
        if (s, r) in own[:index]
    ]
    if model.values is not None:
        return problems
    if not own:
        return [f"{key}: model 'trace' needs file or values"]
    needed = [(ids[s], ids[r]) for s, r in np.argwhere(links).tolist()]
    given = set(own)
    missing = [f"{s} -> {r}" for s, r in needed if (s, r) not in given]
    if missing:
        more = len(missing) - LINKS_NAMED_MAX
        named = ", ".join(missing[:LINKS_NAMED_MAX]) + (f" and {more} more" if more > 0 else "")
        problems.append(
            f"{key}: the trace has no rows for {named}; give rows to each link,"
            " or rows without sender and receiver for all others"
        )
    return problems


def _event(key: str, event: object, ids: Sequence[str]) -> list[str]:
    if isinstance(event, Silence | Crash):
        return _unknown(f"{key}.robot", event.robot, ids)
    if isinstance(event, Outage):
        return _names(key, event.sender, event.receiver, ids)
    problems: list[str] = []
    if isinstance(event, Partition):
        if len(event.groups) < 2:
            problems.append(f"{key}.groups = {shown(event.groups)}: must be two groups or more")
        grouped: dict[str, int] = {}
        for group, robots in enumerate(event.groups):
            if not robots:
                problems.append(f"{key}.groups.{group} = (): must have at least one robot")
            for index, robot in enumerate(robots):
                problems += _unknown(f"{key}.groups.{group}.{index}", robot, ids)
                if grouped.setdefault(robot, group) != group:
                    problems.append(
                        f"{key}.groups.{group}.{index} = {robot!r}:"
                        f" is in groups.{grouped[robot]} already"
                    )
    return problems


def _crashes(events: Iterable[object]) -> list[str]:
    """Crashes of a robot while it is away already."""
    problems = []
    crashes = [(k, event) for k, event in enumerate(events) if isinstance(event, Crash)]
    for k, event in crashes:
        for other, before in crashes:
            begins_first = (before.tick, other) < (event.tick, k)
            back = inf if before.ticks is None else before.tick + before.ticks
            if before.robot == event.robot and begins_first and event.tick < back:
                until = "for ever" if before.ticks is None else f"up to tick {int(back)}"
                problems.append(
                    f"events.{k}.tick = {event.tick}: {event.robot} is away already,"
                    f" {until}, by events.{other}"
                )
    return problems


def _names(key: str, sender: str | None, receiver: str | None, ids: Sequence[str]) -> list[str]:
    problems = [
        problem
        for end, robot in (("sender", sender), ("receiver", receiver))
        if robot is not None
        for problem in _unknown(f"{key}.{end}", robot, ids)
    ]
    if sender is not None and sender == receiver:
        problems.append(f"{key}.receiver = {receiver!r}: a robot sends nothing to itself")
    return problems


def _unknown(key: str, robot: str, ids: Sequence[str]) -> list[str]:
    # Without any robot it is the team that is wrong.
    return [] if robot in ids or not ids else [f"{key} = {robot!r}: robots are {', '.join(ids)}"]
