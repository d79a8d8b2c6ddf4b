"""Showing how far the programs are, and in the end which failed and why."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from typing import Any, TextIO

from discover import Program
from execute import Job, Result

BAR = 30


class Progress:
    """One line that is rewritten, or a line for each program where nobody watches."""

    def __init__(self, total: int, stream: TextIO = sys.stderr) -> None:
        """Expect that many results."""
        self._total = total
        self._stream = stream
        self._done = 0
        self._failed = 0
        self._bar = stream.isatty()

    def show(self, result: Result) -> None:
        """Count a result."""
        self._done += 1
        self._failed += not result.passed
        if not self._bar:
            print(line(result), file=self._stream, flush=True)
            return
        filled = BAR * self._done // self._total
        bar = "#" * filled + "." * (BAR - filled)
        text = f"[{bar}] {self._done}/{self._total}  {self._failed} failed  {result.job.label}"
        print(f"\r\x1b[K{text[:100]}", end="", file=self._stream, flush=True)

    def end(self) -> None:
        """Leave the line."""
        if self._bar:
            print("\r\x1b[K", end="", file=self._stream, flush=True)


def line(result: Result) -> str:
    """A result in one line."""
    verdict = "pass" if result.passed else "fail"
    reason = f"  {result.reason}" if result.reason else ""
    return f"{verdict}  {result.job.label}  {result.seconds:.1f} s{reason}"


def summary(results: Iterable[Result], skipped: dict[Job, str]) -> str:
    """A table by folder, then what failed, what was skipped, and the sum."""
    results = sorted(results, key=lambda result: (result.job.program, result.job.single_threaded))
    folders = _by_folder(results, skipped)
    width = max(map(len, folders), default=0) + 2
    lines = [f"{'folder':<{width}}{'pass':>6}{'fail':>6}{'skipped':>9}"]
    for folder, counts in folders.items():
        row = [counts["pass"], counts["fail"], counts["skipped"]]
        lines.append(f"{folder:<{width}}{row[0]:>6}{row[1]:>6}{row[2]:>9}")
    failed = [result for result in results if not result.passed]
    for cause, members in _by_cause(failed).items():
        lines += ["", f"{cause} ({len(members)}):"]
        lines += [f"  {result.job.label}: {result.reason}" for result in members]
    without = [result for result in results if result.passed and result.without]
    if without:
        lines += ["", f"passed without a property that they state ({len(without)}):"]
        lines += [f"  {result.job.label}: {', '.join(result.without)}" for result in without]
    if skipped:
        lines += ["", f"skipped ({len(skipped)}):"]
        lines += [f"  {job.label}: {reason}" for job, reason in skipped.items()]
    passed = len(results) - len(failed)
    lines += ["", f"{passed} of {len(results)} passed, {len(skipped)} skipped"]
    return "\n".join(lines)


def as_json(results: Iterable[Result], skipped: dict[Job, str]) -> dict[str, Any]:
    """The same, for programs."""
    results = list(results)
    entries = [
        {
            **_identity(result.job),
            "status": "pass" if result.passed else "fail",
            "exit_code": result.exit_code,
            "seconds": round(result.seconds, 3),
            "reason": result.reason,
            "diagnostic": result.diagnostic or None,
            "without": list(result.without),
        }
        for result in results
    ]
    entries += [
        {**_identity(job), "status": "skipped", "reason": reason} for job, reason in skipped.items()
    ]
    return {
        "folders": {folder: dict(row) for folder, row in _by_folder(results, skipped).items()},
        "programs": sorted(entries, key=lambda entry: (entry["path"], entry["single_threaded"])),
    }


def _identity(job: Job) -> dict[str, Any]:
    program: Program = job.program
    return {
        "path": program.path,
        "folder": program.folder,
        "federated": program.federated,
        "single_threaded": job.single_threaded,
    }


def _by_folder(results: Iterable[Result], skipped: Iterable[Job]) -> dict[str, Counter[str]]:
    verdicts = [(result.job, "pass" if result.passed else "fail") for result in results]
    verdicts += [(job, "skipped") for job in skipped]
    rows: dict[str, Counter[str]] = {}
    for job, verdict in verdicts:
        kind = ", single-threaded" if job.single_threaded else ""
        name = job.program.folder + kind
        rows.setdefault(name, Counter({"pass": 0, "fail": 0, "skipped": 0}))[verdict] += 1
    return dict(sorted(rows.items()))


def _by_cause(failed: Iterable[Result]) -> dict[str, list[Result]]:
    """Failures by what they have in common: a diagnostic, the time, or an exit code."""
    causes: dict[str, list[Result]] = {}
    for result in failed:
        if result.diagnostic:
            cause = f"refused with {result.diagnostic}"
        elif result.exit_code is None:
            cause = "time is up"
        else:
            cause = f"exit code {result.exit_code}"
        causes.setdefault(cause, []).append(result)
    return dict(sorted(causes.items()))
