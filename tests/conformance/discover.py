"""Which files of a Lingua Franca checkout are programs to run, and what their text says of them.

Nothing is run here, and nothing but ``.lf`` files is read.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path("test/Python")
"""Where the programs run, in the checkout; they lie below ``src`` of it."""

NOT_RUN = {"failing", "knownfailed", "failed", "fed-gen"}
"""Folders whose programs Lingua Franca does not run either."""

SINGLE_THREADED = {"src", "multiport", "modal_models", "target"}
"""Folders whose unfederated programs Lingua Franca also runs with one thread."""

# Whichever begins first hides the others: a comment in a string is none.
_NOISE = re.compile(
    r""" "(?:\\.|[^"\\\n])*" | //[^\n]* | \#[^\n]* | /\*.*?\*/ | \{=.*?=\}""",
    re.DOTALL | re.VERBOSE,
)
_MAIN = re.compile(r"\b(?:realtime\s+)?(main|federated)\s+(?:realtime\s+)?reactor\b")


class Unusable(Exception):
    """What was named is no checkout of Lingua Franca."""


@dataclass(frozen=True, order=True)
class Program:
    """A program, by its path below ``src``."""

    folder: str
    path: str
    federated: bool

    @property
    def name(self) -> str:
        """The name, as Lingua Franca has it: that of the file."""
        return Path(self.path).stem


def discover(checkout: Path) -> list[Program]:
    """All programs of a checkout, by folder and name.

    Raises `Unusable` if there are none.
    """
    source = checkout / PACKAGE / "src"
    if not source.is_dir():
        raise Unusable(f"{checkout} has no folder {PACKAGE / 'src'}")
    found = []
    for file in source.rglob("*.lf"):
        path = file.relative_to(source)
        kind = None if NOT_RUN & set(path.parts) else main_kind(file.read_text())
        if kind is not None:
            folder = path.parent.as_posix()
            found.append(
                Program("src" if folder == "." else folder, path.as_posix(), kind == "federated")
            )
    if not found:
        raise Unusable(f"{source} holds no program")
    return sorted(found)


def main_kind(text: str) -> str | None:
    """``main``, ``federated``, or None if the file is a library."""
    found = _MAIN.search(_NOISE.sub(" ", text))
    return found[1] if found else None


def chosen(
    programs: Iterable[Program],
    only: str | None = None,
    folders: Iterable[str] = (),
    federated: bool | None = None,
) -> list[Program]:
    """The programs of these folders, whose path fits a pattern, and which are federated or not.

    A pattern without wildcards fits whatever contains it.
    """
    wanted = set(folders)
    pattern = None if only is None else only if set(only) & set("*?[") else f"*{only}*"
    return [
        program
        for program in programs
        if (not wanted or program.folder in wanted)
        and (pattern is None or fnmatch.fnmatchcase(program.path, pattern))
        and federated in (None, program.federated)
    ]
