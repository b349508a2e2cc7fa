"""Known names that are similar to an unknown one, for messages that refuse it."""

from collections.abc import Iterable

LIKENESS_MIN = 0.6
NAMED_MAX = 3


def did_you_mean(name: object, known: Iterable[str], likeness_min: float = LIKENESS_MIN) -> str:
    """`` (did you mean 'flee'?)``, or nothing if no known name is similar."""
    # Imported late: it is needed only where a name is refused.
    from difflib import get_close_matches

    matches = get_close_matches(str(name), list(known), 1, likeness_min)
    return suggestion(matches)


def suggestion(names: Iterable[str]) -> str:
    """The first few names, as a question whether one was meant; empty if there are none."""
    matches = list(dict.fromkeys(names))[:NAMED_MAX]
    return f" (did you mean {' or '.join(map(repr, matches))}?)" if matches else ""
