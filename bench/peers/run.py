"""HPRM side by side with every peer that pip can install: one command, one page of results.

Every repetition runs each group of workloads with each contender in turn, in an order that rotates.
Run by `make bench`; prints the tables, writes out/bench.json and out/bench.html. It states ratios
and whether goals are met, and is no test. Contenders are in `contenders.py`, what is measured in
`plan.py`, what the processes do in `worker/`; docs/benchmarks.md explains the method.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "broadcast_gather"))

import contenders as who
import environments
import machine
import plan
import tables
from figures import Measurements
from goals import judge
from launch import Failed, Launcher
from progress import ProgressBar
from rich.console import Console, RenderableType

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "out"
_TRIES = 2
"""A contender that has failed so often in a group is left out of it from then on."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measures, prints the tables and the verdicts, writes the files; returns the exit code."""
    options = parse(argv)
    effort = _effort(options)
    hprm = Path(sys.executable).parent / "hprm"
    if not hprm.exists():
        print(f"error: {hprm} does not exist\n  hint: run `make build`", file=sys.stderr)
        return 1
    # Whoever asks the harness to end means its children too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sessions = selected(options)
        missing = prepare(sessions)
        launcher = Launcher(hprm, effort.session_limit_s)
        run = Run(options.only, sessions, effort, launcher, missing)
        run.all()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    about = machine.describe(hprm)
    # A file has room for wide tables.
    width = None if sys.stdout.isatty() else 200
    console = Console(markup=False, highlight=False, width=width)
    for part in report(run, about, options.out):
        console.print(part)
    return 0


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="HPRM side by side with its peers")
    parser.add_argument("--quick", action="store_true", help="once, a few rounds: does it work?")
    parser.add_argument("--only", type=_workloads, default=list(plan.WORKLOADS), help="as in W2,W5")
    parser.add_argument("--contenders", type=_words, help="parts of names, as in hprm,iceoryx2")
    parser.add_argument("--repetitions", type=int, help="of everything, interleaved")
    parser.add_argument("--out", type=Path, default=OUT, help="the folder for the files")
    return parser.parse_args(argv)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _workloads(text: str) -> list[str]:
    words = _words(text)
    if not words or not set(words) <= set(plan.WORKLOADS):
        raise argparse.ArgumentTypeError(f"some of {', '.join(plan.WORKLOADS)}")
    return [workload for workload in plan.WORKLOADS if workload in words]


def _effort(options: argparse.Namespace) -> plan.Effort:
    effort = plan.QUICK if options.quick else plan.FULL
    if options.repetitions:
        return dataclasses.replace(effort, repetitions=options.repetitions)
    return effort


Sessions = list[tuple[str, list[who.Contender]]]
"""Groups of workloads, each with those who take part in it."""


def selected(options: argparse.Namespace) -> Sessions:
    """What the command line asks for."""
    return [(group, _taking_part(group, options)) for group in plan.groups_of(options.only)]


def _taking_part(group: str, options: argparse.Namespace) -> list[who.Contender]:
    workloads = [workload for workload in options.only if group in plan.WORKLOADS[workload]]
    return [
        contender
        for contender in who.chosen(group, options.contenders)
        if any(contender.does(workload) for workload in workloads)
    ]


def prepare(sessions: Sessions) -> dict[str, str]:
    """Makes the environments of those who take part; why there is none, by environment."""
    wanted = {
        contender.environment
        for _, contenders in sessions
        for contender in contenders
        if contender.environment
    }
    missing: dict[str, str] = {}
    bar = ProgressBar(max(1, len(wanted)))
    try:
        for name in sorted(wanted):
            bar.show(f"installing {name}", 0)
            try:
                environments.prepare(name)
            except environments.Unavailable as reason:
                missing[name] = str(reason)
            bar.step_done(f"{name} is prepared")
    finally:
        bar.close()
    return missing


def rotated(contenders: list[who.Contender], repetition: int) -> list[who.Contender]:
    """The order of a repetition: each begins with another contender."""
    shift = repetition % max(1, len(contenders))
    return contenders[shift:] + contenders[:shift]


