"""Values as texts that are equal exactly if the values are, in whatever process they were made.

``==`` does not do: of arrays it gives arrays, of floats it takes 0.0 and -0.0 for the same, and of
objects it mostly asks whether they are one. Pickles do not do: they show which parts are shared.
"""

import hashlib
from collections.abc import Iterable
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

PARTS_MAX = 200_000
DEPTH_MAX = 50
DIGEST_BYTES = 16
_PLAIN = {bool, int, float, complex, str, bytes, type(None), type(...)}
_BY_NAME = (type, FunctionType, BuiltinFunctionType, ModuleType)


def digest_of(value: Any) -> str:
    """A digest of ``canonical``."""
    text = canonical(value).encode(errors="surrogatepass")
    return hashlib.blake2b(text, digest_size=DIGEST_BYTES).hexdigest()


def canonical(value: Any) -> str:
    """A text of a value by its types and content.

    Maps and sets count without their order. Objects are what pickle would keep of them; those that
    it cannot keep are their type's name. Beyond so many parts, or so deep, the rest is left out.
    """
    return _Writer().text(value, DEPTH_MAX)


class _Writer:
    def __init__(self) -> None:
        self.parts = 0

    def text(self, value: Any, depth: int) -> str:
        kind = type(value)
        if kind in _PLAIN:
            return f"{kind.__name__}:{value!r}"
        self.parts += 1
        # Objects may hold each other in circles.
        if depth == 0 or self.parts > PARTS_MAX:
            return "..."
        name = f"{kind.__module__}.{kind.__qualname__}"
        if isinstance(value, np.ndarray) and value.dtype != object:
            return f"{name}:{value.dtype.str}{value.shape}{value.tobytes().hex()}"
        if isinstance(value, dict):
            items = value.items()
            pairs = [f"{self.text(k, depth - 1)}={self.text(v, depth - 1)}" for k, v in items]
            return f"{name}{{{','.join(sorted(pairs))}}}"
        if isinstance(value, set | frozenset):
            return f"{name}{{{','.join(sorted(self._each(value, depth)))}}}"
        if isinstance(value, list | tuple):
            return f"{name}[{','.join(self._each(value, depth))}]"
        if isinstance(value, _BY_NAME):
            return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', value)}"
        if isinstance(value, MethodType):
            return f"{self.text(value.__func__, depth)}({self.text(value.__self__, depth - 1)})"
        return f"{name}{self._kept(value, depth)}"

    def _kept(self, value: Any, depth: int) -> str:
        """What pickle would keep of an object."""
        try:
            kept = value.__reduce_ex__(4)
        except Exception:
            # Such as a generator or an open file: nothing can be said of what is in it.
            return ""
        if isinstance(kept, str):
            return f":{kept}"
        parts = [list(part) if hasattr(part, "__next__") else part for part in kept]
        return f"({','.join(self._each(parts, depth))})"

    def _each(self, values: Iterable[Any], depth: int) -> list[str]:
        return [self.text(value, depth - 1) for value in values]
