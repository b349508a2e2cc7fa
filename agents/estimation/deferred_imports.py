"""Import filterpy without what it never uses here.

filterpy's package imports all its modules, and two of them import ``scipy.stats`` and
``scipy.ndimage``: half of a robot's start-up time and a sixth of its memory, for functions that its
Kalman steps never call. While filterpy is imported those two are postponed: names taken from them
are imported for good when they are first used. ``numpy.f2py``, which builds Fortran, is imported by
scipy's first module because it asks numpy for all its names: a fifth of what is left.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any


class _Deferred:
    """Stands for a name of a module, and fetches it when it is used.

    While the module is still postponed an attribute is postponed as well and a call does nothing:
    filterpy probes a signature while it is imported, and looks only for a ``TypeError``.
    """

    def __init__(self, module: str, path: tuple[str, ...]) -> None:
        self._module = module
        self._path = path

    def _is_deferred(self) -> bool:
        return isinstance(sys.modules.get(self._module), _DeferredModule)

    def _resolved(self) -> Any:
        value: Any = import_module(self._module)
        for name in self._path:
            value = getattr(value, name)
        return value

    def __getattr__(self, name: str) -> Any:
        if self._is_deferred():
            return _Deferred(self._module, (*self._path, name))
        return getattr(self._resolved(), name)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return None if self._is_deferred() else self._resolved()(*arguments, **named)


class _DeferredModule(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Deferred(self.__name__, (name,))


@contextmanager
def deferred(*modules: str) -> Iterator[None]:
    """Within this context, importing names from ``modules`` does not import those modules.

    Their packages are imported, since a package may be asked for the module by its name.
    """
    absent = [name for name in modules if name not in sys.modules]
    packages = {name: import_module(name.rpartition(".")[0]) for name in absent}
    for name, package in packages.items():
        sys.modules[name] = stand_in = _DeferredModule(name)
        setattr(package, name.rpartition(".")[2], stand_in)
    try:
        yield
    finally:
        for name, package in packages.items():
            if isinstance(sys.modules.get(name), _DeferredModule):
                del sys.modules[name]
                delattr(package, name.rpartition(".")[2])
