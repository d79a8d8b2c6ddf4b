"""Imports of packages of messages: ``from std_msgs.msg import String`` without ROS.

A package is a module with the modules ``msg``, ``srv`` and ``action``. In these, each definition
has a module of its own, like ``_string``, which is compiled when its class is first used.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import os
import sys
import threading
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

from hprm.ros._messages import classes, packages
from hprm.ros._messages.definitions import DefinitionError, is_type_name, parse
from hprm.ros._messages.packages import KINDS, Package

if TYPE_CHECKING:
    from importlib.abc import Loader, MetaPathFinder
else:
    # Their module takes 15 ms to import, and they only say what methods there are.
    Loader = MetaPathFinder = object

_MAKERS: dict[str, tuple[int, Any]] = {
    "msg": (1, None),
    "srv": (2, classes.service),
    "action": (3, classes.action),
}


class MessageFinder(MetaPathFinder):
    """Finds modules of message packages, where nothing else has them.

    It stands before Python's own finders, because those take any folder for a package. What is
    more than a folder there, as an installation of ROS is, goes first unless ``comes_first``.
    """

    def __init__(self) -> None:
        """Know nothing yet."""
        self.comes_first = False
        #: Files of programs that run elsewhere, whose packages are found, too.
        self.others: tuple[str, ...] = ()
        self._users: dict[str, Package] | None = None
        self._program: tuple[str | None, str | None] = None, None
        self._standard: dict[str, Package | None] = {}
        self._asking = threading.local()

    def invalidate_caches(self) -> None:
        """Look again for the packages of users, which may have changed."""
        self._users = None

    def package(self, name: str) -> Package | None:
        """Find the definitions of a package."""
        program = packages.program(), os.environ.get(packages.PACKAGES)
        if self._users is None or program != self._program:
            # A program may be started by another one, in the same process.
            self._program = program
            self._users = packages.of_users(program[0])
            for other in self.others:
                self._users = packages.of_users(other) | self._users
        if name in self._users:
            return self._users[name]
        if name not in self._standard:
            self._standard[name] = packages.standard(name)
        return self._standard[name]

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find a module for Python's import."""
        if getattr(self._asking, "now", False):
            return None
        first, *rest = name.split(".")
        package = self.package(first)
        if package is None or not _serves(package, rest):
            return None
        if not self.comes_first and self._is_elsewhere(name, path, target):
            return None
        loader = _Loader(package, rest)
        return importlib.machinery.ModuleSpec(name, loader, is_package=len(rest) < 2)

    def _is_elsewhere(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None
    ) -> bool:
        """Tell whether another finder has the module, and not only a folder of that name."""
        # Another finder may ask all of them in turn, this one too.
        self._asking.now = True
        try:
            for finder in sys.meta_path:
                find = getattr(finder, "find_spec", None)
                if finder is self or find is None:
                    continue
                spec = find(name, path, target)
                if spec is not None and spec.origin is not None:
                    return True
            return False
        finally:
            self._asking.now = False


def _serves(package: Package, rest: list[str]) -> bool:
    match rest:
        case []:
            return True
        case [kind]:
            return kind in KINDS and bool(package.names(kind))
        case [kind, module]:
            return kind in KINDS and _of_module(package, kind, module) is not None
    return False


def _of_module(package: Package, kind: str, module: str) -> str | None:
    names = package.names(kind)
    return next((it for it in names if packages.module_name(it) == module), None)


class _Loader(Loader):
    """Fills a module of a package."""

    def __init__(self, package: Package, rest: list[str]) -> None:
        self.package = package
        self.rest = rest

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> None:
        """Let Python make the module."""

    def exec_module(self, module: ModuleType) -> None:
        """Fill it."""
        match self.rest:
            case [kind]:
                _fill_kind(module, self.package.names(kind))
            case [kind, each]:
                name = _of_module(self.package, kind, each)
                assert name is not None
                module.__dict__.update(_compiled(self.package, kind, name, module.__name__))


def _fill_kind(module: ModuleType, names: list[str]) -> None:
    """Give a module like ``std_msgs.msg`` its classes, when they are asked for."""
    members = module.__dict__

    def find(name: str) -> Any:
        # The events of a service are in the module that has the service.
        defined = name.removesuffix("_Event")
        if defined not in names or (defined != name and not module.__name__.endswith(".srv")):
            raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")
        each = importlib.import_module(f"{module.__name__}.{packages.module_name(defined)}")
        members[name] = found = getattr(each, name)
        return found

    members["__getattr__"] = find
    members["__all__"] = names
    members["__dir__"] = lambda: [*members, *names]


def _compiled(package: Package, kind: str, name: str, module: str) -> dict[str, type]:
    """Make the classes of a definition."""
    source = package.source(kind, name)
    if not is_type_name(name):
        raise DefinitionError(
            f"{source.file}:1: {name!r}: files of definitions have names like WheelSpeed.{kind}"
        )
    parts, make = _MAKERS[kind]
    structures = parse(f"{package.name}/{kind}/{name}", source, parts)
    if make is None:
        return {name: classes.message(structures[0], module, resolve)}
    made: dict[str, type] = make(structures, module, resolve)
    return made


def resolve(base: str) -> type:
    """Find a class by ``package/Name`` or ``package/kind/Name``; LookupError says what is wrong."""
    package, *kinds, name = base.split("/")
    kind = kinds[0] if kinds else "msg"
    try:
        module = importlib.import_module(f"{package}.{kind}")
    except ModuleNotFoundError:
        raise LookupError(
            f"there is no package {package!r} with {kind} definitions; folders of packages are "
            f"beside the program, in src above it, or in {packages.PACKAGES}"
        ) from None
    try:
        found: type = getattr(module, name)
    except AttributeError:
        each = sys.modules.get(f"{package}.{kind}.{packages.module_name(name)}")
        if getattr(getattr(each, "__spec__", None), "_initializing", False):
            raise LookupError(f"{base} would contain itself") from None
        raise LookupError(f"the package {package!r} defines no {name!r}") from None
    return found
