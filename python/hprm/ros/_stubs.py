"""Stubs for type checkers and editors: of messages, and of rclpy's names for what is here.

Classes of messages are made while a program runs, and ``rclpy`` is ``hprm.ros`` only then. So that
checkers know both, ``python -m hprm.ros stubs typings`` writes files; Pyright looks into a folder
of that name by itself, and mypy where ``mypy_path`` says.
"""

from __future__ import annotations

import importlib
import keyword
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hprm.ros._aliases import NAMES
from hprm.ros._messages import packages
from hprm.ros._messages.definitions import Field, Structure
from hprm.ros._messages.fields import python_type
from hprm.ros._messages.finder import resolve

_PARTS = {"srv": ("Request", "Response", "Event"), "action": ("Goal", "Result", "Feedback")}


def write(folder: Path, program: str | None) -> int:
    """Write the stubs into a folder, with those of packages beside a program; return how many."""
    count = 0
    for name, target in NAMES.items():
        for path, text in _aliases(name, target):
            count += _put(folder / path, text)
    users = packages.of_users(program)
    for name in sorted({*packages.standard_names(), *users}):
        package = users.get(name) or packages.standard(name)
        assert package is not None
        count += _put(folder / name / "__init__.pyi", "")
        for kind in packages.KINDS:
            names = package.names(kind)
            if names:
                text = _definitions(name, kind, names)
                count += _put(folder / name / kind / "__init__.pyi", text)
    return count


def _put(path: Path, text: str) -> int:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return 1


def _aliases(name: str, target: str) -> Iterator[tuple[Path, str]]:
    """Return files by which a package stands for another one, with all modules below it."""
    module = importlib.import_module(target)
    folder = Path(*name.split("."))
    if not hasattr(module, "__path__"):
        yield folder.with_suffix(".pyi"), f"from {target} import *\n"
        return
    below = [it.name for it in pkgutil.iter_modules(module.__path__) if it.name[0] != "_"]
    lines = [f"from {target} import *", *(f"from . import {it} as {it}" for it in below)]
    yield folder / "__init__.pyi", "\n".join(lines) + "\n"
    for each in below:
        yield from _aliases(f"{name}.{each}", f"{target}.{each}")


def _definitions(package: str, kind: str, names: list[str]) -> str:
    """Return the stub of what a package defines of a kind."""
    bodies: list[str] = []
    needed: set[str] = set()
    for name in names:
        made: Any = resolve(f"{package}/{kind}/{name}")
        if kind == "msg":
            bodies += _message(name, made.__hprm_structure__, needed)
            continue
        bodies.append(f"class {name}:")
        for part in _PARTS[kind]:
            structure = getattr(made, part).__hprm_structure__
            bodies += [f"    {it}" for it in _message(part, structure, needed)]
        if kind == "action":
            bodies.append("    Impl: Any")
    imports = sorted(f"import {it}" for it in needed)
    return "\n".join(["from typing import Any", *imports, "", *bodies]) + "\n"


def _message(name: str, structure: Structure, needed: set[str]) -> list[str]:
    """Return the lines of a class, and note which modules its fields need."""
    lines = [f"class {name}:"]
    for constant, (base, _) in structure.constants.items():
        lines.append(f"    {constant}: {_basic(base)}")
    typed = {it.name: _type(it, needed) for it in structure.fields}
    # Of a field that is called like a keyword, Python has no attribute that can be written down.
    plain = {field: type_ for field, type_ in typed.items() if not keyword.iskeyword(field)}
    lines += [f"    {field}: {type_}" for field, type_ in plain.items()]
    given = "".join(f", {field}: {type_} = ..." for field, type_ in plain.items())
    lines.append(f"    def __init__(self{', *' if given else ''}{given}) -> None: ...")
    lines.append("    @classmethod")
    lines.append("    def get_fields_and_field_types(cls) -> dict[str, str]: ...")
    return lines


def _type(it: Field, needed: set[str]) -> str:
    basic = python_type(it.type.base)
    if basic is not None:
        if it.type.many and basic in (int, float):
            # An array of NumPy or of the module ``array``, as was set.
            return "Any"
        one = basic.__name__
    else:
        package, *kinds, name = it.type.base.split("/")
        if "_" in name:
            # A part of the service that is being written; no other name has this sign.
            service, _, part = name.partition("_")
            return f"list[{service}.{part}]"
        module = f"{package}.{kinds[0] if kinds else 'msg'}"
        needed.add(module)
        one = f"{module}.{name}"
    return f"list[{one}]" if it.type.many else one


def _basic(base: str) -> str:
    found = python_type(base)
    return "Any" if found is None else found.__name__
