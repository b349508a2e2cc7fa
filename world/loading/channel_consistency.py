"""What contradicts itself in the radio's part of a scenario, each problem with key and value."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from encircle.world.scenario.channel_model import (
    ChannelModel,
    Crash,
    Outage,
    Partition,
    Silence,
    delay_parts,
    loss_parts,
)
from encircle.world.scenario.delay_models import (
    Delay,
    DelayRows,
    ExponentialDelay,
    GammaDelay,
    LognormalDelay,
    TraceDelay,
    UniformDelay,
)
from encircle.world.scenario.fields import shown
from encircle.world.scenario.loss_models import BurstLoss, Loss, LossRows, TraceLoss

SPREAD_MAX = 1e3
TRACE_ROWS_MAX = 200_000
LINKS_NAMED_MAX = 4


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
        problems += _of_model(key, model)
    problems += _traces(
        {key: model for key, model in tables if isinstance(model, TraceLoss | TraceDelay)}
    )
    for name, links, loss in loss_parts(channel, ids):
        problems += _rows_missing(name, links, loss, ids)
    for name, links, delay in delay_parts(channel, ids):
        problems += _rows_missing(name, links, delay, ids)
    limit = channel.rate_limit
    if limit is not None and limit.packets_per_s is None and limit.bytes_per_s is None:
        problems.append("channel.rate_limit: give packets_per_s, bytes_per_s or both")
    return problems + problems_of_events(events, ids)


def problems_of_events(events: Sequence[object], ids: Sequence[str], since: int = 0) -> list[str]:
    """Contradictions in the events that concern the radio; only in those from a place on."""
    problems: list[str] = []
    for index, event in enumerate(events[since:], since):
        problems += _event(f"events.{index}", event, ids)
    return problems + (
        _crashes(events) if any(isinstance(e, Crash) for e in events[since:]) else []
    )


def unknown_robots_of_events(
    events: object, ids: Sequence[str], refused: Collection[tuple[str | int, ...]]
) -> list[str]:
    """A line for each unknown robot named by events, some of whose values are refused.

    ``refused``: paths of what is told of already.
    """
    return [
        problem
        for index, event in enumerate(events if isinstance(events, list | tuple) else ())
        if isinstance(event, Mapping)
        for end in ("robot", "sender", "receiver")
        if isinstance(robot := event.get(end), str) and ("events", index, end) not in refused
        for problem in _unknown(f"events.{index}.{end}", robot, ids)
    ]


def _of_model(key: str, model: Loss | Delay | None) -> list[str]:
    """What contradicts itself within one table of loss or delay."""
    if isinstance(model, BurstLoss):
        # Good periods last a packet at least: no more than burst in every burst + 1 are lost.
        most = model.burst_packets / (model.burst_packets + 1.0)
        if model.rate > most * (1.0 + 1e-12):
            return [
                f"{key}.rate = {model.rate}: with burst_packets = {model.burst_packets:g} the rate"
                f" can be at most {most:.6g}, one packet between bursts"
            ]
    elif isinstance(model, GammaDelay | LognormalDelay):
        if not 1 / SPREAD_MAX <= model.std_s / model.mean_s <= SPREAD_MAX:
            return [
                f"{key}.std_s = {model.std_s}: must be from 1/{SPREAD_MAX:g} to"
                f" {SPREAD_MAX:g} times mean_s = {model.mean_s}"
            ]
    elif isinstance(model, ExponentialDelay) and "mean_s" not in model.model_fields_set:
        # A mean of 0, no delay, is where a study of delays begins.
        return [f"{key}.mean_s: is missing; it must be given for model 'exponential'"]
    elif isinstance(model, UniformDelay) and model.low_s > model.high_s:
        return [f"{key}.low_s = {model.low_s}: must be at most high_s = {model.high_s}"]
    return []


def _traces(tables: Mapping[str, TraceLoss | TraceDelay]) -> list[str]:
    problems, count = [], 0
    for key, table in tables.items():
        rows = {f"{key}.values": table.values} if table.values is not None else {}
        links: Sequence[LossRows | DelayRows] = table.links
        rows |= {f"{key}.links.{k}.values": link.values for k, link in enumerate(links)}
        for name, values in rows.items():
            count += len(values)
            if not values:
                problems.append(f"{name} = (): must have at least one row")
            elif isinstance(table, TraceDelay) and all(value is None for value in values):
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
    if not isinstance(model, TraceLoss | TraceDelay):
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
    links_of_trace = [(ids[s], ids[r]) for s, r in np.argwhere(links).tolist()]
    given = set(own)
    missing = [f"{s} -> {r}" for s, r in links_of_trace if (s, r) not in given]
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
