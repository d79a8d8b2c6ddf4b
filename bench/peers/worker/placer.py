"""What HPRM's program for placing arrays sends, and what it makes of the times."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
from script import cells_of
from session import Session

_SMALL = 16


class Placing:
    """The arrays to send, one after the other, each as often as its cell says."""

    def __init__(self, session: Session) -> None:
        """Begins with messages that are too small to be placed anywhere."""
        self.loan = bool(session.option("loan"))
        cells = cells_of(session.plan)
        self._cells = [dataclasses.replace(cells[0], size=_SMALL), *cells]
        self._out = session.out
        self._times: list[int] = []
        self._besides = 0
        self.array = self._next_array()

    def record(self, took_ns: int) -> bool:
        """Takes the time of one message; whether there is another one to send."""
        cell = self._cells[0]
        self._times.append(took_ns)
        count = len(self._times)
        over = sum(self._times) > cell.budget_s * 1e9 and count > cell.warm_up
        if count < cell.rounds + cell.warm_up and not over:
            return True
        self._finish(self._times[cell.warm_up :])
        self._cells = self._cells[1:]
        self._times = []
        if self._cells:
            self.array = self._next_array()
        return bool(self._cells)

    def _finish(self, times: list[int]) -> None:
        cell = self._cells[0]
        if cell.size == _SMALL:
            # The least, so that what is left of the others is rather too much than too little.
            self._besides = 0 if self.loan else min(times)
            return
        times = [max(took - self._besides, 1) for took in times]
        with open(self._out, "a") as file:
            said = {"workload": cell.workload, "size": cell.size, "times_ns": times}
            file.write(json.dumps(said) + "\n")

    def _next_array(self) -> np.ndarray:
        size = self._cells[0].size
        return np.random.default_rng(size).random((size // 16, 2))
