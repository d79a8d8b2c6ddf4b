"""The demonstration: both coordinations, one table, one picture, all the raw numbers.

Run by `make demo`; writes out/broadcast_gather.json and out/broadcast_gather.svg under the
repository's root. How a federation is run is in `federation.py`.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import chart
import federation
import machine
import rich
import summary
from progress import ProgressBar

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "out"
TITLE = "Broadcast and gather of float64 arrays, 4 clients"


def main() -> int:
    """Runs, prints and writes everything; returns the exit code."""
    started = time.monotonic()
    try:
        runs = measure()
    except federation.FederationError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    unequal = [f"{name}, {size} MB" for name, size in unequal_copies(runs)]
    if unequal:
        print(f"error: a gathered array is not the one sent: {unequal}", file=sys.stderr)
        return 1
    summaries = {name: summaries_of(run) for name, run in runs.items()}
    files = write(runs, summaries)
    print(f"{TITLE}: latency of a round in ms")
    rich.print(summary.table(summaries))
    print(f"All gathered arrays were equal to the one sent. {time.monotonic() - started:.0f} s.")
    for file in files:
        print(f"wrote {file.relative_to(ROOT)}")
    return 0


def measure() -> dict[str, dict[str, Any]]:
    """Runs the federation once in each coordination, under one progress bar."""
    bar = ProgressBar(len(federation.PROGRAMS))
    runs = {}
    try:
        for name in federation.PROGRAMS:
            bar.show(name, 0)
            runs[name] = federation.run(
                name, on_progress=lambda fraction, name=name: bar.show(name, fraction)
            )
            bar.step_done(name)
    finally:
        bar.close()
    return runs


def unequal_copies(runs: dict[str, dict[str, Any]]) -> list[tuple[str, str]]:
    """The coordination and size of every comparison of arrays that failed."""
    return [
        (name, size)
        for name, run in runs.items()
        for size in run["latencies_ns"]
        if not run["equal"].get(size)
    ]


def summaries_of(run: dict[str, Any]) -> dict[int, summary.Summary]:
    """The summary of each size; JSON has turned the sizes into strings."""
    return {
        int(size): summary.summarize(latencies) for size, latencies in run["latencies_ns"].items()
    }


def write(
    runs: dict[str, dict[str, Any]], summaries: dict[str, dict[int, summary.Summary]]
) -> list[Path]:
    """Writes the raw numbers and the picture; returns where they are."""
    OUT.mkdir(exist_ok=True)
    about = machine.describe(federation.command())
    data = OUT / "broadcast_gather.json"
    data.write_text(json.dumps({"title": TITLE, "machine": about, "runs": runs}, indent=1) + "\n")
    picture = OUT / "broadcast_gather.svg"
    subtitle = f"Median, whisker to the 99th percentile. {about['cpu']}, {about['cpus']} CPUs"
    picture.write_text(chart.svg(summaries, TITLE, subtitle))
    return [data, picture]


if __name__ == "__main__":
    sys.exit(main())
