"""How grave an event is, for viewers that colour their logs by that."""

from encircle.scene.frame import Event

WARNINGS = frozenset({"lost", "silence", "partition", "outage", "loss", "delay", "range"})


def is_warning(event: Event) -> bool:
    """Whether the event is of a kind that takes something away from the team."""
    return event.kind in WARNINGS
