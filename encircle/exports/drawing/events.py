"""How grave an event is, for viewers that colour their logs by that."""

from encircle.scene.frame import Event

WARNINGS = frozenset({"lost", "silence", "partition", "outage", "intervention"})


def is_warning(event: Event) -> bool:
    """Whether the event takes something away from the team."""
    return event.kind in WARNINGS
