"""What a policy says: a small map of plain values, which rides in the pose packets of its robot.

Once checked it is frozen: one decoded packet has many receivers in one process, and what one of
them does must not reach the others.
"""

import math
from collections.abc import Mapping
from typing import Any, NoReturn

import msgpack

from encircle.protocol.wire.limits import COUNT_MAX, SAY_BYTES_MAX, SAY_DEPTH_MAX

_PLAIN = {str, bytes, bool, type(None)}
VALUES = (
    "numbers that are finite, texts, bytes, truth values, None, and lists and maps of these,"
    " with texts as keys"
)


class FrozenMap(dict[str, Any]):
    """A map that cannot be changed; it can be hashed, compared with a dict, copied and pickled."""

    __slots__ = ()

    def _refuse(self, *_arguments: Any, **_values: Any) -> NoReturn:
        raise TypeError("what was said cannot be changed: make a new map, such as {**old, ...}")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __hash__(self) -> int:  # type: ignore[override]  # a dict has none
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return FrozenMap, (dict(self),)


NOTHING_SAID = FrozenMap()


def payload(value: Any) -> FrozenMap:
    """The map, frozen throughout, its lists as tuples.

    ``ValueError`` with what it must be, if it is no map, holds something else than plain values, is
    nested deeper than ``SAY_DEPTH_MAX``, or takes more than ``SAY_BYTES_MAX`` bytes as msgpack.
    """
    if not isinstance(value, Mapping):
        raise ValueError("a map with texts as keys")
    if not value:
        return NOTHING_SAID
    frozen: FrozenMap = _frozen(value, "", SAY_DEPTH_MAX)
    try:
        size = len(msgpack.packb(frozen))
    except UnicodeEncodeError:
        raise ValueError(f"made of {VALUES}; half of a surrogate pair is no text") from None
    if size > SAY_BYTES_MAX:
        raise ValueError(f"at most {SAY_BYTES_MAX} bytes as msgpack, this takes {size}")
    return frozen


def _frozen(value: Any, key: str, depth: int) -> Any:
    kind = type(value)
    if kind in _PLAIN:
        return value
    if kind is float or kind is int:
        if math.isfinite(value) if kind is float else abs(value) <= COUNT_MAX:
            return value
        raise ValueError(f"made of {VALUES}; {key or 'it'} is {value!r}")
    holds = isinstance(value, Mapping), kind in (list, tuple)
    if any(holds) and depth == 0:
        raise ValueError(f"nested {SAY_DEPTH_MAX} deep at most; {key} is deeper")
    if holds[0]:
        if not all(type(name) is str for name in value):
            raise ValueError(f"made of {VALUES}; {key or 'it'} has other keys")
        return FrozenMap({n: _frozen(v, _below(key, n), depth - 1) for n, v in value.items()})
    if holds[1]:
        return tuple([_frozen(v, _below(key, str(n)), depth - 1) for n, v in enumerate(value)])
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        # A number of numpy's; one that Python has no number for stays what it is.
        plain = value.item()
        if type(plain) is not kind:
            return _frozen(plain, key, depth)
    raise ValueError(f"made of {VALUES}; {key or 'it'} is of type {kind.__name__}")


def _below(key: str, name: str) -> str:
    return f"{key}.{name[:40]}" if key else name[:40]
