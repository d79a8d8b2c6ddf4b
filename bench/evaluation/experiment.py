"""What an experiment is: something to measure, and what a page says of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from tables import Table as Table

from .record import Record


class ExperimentError(Exception):
    """An experiment cannot be made, or its results make no sense; the message says why."""


@dataclass(frozen=True)
class Effort:
    """How much is to be measured."""

    quick: bool = False
    """Once, and only contenders that need nothing installed: does it work?"""
    repetitions: int | None = None
    """As many as an experiment thinks right, if none are named."""
    contenders: list[str] | None = None
    """Parts of names; all, if none are named."""

    @property
    def form(self) -> str:
        """For records."""
        return "quick" if self.quick else "full"

    def command(self, experiment: str) -> str:
        """What makes an experiment with this effort."""
        words = ["python bench/evaluate.py --only", experiment]
        words += ["--quick"] if self.quick else []
        words += [f"--repetitions {self.repetitions}"] if self.repetitions else []
        words += [f"--contenders '{','.join(self.contenders)}'"] if self.contenders else []
        return " ".join(words)


@dataclass(frozen=True)
class Claim:
    """What the paper says in a number, and the same here."""

    what: str
    paper: str
    here: str


@dataclass(frozen=True)
class Section:
    """What a page says of an experiment that was made."""

    paper: Table
    """The numbers of the paper's figure."""
    tables: list[Table]
    pictures: list[str]
    """As SVG."""
    claims: list[Claim] = field(default_factory=list)
    differences: list[str] = field(default_factory=list)
    """What is not as in the paper, and why."""


@dataclass(frozen=True)
class Experiment:
    """One figure or table of the paper."""

    name: str
    title: str
    measure: Callable[[Effort], Record]
    section: Callable[[Record], Section]
