"""The driving application: how long it takes from an observation to the action that answers it."""

from __future__ import annotations

import statistics
import time

import machine
import numpy as np
from contenders import Contender
from launch import Failed, Result
from progress import ProgressBar
from run import prepare, rotated
from tables import number

from .drives import CONTENDERS, GROUP, DrivingLauncher
from .experiment import Claim, Effort, Experiment, ExperimentError, Section, Table
from .record import Cell, Record
from .texts import less, paragraphs, shown
from .workloads import hprm, taking_part

NAME = "inference"
CASE = "a frame"
_WARM_UP, _FRAMES, _REPETITIONS = 100, 400, 3
_QUICK_WARM_UP, _QUICK_FRAMES = 5, 15
_LIMIT_S, _TOTAL_LIMIT_S = 180.0, 15 * 60
_QUICK = ("hprm decentralized", "hprm in one process", "unix + pickle")

PAPER = Table(
    "The paper's box plot: milliseconds from the observation to the action, read off the picture",
    ["", "median", "quartiles"],
    [
        ["ROS 2 Humble", "268", "265–275"],
        ["ROS 2 Humble (shared memory)", "33", "30–36"],
        ["HPRM decentralized", "22", "20–26"],
        ["HPRM centralized", "24", "21–30"],
    ],
)
DIFFERENCES = paragraphs("""
The simulator is the town of examples/driving and not CARLA: its pictures have 640 by 480 pixels
(0.9 MB), its bird's-eye view 64 by 64 cells in six channels. The agent and the detector are the
networks of examples/driving as far as their files are there (the line with the command names
them), run on one thread each. They are smaller than the PPO agent and YOLOv5 of the paper, and no
GPU takes part. So the shares of communication differ more between contenders here, and
differences in milliseconds tell more than ratios.

The reactors are those of examples/driving, with a clock around the agent and the detector. The
other contenders have the same four programs with the same models, packages and messages; the
simulator's own time is excluded everywhere, since the clock runs from the sending of an
observation to its action.

HPRM's simulator draws its pictures into memory of the store, as in examples/driving; the others
draw into memory of their own and send it. Drawing is the simulator's own time, sending is not.

The share of communication is what is left of a frame's time without the longer of the two
computations, which run in parallel.

Every contender has to drive the same way, to the last digit, or the experiment fails.
""")


def measure(effort: Effort) -> Record:
    """Drives with each contender in turn."""
    chosen = taking_part(NAME, CONTENDERS, effort, _QUICK)
    began = time.monotonic()
    missing = prepare([(GROUP, chosen)])
    able = [it for it in chosen if it.environment not in missing]
    drives = _Drives(effort)
    drives.all(able, effort.repetitions or (1 if effort.quick else _REPETITIONS))
    absent = {it.name: missing[it.environment] for it in chosen if it.environment in missing}
    return Record(
        NAME,
        effort.form,
        machine.describe(hprm()),
        time.monotonic() - began,
        list(drives.cells.values()),
        absent | drives.failures,
        drives.notes(),
    )


class _Drives:
    """All repetitions, and what became of them."""

    def __init__(self, effort: Effort) -> None:
        self.cells: dict[str, Cell] = {}
        self.failures: dict[str, str] = {}
        self._warm_up = _QUICK_WARM_UP if effort.quick else _WARM_UP
        self._frames = self._warm_up + (_QUICK_FRAMES if effort.quick else _FRAMES)
        self._launcher = DrivingLauncher(hprm(), _LIMIT_S)
        self._drove: dict[str, str] = {}

    def all(self, contenders: list[Contender], repetitions: int) -> None:
        """Drives with each contender in each repetition; one that fails is left out after that."""
        bar = ProgressBar(max(1, repetitions * len(contenders)))
        began = time.monotonic()
        try:
            for repetition in range(repetitions):
                taken = time.monotonic() - began
                if repetition and taken * (1 + 1 / repetition) > _TOTAL_LIMIT_S:
                    break
                for contender in rotated(contenders, repetition):
                    label = f"{repetition + 1}: driving, {contender.name}"
                    bar.show(label, 0)
                    if contender.name not in self.failures:
                        self._drive(contender, repetition)
                    bar.step_done(label)
        finally:
            bar.close()

    def _drive(self, contender: Contender, repetition: int) -> None:
        try:
            told = self._launcher.drive(contender, self._frames)
            self._take(contender.name, repetition, {it["role"]: it for it in told})
        except Failed as failure:
            self.failures[contender.name] = str(failure)

    def _take(self, name: str, repetition: int, told: dict[str, Result]) -> None:
        """Adds what the programs of a drive said."""
        if not {"simulator", "agent", "detector"} <= told.keys():
            raise Failed(f"of its programs, only {', '.join(told)} said what they did", [])
        self._drove[name] = "{drove}; {models}".format(**told["simulator"])
        if len(set(self._drove.values())) > 1:
            raise ExperimentError(f"{NAME}: contenders drove different ways: {self._drove}")
        took, shares = of_frames(told, self._warm_up)
        cell = self.cells.setdefault(name, Cell(name, CASE, "ms", {}))
        cell.values[repetition] = float(np.median(took))
        cell.p99[repetition] = float(np.percentile(took, 99))
        cell.samples += [round(it, 4) for it in took]
        cell.counts[f"share {repetition}"] = float(np.median(shares))

    def notes(self) -> list[str]:
        """What a reader must know besides the tables."""
        drove = next(iter(self._drove.values()), "nowhere")
        frames = f"{self._frames - self._warm_up} frames after {self._warm_up} to warm up"
        return [f"{frames} in each repetition. All contenders drove the same way: {drove}."]


