"""Federates as threads of one process against federates as processes, side by side in one run.

Two workloads: a small message that goes to another federate and back, and broadcast and gather of
large arrays to four clients. Every repetition runs each way once per workload, in an order that
rotates, and the ratios are taken within repetitions. Run by `make bench-in-process`; writes
out/in_process.json. It states ratios and is no test.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "broadcast_gather"))

import federation
import machine
from progress import ProgressBar
from run_text import run_text
from shown import show

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "in_process.json"
WAYS = [(coordination, way) for coordination in federation.PROGRAMS for way in (False, True)]
"""Coordinations, each with processes and then with threads."""

ROUND_TRIP = """
target Python {{ coordination: {coordination} }}
preamble {{=
  import json, os, time
  WARM_UP, ROUNDS = 200, {rounds}
=}}
reactor Ping {{
  input pong
  output ping
  state sent = 0
  state latencies = []
  reaction(startup) -> ping {{=
    self.sent = time.perf_counter_ns()
    ping.set(0)
  =}}
  reaction(pong) -> ping {{=
    now = time.perf_counter_ns()
    self.latencies.append(now - self.sent)
    if len(self.latencies) == WARM_UP + ROUNDS:
        with open(os.environ["HPRM_BENCH_OUT"], "w") as out:
            json.dump(self.latencies[WARM_UP:], out)
        lf.request_stop()
        return
    self.sent = time.perf_counter_ns()
    ping.set(pong.value + 1)
  =}}
}}
reactor Pong {{
  input ping
  output pong
  reaction(ping) -> pong {{= pong.set(ping.value) =}}
}}
federated reactor {{
  ping = new Ping()
  pong = new Pong()
  ping.ping -> pong.ping
  pong.pong -> ping.pong after 0
}}
"""

Results = dict[str, dict[str, list[list[int]]]]
"""Latencies in ns: by workload and way, a list of rounds per repetition."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, write; return the exit code."""
    parser = argparse.ArgumentParser(description="threads against processes")
    parser.add_argument("--size", type=int, default=50, help="of an array, in MB")
    parser.add_argument("--repetitions", type=int, default=5, help="of every workload and way")
    parser.add_argument("--rounds", type=int, default=10, help="of large arrays, in each")
    parser.add_argument("--messages", type=int, default=2000, help="small ones, in each")
    options = parser.parse_args(argv)
    try:
        results = measure(options)
    except federation.FederationError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    medians = {
        workload: {way: [statistics.median(r) / 1e3 for r in runs] for way, runs in by_way.items()}
        for workload, by_way in results.items()
    }
    for workload, by_way in medians.items():
        columns = ["coordination", "processes", "threads", "threads/processes"]
        show(f"{workload}: median in us (over the repetitions)", columns, rows(by_way))
    write(results, medians)
    print(f"wrote {OUT.relative_to(ROOT)}")
    return 0


def measure(options: argparse.Namespace) -> Results:
    """Run every workload in every way, in every repetition."""
    small, large = "small message, there and back", f"{options.size} MB, broadcast and gather"
    results: Results = {w: {name(*way): [] for way in WAYS} for w in (small, large)}
    bar = ProgressBar(options.repetitions * 2 * len(WAYS))
    try:
        for repetition in range(options.repetitions):
            shift = repetition % len(WAYS)
            for coordination, in_process in WAYS[shift:] + WAYS[:shift]:
                way = name(coordination, in_process)
                bar.show(way, 0)
                results[small][way].append(round_trips(coordination, in_process, options.messages))
                bar.step_done(way)
                run = federation.run(
                    coordination, [options.size], options.rounds, in_process=in_process
                )
                results[large][way].append(run["latencies_ns"][str(options.size)])
                bar.step_done(way)
    finally:
        bar.close()
    return results


def round_trips(coordination: str, in_process: bool, rounds: int) -> list[int]:
    """The latencies of small messages in one run, in ns."""
    text = ROUND_TRIP.format(coordination=coordination, rounds=rounds)
    with tempfile.TemporaryDirectory(prefix="in-process-") as folder:
        run_text(text, Path(folder), "RoundTrip", ["--in-process"] if in_process else [])
        latencies: list[int] = json.loads(Path(folder, "out").read_text())
        return latencies


def name(coordination: str, in_process: bool) -> str:
    """What a way is called."""
    return f"{coordination}, {'threads' if in_process else 'processes'}"


def rows(by_way: dict[str, list[float]]) -> Iterator[list[str]]:
    """Each coordination: medians over the repetitions, and what threads take of processes."""
    for coordination in federation.PROGRAMS:
        processes, threads = (by_way[name(coordination, way)] for way in (False, True))
        ratio = statistics.median(t / p for t, p in zip(threads, processes, strict=True))
        medians = [f"{statistics.median(each):.1f}" for each in (processes, threads)]
        yield [coordination, *medians, f"{ratio:.2f}"]


def write(results: Results, medians: dict[str, dict[str, list[float]]]) -> None:
    """Write the raw rounds and what was made of them."""
    OUT.parent.mkdir(exist_ok=True)
    document: dict[str, Any] = {
        "machine": machine.describe(federation.command()),
        "latencies_ns": results,
        "medians_us": medians,
    }
    OUT.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
