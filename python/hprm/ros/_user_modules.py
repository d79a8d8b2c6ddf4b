"""Imports of modules of packages of users, as if they were installed.

ROS installs packages before it runs them, so programs import modules of their own package, and of
others in the workspace, from anywhere. Here, what nothing else has is looked for in the folders of
packages around the program, and in those that ``HPRM_ROS_PACKAGES`` names.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from hprm.ros._messages.packages import candidates

if TYPE_CHECKING:
    from importlib.abc import MetaPathFinder
else:
    # Its module takes 15 ms to import, and it only says what methods there are.
    MetaPathFinder = object

#: What the folder of a package has; without, a folder is none.
_MARKS = ("package.xml", "setup.py", "setup.cfg", "pyproject.toml")


class _Finder(MetaPathFinder):
    """Finds what no other finder has."""

    def __init__(self, program: Path) -> None:
        self._program = program
        self._modules: dict[str, Path] | None = None

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if path is not None:
            return None
        if self._modules is None:
            self._modules = {}
            for folder in _folders(self._program):
                self._modules.setdefault(folder.name, folder)
        if name not in self._modules:
            return None
        folder = self._modules[name]
        return importlib.util.spec_from_file_location(
            name, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )


def _folders(program: Path) -> Iterator[Path]:
    """Find folders of modules: that of the program's own package first."""
    own = program.parent
    while (own / "__init__.py").is_file():
        yield own
        own = own.parent
    for package in candidates(program):
        if any((package / mark).is_file() for mark in _MARKS):
            for root in (package, package / "src"):
                yield from _with_code(root)


def _with_code(root: Path) -> Iterator[Path]:
    try:
        inside = sorted(it.path for it in os.scandir(root) if it.is_dir())
    except OSError:
        return
    yield from (Path(it) for it in inside if os.path.isfile(os.path.join(it, "__init__.py")))


def install(program: Path) -> None:
    """Let a program import what is in packages around it."""
    if not any(isinstance(it, _Finder) for it in sys.meta_path):
        # The last one: what is installed goes first.
        sys.meta_path.append(_Finder(program.resolve()))