def of_frames(told: dict[str, Result], warm_up: int) -> tuple[np.ndarray, np.ndarray]:
    """The milliseconds of each frame, and which part of them was communication."""
    took = np.array(told["simulator"]["latencies_ns"][warm_up:]) / 1e6
    # From the last frame backwards: the first one comes before the clocks of HPRM's federates.
    both = [told[role]["computed_ns"][-len(took) :] for role in ("agent", "detector")]
    if not len(took) or any(len(it) != len(took) for it in both):
        frames = len(told["simulator"]["latencies_ns"])
        raise ExperimentError(f"{NAME}: the journey ended too soon, after {frames} frames")
    return took, 1 - np.maximum(*(np.array(it) / 1e6 for it in both)) / took


def section(record: Record) -> Section:
    """What the page says of it."""
    # What draws takes a second to import, also in processes that only measure.
    from . import charts

    names = sorted(record.contenders(), key=lambda name: _median(record, name))
    rows = [
        [name, shown(record.spread(name, CASE)), _p99(record, name), _share(record, name)]
        for name in names
    ]
    columns = ["", "median, ms", "p99, ms", "share of communication"]
    samples = {name: _samples(record, name) for name in names}
    return Section(
        PAPER,
        [Table("Milliseconds from the observation to the action", columns, rows)],
        [charts.boxes("Communication and inference", "ms", samples)],
        _claims(record),
        DIFFERENCES,
    )


def _claims(record: Record) -> list[Claim]:
    claims = []
    for rival, paper in (("ros2", {"decentralized": "91.1 %"}), ("ros2 + shm", _PAPER_SHM)):
        for coordination, said in paper.items():
            what = f"driving: {coordination} coordination takes less than “{rival}”"
            ratio = record.ratio(f"hprm {coordination}", rival, CASE)
            claims.append(Claim(what, said, less(ratio)))
    peers = [name for name in record.contenders() if not name.startswith("hprm")]
    if peers and "hprm decentralized" in record.contenders():
        best = min(peers, key=lambda name: _median(record, name))
        ratio = record.ratio("hprm decentralized", best, CASE)
        claims.append(Claim(f"the same beside the best peer here, “{best}”", "–", less(ratio)))
    return claims


_PAPER_SHM = {"decentralized": "29.2 %", "centralized": "23.6 %"}


def _samples(record: Record, name: str) -> list[float]:
    cell = record.cell(name, CASE)
    return cell.samples if cell else []


def _median(record: Record, name: str) -> float:
    spread = record.spread(name, CASE)
    return spread.median if spread else 0.0


def _p99(record: Record, name: str) -> str:
    cell = record.cell(name, CASE)
    return number(statistics.median(cell.p99.values())) if cell and cell.p99 else "–"


def _share(record: Record, name: str) -> str:
    cell = record.cell(name, CASE)
    shares = list(cell.counts.values()) if cell else []
    return f"{100 * statistics.median(shares):.0f} %" if shares else "–"


EXPERIMENT = Experiment(NAME, "Inference latency of a driving application", measure, section)
