"""What the processes of a federation compare: the code and the parameters of its program.

A federate whose code differs is refused. Comments and white space do not count; what a transient
federate alone is made of may differ, so that it can be replaced.
"""

from __future__ import annotations

import ast
import hashlib
import linecache
import os
import sys
import sysconfig
from collections.abc import Iterator
from typing import Any

from hprm import _construction, _hprm
from hprm._reactor import Reactor

_PLAIN = (bool, int, float, str, bytes, type(None))


def of_parameters(arguments: dict[str, Any]) -> list[tuple[str, str]]:
    """Return what is compared of the arguments of a constructor: subjects and texts."""
    return [(f"parameter {name}", _text(value)) for name, value in arguments.items()]


def _text(value: Any) -> str:
    if isinstance(value, _PLAIN):
        return repr(value)
    digest, text, is_opaque = _hprm.digest(value)
    return type(value).__qualname__ if is_opaque else f"{text} {digest}"


def of_code(main: Reactor) -> list[tuple[str, str]]:
    """Return what is compared of the code: each module of the program, and each reactor class."""
    lasting: set[type] = set()
    every: set[type] = set()
    _classes(main, True, (lasting, every))
    paths = {_path(cls) for cls in every} - {None}
    # A program that the package itself makes is of the same version everywhere.
    main_path = None if _is_ours(type(main)) else _path(type(main))
    folder = "" if main_path is None else _home(main_path)
    modules = {path for path in paths if path is not None} | set(_beside(folder))
    facts = []
    names = {cls.__qualname__: cls in lasting for cls in every}
    for path in sorted(modules):
        rest, classes = _pieces(path, frozenset(names))
        inside = bool(folder) and os.path.abspath(path).startswith(folder + os.sep)
        name = os.path.relpath(path, folder) if inside else os.path.basename(path)
        facts.append((f"module {name}", _digest(rest)))
        for name in sorted(classes):
            if names[name]:
                facts.append((f"class {name}", _digest(classes[name])))
    return facts


def _is_ours(cls: type) -> bool:
    return cls.__module__.startswith("hprm.")


def _home(path: str) -> str:
    """Return the folder of a program: that of its file or, in a package, that of the outermost."""
    home = folder = os.path.dirname(os.path.abspath(path))
    while os.path.isfile(os.path.join(folder, "__init__.py")):
        home, folder = folder, os.path.dirname(folder)
    return home


def _classes(reactor: Reactor, lasts: bool, found: tuple[set[type], set[type]]) -> None:
    construction = _construction.of(reactor)
    lasts = lasts and not construction.federate.get("transient", False)
    lasting, every = found
    for cls in type(reactor).__mro__:
        if issubclass(cls, Reactor) and not _is_ours(cls):
            every.add(cls)
            if lasts:
                lasting.add(cls)
    for child in construction.children.values():
        for member in child if isinstance(child, list) else [child]:
            _classes(member, lasts, found)


def _path(cls: type) -> str | None:
    path = getattr(sys.modules.get(cls.__module__), "__file__", None)
    return path if isinstance(path, str) and path.endswith(".py") else None


def _beside(folder: str) -> Iterator[str]:
    """Find the modules that the program has imported from its own folder."""
    installed = {sysconfig.get_path(name) for name in ("purelib", "platlib", "stdlib")}
    for module in list(sys.modules.values()):
        path = getattr(module, "__file__", None)
        if not isinstance(path, str) or not path.endswith(".py") or not folder:
            continue
        path = os.path.abspath(path)
        if path.startswith(folder + os.sep) and not any(
            path.startswith(place + os.sep) for place in installed if place.startswith(folder)
        ):
            yield path


def _pieces(path: str, names: frozenset[str]) -> tuple[ast.Module, dict[str, ast.ClassDef]]:
    """Take the classes of these names out of a module."""
    try:
        tree = ast.parse("".join(linecache.getlines(path)))
    except (SyntaxError, ValueError):
        return ast.Module([], []), {}
    classes = {
        node.name: node
        for node in tree.body
        if isinstance(node, ast.ClassDef) and node.name in names
    }
    tree.body = [node for node in tree.body if node not in classes.values()]
    return tree, classes


def _digest(tree: ast.AST) -> str:
    return hashlib.sha256(ast.unparse(tree).encode()).hexdigest()[:32]
