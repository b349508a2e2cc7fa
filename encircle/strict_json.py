"""JSON of strangers that means the same to every reader.

What most readers pass over is refused here: a name that comes twice in a map, of which some take
the first and others the last, a byte order mark, another encoding than UTF-8, and numbers that are
none.
"""

import json
from collections import Counter
from typing import Any


def strict_json(content: bytes) -> Any:
    """What a JSON text says; ``ValueError``, or ``RecursionError``, if it is not plainly one."""
    return json.loads(
        content.decode("utf-8"), object_pairs_hook=_each_once, parse_constant=_no_constant
    )


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        twice = next(name for name, count in counts.items() if count > 1)
        raise ValueError(f"{twice[:40]!r} comes twice in one map")
    return found


def _no_constant(text: str) -> Any:
    raise ValueError(f"{text} is no number of JSON")
