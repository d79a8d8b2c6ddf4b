"""Packages of users as folders, and the programs in Python in them.

A package is a folder that is called like it, or whose ``package.xml`` names it. It is looked for in
``HPRM_ROS_PACKAGES``, then around the file that asks: in its folder and all folders above, each
with the folders in it, in its ``src``, and one level below that.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hprm.ros._launch._plans import LaunchError
from hprm.ros._launch._shares import share_of
from hprm.ros._messages.packages import PACKAGES

_NAME = re.compile(r"<name>\s*([\w-]+)\s*</name>")
_MARKS = ("package.xml", "setup.py", "setup.cfg", "pyproject.toml")
# Where a package has programs, beside its module.
_FOLDERS = ("", "scripts", "nodes", "src", "bin", "launch")


class PackageError(LaunchError):
    """There is no such package, or no such program in it."""


# Programs of packages of ROS that are here, for launch files that start them.
_OWN = {
    ("tf2_ros", "static_transform_publisher"): "_tf2_ros/static_transform_publisher.py",
}


@dataclass(frozen=True)
class Program:
    """A program of a package."""

    script: Path
    #: The function that the entry point names.
    function: str | None = None
    #: The folder from which its module is imported.
    root: Path | None = None


def find_package(name: str, near: Path) -> Path:
    """Return the folder of a package, as seen from a file or folder.

    Raises ``PackageError`` that says where it was looked for.
    """
    found = [folder for folder in _candidates(name, near) if folder.is_dir()]
    # The module in a package's folder has its name, too; the package is the one that says so.
    for folder in sorted(found, key=lambda one: not _is_marked(one)):
        return folder
    places = [f"  {path}/**" for path in _variable()]
    start = near if near.is_dir() else near.parent
    places += [f"  {start} and the folders above it: {name}, src/{name}, src/*/{name}"]
    raise PackageError(
        f"package '{name}' was not found; it was looked for in\n"
        + "\n".join(places)
        + f"\nset {PACKAGES} to the folder that has it"
    )


def find_share(name: str, near: Path) -> Path:
    """Return the folder in which the files of a package are, as seen from a file or folder.

    Raises ``PackageError`` that says where it was looked for.
    """
    return share_of(name, find_package(name, near))


def _variable() -> list[Path]:
    return [Path(each) for each in os.environ.get(PACKAGES, "").split(os.pathsep) if each]


def _candidates(name: str, near: Path) -> Iterator[Path]:
    for given in _variable():
        yield from _named(name, [given, *_inside(given)])
        for below in _inside(given):
            yield from _named(name, _inside(below))
    near = near.resolve()
    start = near if near.is_dir() else near.parent
    for above in (start, *start.parents):
        yield from _named(name, [above, *_inside(above), *_inside(above / "src")])
        for below in _inside(above / "src"):
            yield from _named(name, _inside(below))


def _named(name: str, folders: list[Path]) -> Iterator[Path]:
    return (folder for folder in folders if folder.name == name or _stated(folder) == name)


def _stated(folder: Path) -> str | None:
    try:
        found = _NAME.search((folder / "package.xml").read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        return None
    return None if found is None else found[1]


def _inside(folder: Path) -> list[Path]:
    try:
        return sorted(
            Path(each.path) for each in os.scandir(folder) if each.is_dir() and each.name[0] != "."
        )
    except OSError:
        return []


def _is_marked(folder: Path) -> bool:
    return any((folder / mark).is_file() for mark in _MARKS)


def find_program(package: str, executable: str, near: Path) -> Program:
    """Return a program of a package, as seen from a file or folder.

    An entry point of the package's ``setup.py``, ``setup.cfg`` or ``pyproject.toml`` comes first,
    then files in the usual folders. A module that an entry point names is no program itself: run as
    a file, it does nothing, as after a typing error in the name of its entry point. Raises
    ``PackageError`` that says where it was looked for.
    """
    own = _OWN.get((package, executable))
    if own is not None:
        return Program(Path(__file__).parents[1] / own)
    folder = find_package(package, near)
    entry = _entry_point(folder, executable)
    if entry is not None:
        return entry
    looked = []
    modules = () if _is_named(folder, package, executable) else (package,)
    for below in (*modules, *_FOLDERS):
        for name in (f"{executable}.py", executable):
            path = folder / below / name
            looked.append(str(path))
            if path.is_file():
                return Program(path, root=folder)
    raise PackageError(
        f"package '{package}' ({folder}) has no program '{executable}'; there is no entry point of "
        f"this name in {', '.join(_MARKS[1:])}, and no file of\n  " + "\n  ".join(looked)
    )


def _is_named(folder: Path, package: str, module: str) -> bool:
    """Whether an entry point names a module of a package."""
    pattern = re.compile(rf"=\s*['\"]?{re.escape(package)}\.{re.escape(module)}\s*:")
    for file in _MARKS[1:]:
        with contextlib.suppress(OSError, UnicodeDecodeError):
            if pattern.search((folder / file).read_text(encoding="utf-8")):
                return True
    return False


def _entry_point(folder: Path, executable: str) -> Program | None:
    name = re.escape(executable)
    pattern = re.compile(rf"(?<![\w.-]){name}['\"]?\s*=\s*['\"]?([\w.]+)\s*:\s*([\w.]+)")
    for file in _MARKS[1:]:
        try:
            text = (folder / file).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            continue
        found = pattern.search(text)
        if found is None:
            continue
        module = Path(*found[1].split("."))
        for root in (folder, folder / "src"):
            for path in (root / f"{module}.py", root / module / "__init__.py"):
                if path.is_file():
                    return Program(path, found[2], root)
        raise PackageError(
            f"{folder / file}: the entry point '{executable}' names the module {found[1]}, "
            f"but there is no {folder / module}.py"
        )
    return None
