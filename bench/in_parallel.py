"""What runs in parallel when Python is the work: workers, and federates as threads or processes.

Two reactors each compute in Python, at the same tags: by one thread, by two workers, as two
federates of one process, and as two processes. Without a global lock in the interpreter
(`make bench-in-parallel PY=python3.14t`), threads should take half the time of one; with it,
only processes do. Each repetition runs each way once, and ratios are taken within repetitions.
Run by `make bench-in-parallel`; writes out/in_parallel.json. It states ratios and is no test.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "broadcast_gather"))

import federation
import machine
from progress import ProgressBar
from run_text import run_text
from shown import show

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "in_parallel.json"

PROGRAM = """
target Python {{ {properties} }}
preamble {{=
  import os, time
  def compute(count):
      number = 1
      for _ in range(count):
          number = (number * 1103515245 + 12345) & 0x7fffffff
      return number
=}}
reactor Computer(name = "") {{
  timer steps(0, 1 msec)
  state step = 0
  state began = 0
  reaction(steps) {{=
    self.began = self.began or time.monotonic_ns()
    compute({count})
    self.step += 1
    if self.step == {steps}:
        with open(os.environ["HPRM_BENCH_OUT"] + self.name, "w") as out:
            out.write(f"{{self.began}} {{time.monotonic_ns()}}")
        lf.request_stop()
  =}}
}}
{kind} reactor {{
  first = new Computer(name = "1")
  second = new Computer(name = "2")
}}
"""

ONE = "one thread"
WAYS: dict[str, tuple[str, str, list[str]]] = {
    ONE: ("main", "workers: 1", []),
    "two workers": ("main", "workers: 2", []),
    "federates as threads": ("federated", "coordination: decentralized", ["--in-process"]),
    "federates as processes": ("federated", "coordination: decentralized", []),
}
"""By name: the kind of the main reactor, the target properties, options of `hprm run`."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, write; return the exit code."""
    parser = argparse.ArgumentParser(description="what runs in parallel")
    parser.add_argument("--repetitions", type=int, default=5, help="of every way")
    parser.add_argument("--steps", type=int, default=50, help="reactions of each reactor")
    parser.add_argument("--count", type=int, default=100_000, help="turns of the loop in each")
    options = parser.parse_args(argv)
    try:
        times = measure(options)
    except federation.FederationError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    lock = (
        "without a global lock" if sysconfig.get_config_var("Py_GIL_DISABLED") else "with its lock"
    )
    rows = []
    for way, each in times.items():
        ratio = statistics.median(t / one for t, one in zip(each, times[ONE], strict=True))
        rows.append([way, f"{statistics.median(each):.2f}", f"{ratio:.2f}"])
    title = f"Python {sys.version.split()[0]}, {lock}: two reactors that compute, medians"
    show(title, ["way", "s", "of one thread"], rows)
    document = {"machine": machine.describe(federation.command()), "lock": lock, "seconds": times}
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps(document, indent=1) + "\n")
    print(f"wrote {OUT.relative_to(ROOT)}")
    return 0


def measure(options: argparse.Namespace) -> dict[str, list[float]]:
    """Seconds from the first reaction to the end of the last, by way, for each repetition."""
    times: dict[str, list[float]] = {way: [] for way in WAYS}
    bar = ProgressBar(options.repetitions * len(WAYS))
    try:
        for _ in range(options.repetitions):
            for way in WAYS:
                bar.show(way, 0)
                times[way].append(run(way, options.steps, options.count))
                bar.step_done(way)
    finally:
        bar.close()
    return times


def run(way: str, steps: int, count: int) -> float:
    """Seconds that one run takes, without its start."""
    kind, properties, arguments = WAYS[way]
    text = PROGRAM.format(kind=kind, properties=properties, steps=steps, count=count)
    with tempfile.TemporaryDirectory(prefix="in-parallel-") as folder:
        run_text(text, Path(folder), "Computers", arguments)
        spans = [Path(folder, f"out{name}").read_text().split() for name in ("1", "2")]
    return (max(int(end) for _, end in spans) - min(int(start) for start, _ in spans)) / 1e9


if __name__ == "__main__":
    sys.exit(main())
