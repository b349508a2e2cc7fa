"""How many of something there are, in words."""


def counted(count: int, noun: str) -> str:
    """``1 tick``, ``2 ticks``; ``noun`` is one whose plural ends in s."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