class Run:
    """All repetitions, and what became of them."""

    def __init__(
        self,
        workloads: list[str],
        sessions: Sessions,
        effort: plan.Effort,
        launcher: Launcher,
        missing: dict[str, str],
    ) -> None:
        """Has measured nothing yet."""
        self.workloads = workloads
        self.measurements = Measurements()
        self.repetitions = 0
        self.failures: dict[tuple[str, str], list[str]] = {}
        self.missing = missing
        self.seconds = 0.0
        self._effort = effort
        self._launcher = launcher
        processors = len(os.sched_getaffinity(0))
        self.impossible = [group for group, _ in sessions if not plan.possible(group, processors)]
        self._sessions = [
            (group, self._able(group, contenders))
            for group, contenders in sessions
            if group not in self.impossible
        ]

    def _able(self, group: str, contenders: list[who.Contender]) -> list[who.Contender]:
        return [
            contender
            for contender in contenders
            if contender.environment not in self.missing
            and plan.cells(group, self._workloads(contender), self._effort)
        ]

    def _workloads(self, contender: who.Contender) -> list[str]:
        return [workload for workload in self.workloads if contender.does(workload)]

    def all(self) -> None:
        """Runs repetition after repetition, until they are done or the time is over."""
        began = time.monotonic()
        total = sum(len(contenders) for _, contenders in self._sessions)
        bar = ProgressBar(max(1, self._effort.repetitions * total))
        try:
            for repetition in range(self._effort.repetitions):
                taken = time.monotonic() - began
                # One more takes about as long as those before.
                if repetition and taken * (1 + 1 / repetition) > self._effort.total_limit_s:
                    break
                for group, contenders in self._sessions:
                    for contender in rotated(contenders, repetition):
                        label = f"{repetition + 1}: {who.GROUPS[group]}, {contender.name}"
                        bar.show(label, 0)
                        self._session(contender, group, repetition)
                        bar.step_done(label)
                self.repetitions += 1
        finally:
            bar.close()
            self.seconds = time.monotonic() - began

    def _session(self, contender: who.Contender, group: str, repetition: int) -> None:
        failures = self.failures.get((group, contender.name), [])
        if len(failures) >= _TRIES:
            return
        cells = plan.cells(group, self._workloads(contender), self._effort)
        try:
            results = self._launcher.run(contender, group, cells)
        except Failed as failure:
            results = failure.results
            self.failures.setdefault((group, contender.name), []).append(str(failure))
        for result in results:
            self.measurements.add(group, contender.name, repetition, result)

    def notes(self) -> list[str]:
        """What a reader must know besides the tables."""
        planned = self._effort.repetitions
        notes = [f"{self.repetitions} of {planned} repetitions in {self.seconds / 60:.1f} minutes."]
        notes += [f"skipped: {name}: {reason}" for name, reason in self.missing.items()]
        notes += [f"skipped: {who.GROUPS[group]}: too few processors" for group in self.impossible]
        for (group, name), reasons in self.failures.items():
            times = f"{len(reasons)} times" if len(reasons) > 1 else "once"
            notes.append(f"failed {times}: {name}, {who.GROUPS[group]}: {reasons[-1]}")
        return notes


def report(run: Run, about: dict[str, Any], out: Path) -> list[RenderableType]:
    """Writes the files; what the terminal shows."""
    # What draws takes a second to import, also in processes that only measure.
    import page

    verdicts = judge(run.measurements, run.workloads)
    shown = tables.all_tables(run.measurements, run.workloads) + [tables.of_verdicts(verdicts)]
    out.mkdir(parents=True, exist_ok=True)
    data, sheet = out / "bench.json", out / "bench.html"
    document = {
        "machine": about,
        "notes": run.notes(),
        "versions": environments.REQUIREMENTS,
        "figures": run.measurements.as_json(),
        "goals": [
            dataclasses.asdict(verdict.goal)
            | {"measured": verdict.measured, "at": verdict.at, "is": verdict.word}
            for verdict in verdicts
        ],
    }
    data.write_text(json.dumps(document, indent=1) + "\n")
    sheet.write_text(page.html(run.measurements, run.workloads, shown, about, run.notes()))
    for_terminal = [tables.shown(table) for table in shown]
    return [*for_terminal, *run.notes(), *(f"wrote {path}" for path in (data, sheet))]


if __name__ == "__main__":
    sys.exit(main())
