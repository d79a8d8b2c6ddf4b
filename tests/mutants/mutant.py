"""What a mutant is, and the texts in this folder that describe them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

HUNTS = ("seeds", "model")
"""The tests of `hprm-sim` that look for faults, the quickest first."""


class Unusable(Exception):
    """A mutant that does not fit the code."""


@dataclass(frozen=True)
class Mutant:
    """A fault: what is wrong, and the lines of code that cause it."""

    name: str
    what: str
    file: str
    old: str
    new: str
    found_by: str | None = None

    @classmethod
    def read(cls, path: Path) -> Mutant:
        """Return the mutant that a file describes."""
        what, file, *lines = path.read_text().splitlines()
        old = "\n".join(line[1:] for line in lines if line.startswith("-"))
        new = "\n".join(line[1:] for line in lines if line.startswith("+"))
        if not what.startswith("# ") or not old:
            raise Unusable(
                f"{path.name} lacks the line that says what is wrong, or lines to replace"
            )
        file, *found_by = file.split()
        if found_by and found_by[0].partition("::")[0] not in HUNTS:
            raise Unusable(f"{path.name} names no test that looks for faults: {found_by}")
        return cls(path.stem, what[2:], file, old, new, *found_by)
