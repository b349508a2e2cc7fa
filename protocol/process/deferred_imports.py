"""Imports that wait until something uses them.

filterpy's package imports all its modules, and two of them import ``scipy.stats`` and
``scipy.ndimage``: half of a robot's start-up time and a sixth of its memory, for functions that its
Kalman steps never call. While filterpy is imported those two are postponed (``deferred``): names
taken from them are imported for good when they are first used.

scipy's first modules import others that nothing here uses: ``numpy.f2py`` and ``numpy.ma``, because
scipy asks numpy for all its names, and rotations in space. What is only bound to its name, and no
name taken from it, can wait by the standard library's own means (``lazy``): a third of the time
that ``import scipy.optimize`` takes.
"""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType
from typing import Any

UNUSED = ("numpy.f2py", "numpy.ma", "scipy.spatial.transform")
"""Modules that scipy binds to a name, and that neither it nor a hunt uses."""


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


class _LazyFinder(MetaPathFinder):
    """Finds modules as usual, and has those of these names executed when they are first used."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in self._names:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, Loader):
            spec.loader = LazyLoader(spec.loader)
        return spec


@contextmanager
def lazy(*modules: str) -> Iterator[None]:
    """Within this context, importing ``modules`` does not execute them before an attribute is used.

    It stays so after the context: such a module is a whole one for whoever uses it.
    """
    finder = _LazyFinder(modules)
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
