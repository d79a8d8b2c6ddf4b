"""Where definitions are: those of the standard packages beside this file, and those of users.

A user's package is a folder with a subfolder ``msg``, ``srv`` or ``action`` of such files. It is
called like its folder, or as its ``package.xml`` says.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from hprm.ros._messages.definitions import Source

#: The variable with folders of packages, or of folders of packages, between colons.
PACKAGES = "HPRM_ROS_PACKAGES"

KINDS = ("msg", "srv", "action")

_STANDARD = Path(__file__).parent / "standard"
_SECTION = re.compile(r"^== (\w+)/(\w+)\n", re.MULTILINE)
_NAME = re.compile(r"<name>\s*(\w+)\s*</name>")
_ABOVE = re.compile(r"(.)([A-Z][a-z]+)")
_WITHIN = re.compile(r"([a-z0-9])([A-Z])")

# How far below a folder of packages one may be: beside others, or with others of one repository.
_DEPTH = 2


class Package:
    """The definitions of one package, by kind and name."""

    def __init__(self, name: str, sources: dict[str, dict[str, Path | Source]]) -> None:
        """Take the definitions, or the files that have them."""
        self.name = name
        self._sources = sources

    def names(self, kind: str) -> list[str]:
        """Return the names of what it defines of a kind."""
        return sorted(self._sources.get(kind, ()))

    def source(self, kind: str, name: str) -> Source:
        """Return a definition."""
        found = self._sources[kind][name]
        if isinstance(found, Path):
            return Source(found.read_text(encoding="utf-8"), str(found))
        return found


def module_name(name: str) -> str:
    """Return the name of the module of a class, as in ``_point_cloud2``."""
    return "_" + _WITHIN.sub(r"\1_\2", _ABOVE.sub(r"\1_\2", name)).lower()


def standard_names() -> list[str]:
    """Return the names of all standard packages."""
    return sorted(it.stem for it in _STANDARD.glob("*.txt"))


def standard(name: str) -> Package | None:
    """Read a standard package; None if there is none of this name."""
    path = _STANDARD / f"{name}.txt"
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    sources: dict[str, dict[str, Path | Source]] = {}
    sections = list(_SECTION.finditer(text))
    for at, section in enumerate(sections):
        end = sections[at + 1].start() if at + 1 < len(sections) else len(text)
        line = text.count("\n", 0, section.end()) + 1
        source = Source(text[section.end() : end], str(path), line)
        sources.setdefault(section[1], {})[section[2]] = source
    return Package(name, sources)


def of_users(program: str | None) -> dict[str, Package]:
    """Find the packages of users for a program; of two with one name, the nearest is taken."""
    found: dict[str, Package] = {}
    script = Path(program).resolve() if program else None
    for folder in candidates(script if script and script.exists() else None):
        package = _read(folder)
        if package is not None:
            found.setdefault(package.name, package)
    return found


#: A file beside the running program, where this package calls a function of that.
_called: list[str] = []


def note_called(file: str) -> None:
    """Look for packages around this file, since the program is a function that is called."""
    _called[:] = [file]


def program() -> str | None:
    """Return the file of the running program, if it has one."""
    if _called:
        return _called[0]
    name = getattr(sys.modules.get("__main__"), "__file__", None)
    return name or (sys.argv[0] if sys.argv else None)


def candidates(script: Path | None) -> Iterator[Path]:
    """Return the folders that may be packages for a program, the nearest first."""
    for each in filter(None, os.environ.get(PACKAGES, "").split(os.pathsep)):
        yield Path(each)
        yield from _below(Path(each), _DEPTH)
    if script is not None:
        yield from _below(script.parent, 1)
        for above in script.parents:
            yield above
            yield from _below(above / "src", _DEPTH)
    # For programs of HPRM itself, as one that plays a bag.
    yield from _below(Path.cwd(), 1)
    yield from _below(Path.cwd() / "src", _DEPTH)


def _below(folder: Path, depth: int) -> Iterator[Path]:
    try:
        inside = sorted(
            Path(it.path) for it in os.scandir(folder) if it.is_dir() and it.name[0] not in "._"
        )
    except OSError:
        return
    yield from inside
    if depth > 1:
        for each in inside:
            yield from _below(each, depth - 1)


def _read(folder: Path) -> Package | None:
    """Read which definitions a folder has; None if it is no package with any."""
    sources: dict[str, dict[str, Path | Source]] = {}
    for kind in KINDS:
        files = {it.stem: it for it in sorted((folder / kind).glob(f"*.{kind}"))}
        if files:
            sources[kind] = {**files}
    return Package(_name(folder), sources) if sources else None


def _name(folder: Path) -> str:
    try:
        found = _NAME.search((folder / "package.xml").read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        found = None
    return folder.name if found is None else found[1]
