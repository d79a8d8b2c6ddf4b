"""What an experiment has measured: a JSON file, from which the page can be written at any time."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from figures import Spread, spread

_FORMAT = 1


class RecordError(Exception):
    """A file has no record; the message says which, why, and what to do."""


@dataclass
class Cell:
    """What was measured of one contender in one case."""

    contender: str
    case: str
    unit: str
    values: dict[int, float]
    """What each repetition says, by its number."""
    p99: dict[int, float] = field(default_factory=dict)
    samples: list[float] = field(default_factory=list)
    """Every single measurement, where their distribution is shown."""
    counts: dict[str, float] = field(default_factory=dict)
    """What else was found, by name."""


@dataclass
class Record:
    """All of an experiment."""

    experiment: str
    form: str
    """`full` or `quick`."""
    machine: dict[str, Any]
    seconds: float
    cells: list[Cell]
    absent: dict[str, str] = field(default_factory=dict)
    """Contenders that were not measured, with the reasons."""
    notes: list[str] = field(default_factory=list)
    command: str = ""
    """What makes it again."""

    def contenders(self) -> list[str]:
        """All that were measured, in the order in which they came."""
        return _unique(cell.contender for cell in self.cells)

    def cases(self) -> list[str]:
        """All cases, in the order in which they came."""
        return _unique(cell.case for cell in self.cells)

    def cell(self, contender: str, case: str) -> Cell | None:
        """What was measured of a contender in a case, if anything was."""
        found = (it for it in self.cells if (it.contender, it.case) == (contender, case))
        return next(found, None)

    def spread(self, contender: str, case: str) -> Spread | None:
        """The median of the repetitions, with the least and the greatest."""
        cell = self.cell(contender, case)
        return spread(list(cell.values.values())) if cell and cell.values else None

    def ratio(self, contender: str, rival: str, case: str) -> float | None:
        """The contender's value as a multiple of the rival's, within repetitions: the median."""
        ours, theirs = self.cell(contender, case), self.cell(rival, case)
        if ours is None or theirs is None:
            return None
        both = [ours.values[at] / theirs.values[at] for at in ours.values if at in theirs.values]
        return spread(both).median if both else None

    def save(self, folder: Path) -> Path:
        """Writes the file of this experiment."""
        folder.mkdir(parents=True, exist_ok=True)
        path = file_of(folder, self.experiment)
        document = {"format": _FORMAT} | dataclasses.asdict(self)
        path.write_text(json.dumps(document, indent=1) + "\n")
        return path


def file_of(folder: Path, experiment: str) -> Path:
    """Where an experiment's record is."""
    return folder / f"{experiment}.json"


def load(folder: Path, experiment: str) -> Record:
    """Reads the file of an experiment.

    Raises:
        RecordError: there is none, or it is not one of this version.

    """
    path = file_of(folder, experiment)
    again = f"\n  hint: measure it: python bench/evaluate.py --only {experiment}"
    try:
        document = json.loads(path.read_text())
        if document.pop("format") != _FORMAT or document["experiment"] != experiment:
            raise RecordError(f"{path} was written by another version{again}")
        cells = [_cell(it) for it in document.pop("cells")]
        return Record(cells=cells, **document)
    except FileNotFoundError:
        raise RecordError(f"there is no {path}{again}") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise RecordError(f"{path} cannot be read: {error}{again}") from None


def _cell(document: dict[str, Any]) -> Cell:
    """A cell of a file: JSON has made the numbers of repetitions texts."""
    for name in ("values", "p99"):
        document[name] = {int(at): value for at, value in document[name].items()}
    return Cell(**document)


def _unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))
