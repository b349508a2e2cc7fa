"""Channels of real links by name, with the sources of their figures.

A profile is a TOML file with the tables of ``channel`` and, for people, a title, its source, and
what was fitted and how. ``channel.profile`` of a scenario names one, and is replaced by the
profile's tables as the scenario is loaded, so that a resolved scenario, its digest and its
recording do not depend on what a later version ships. What the scenario itself says counts before
it: key by key within a table, unless it chooses another model, which then replaces the profile's
table.

Bursts of a profile are given in seconds, ``burst_s``, since real ones do not depend on ticks; they
become ``burst_packets`` with a packet for each tick.

    python -m encircle.world.loading.profiles            is the page current? exit status 1 if not
    python -m encircle.world.loading.profiles --write    make it so
"""

import sys
import tomllib
from collections.abc import Mapping
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from encircle.protocol.errors import did_you_mean
from encircle.protocol.programs.generated_pages import check_or_write, with_parts
from encircle.world.loading.toml_folder import toml_files
from encircle.world.scenario.fields import shown
from encircle.world.scenario.loss_models import BURST_PACKETS_MAX
from encircle.world.scenario.model import Scenario

SHIPPED = Path(__file__).parent / "shipped_profiles"
TEXTS = ("title", "source", "fitted")
PAGE = Path("docs/radio.md")
_COMMAND = "python -m encircle.world.loading.profiles"
_BEGIN = f"<!-- profiles, from the declarations: {_COMMAND} -->\n"
_END = "<!-- end of profiles -->\n"


class Profile(NamedTuple):
    """A real link: ``channel`` has its tables; ``fitted``: what was fitted to what, and how."""

    name: str
    title: str
    source: str
    fitted: str
    channel: Mapping[str, Any]


def profiles() -> dict[str, Profile]:
    """The profiles that come with the package, by name."""
    return {name: _read(name, path) for name, path in toml_files(SHIPPED).items()}


def expanded(tree: Any) -> list[str]:
    """Replace the profile of a scenario's tree by its tables; returns what is wrong with it."""
    channel = tree.get("channel") if isinstance(tree, dict) else None
    if not isinstance(channel, dict) or "profile" not in channel:
        return []
    name, known = channel.pop("profile"), toml_files(SHIPPED)
    if name is None:
        return []
    if not isinstance(name, str) or name not in known:
        listed = ", ".join(known)
        return [
            f"channel.profile = {shown(name)}: must be one of {listed}{did_you_mean(name, known)}"
        ]
    for key, table in _read(name, known[name]).channel.items():
        channel[key] = _merged(table, channel[key]) if key in channel else dict(table)
    loss = channel.get("loss")
    if isinstance(loss, dict) and "burst_s" in loss:
        burst_s = loss.pop("burst_s")
        is_sound = type(burst_s) in (int, float) and 0.0 < burst_s < inf
        burst_packets = _burst_packets(burst_s if is_sound else 1.0, loss.get("rate"), tree)
        loss.setdefault("burst_packets", burst_packets)
        if not is_sound:
            return [f"channel.loss.burst_s = {shown(burst_s)}: must be a number above 0, in s"]
    return []


def with_profile_named(resolved: dict[str, Any], tree: Mapping[str, Any]) -> dict[str, Any]:
    """A loaded scenario's tree with the profile that the tree it was loaded from names, if any.

    A study's cells can then name another. What is not the profile's stays as it was loaded.
    """
    channel = tree.get("channel")
    if not isinstance(channel, Mapping) or channel.get("profile") is None:
        return resolved
    made = resolved["channel"]
    own = {
        # The rows of a trace have taken the place of its file.
        key: made[key]
        if key == "links" or (isinstance(value, Mapping) and "file" in value)
        else value
        for key, value in channel.items()
    }
    return {**resolved, "channel": own}


def _read(name: str, path: Path) -> Profile:
    tree = tomllib.loads(path.read_text(encoding="utf-8"))
    title, source, fitted = (" ".join(tree[key].split()) for key in TEXTS)
    return Profile(name, title, source, fitted, tree["channel"])


def _merged(table: Mapping[str, Any], own: Any) -> Any:
    """A profile's table with the scenario's own keys, or the scenario's own if it is another's."""
    if not isinstance(own, Mapping) or own.get("model", table.get("model")) != table.get("model"):
        return own
    return {**table, **own}


def _burst_packets(burst_s: float, rate: Any, tree: Mapping[str, Any]) -> float:
    """Bursts in packets, one for each tick; what is malformed is found later."""
    tick_s = tree.get("tick_s", Scenario.model_fields["tick_s"].default)
    is_number = isinstance(tick_s, int | float) and tick_s > 0.0
    packets = burst_s / tick_s if is_number else 1.0
    # Good periods last a packet at least, so that a rate needs bursts of rate / (1 - rate).
    least = rate / (1.0 - rate) if isinstance(rate, float) and 0.0 <= rate < 1.0 else 1.0
    return min(max(1.0, least, packets), BURST_PACKETS_MAX)


def current(page: str) -> str:
    """The page with its profiles as they are declared."""
    return with_parts(page, {_BEGIN: _described()}, _END)


def _described() -> str:
    known = profiles()
    rows = [f"| [`{name}`](#profile-{name}) | {known[name].title} |\n" for name in known]
    parts = ["| `channel.profile` | |\n|---|---|\n", *rows]
    for name, _title, source, fitted, _channel in known.values():
        text = (SHIPPED / f"{name}.toml").read_text(encoding="utf-8")
        tables = text[text.index("[channel") :]
        parts.append(f"\n### Profile `{name}`\n\n{fitted}\n\nSource: {source}\n\n")
        parts.append(f"```\n{tables}```\n")
    return "".join(parts)


def main(arguments: list[str]) -> int:
    """Check the page, or write it; the exit status."""
    return check_or_write(PAGE, current, _COMMAND, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
