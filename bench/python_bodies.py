"""The scheduler's workloads with Python bodies, each in a process of its own.

What `cargo bench -p hprm` measures in Rust; here nearly all of the time is Python's. A program
counts from its first reaction to its last, so the start of the process is not in it. Run by
`make bench-python`; prints rates in thousands a second and writes out/python_bodies.json.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from shown import show

OUT = Path(__file__).resolve().parents[1] / "out" / "python_bodies.json"
REPETITIONS = 5
WIDTH = 100

CLOCK = """
target Python { fast: true }
preamble {=
  import time
  started = time.monotonic()
  def report(): print(time.monotonic() - started, flush=True)
=}
reactor Relay {
  input inp
  output out
  reaction(inp) -> out {= out.set(inp.value) =}
}
reactor Sink {
  input inp
}
reactor Source(limit = 0) {
  output out
  timer tick(0, 1 ns)
  state count = 0
  reaction(tick) -> out {=
    self.count += 1
    out.set(self.count)
    if self.count == self.limit:
        lf.request_stop()
        report()
  =}
}
"""

PROGRAMS = {
    "ping-pong": """
reactor Ping(rounds = 0) {
  input pong
  output ping
  logical action serve
  state count = 0
  reaction(startup) -> serve {= serve.schedule(0) =}
  reaction(serve) -> ping {=
    self.count += 1
    ping.set(self.count)
  =}
  reaction(pong) -> serve {=
    if self.count < self.rounds:
        serve.schedule(0)
    else:
        lf.request_stop()
        report()
  =}
}
main reactor {
  ping = new Ping(rounds=%d)
  pong = new Relay()
  ping.ping -> pong.inp
  pong.out -> ping.pong
}
""",
    "timer": """
main reactor {
  source = new Source(limit=%d)
}
""",
    f"chain of {WIDTH}": """
main reactor {
  source = new Source(limit=%d)
  relays = new[100] Relay()
  last = new Sink()
  source.out, relays.out -> relays.inp, last.inp
}
""",
    f"fan-out to {WIDTH}": """
main reactor {
  source = new Source(limit=%d)
  relays = new[100] Relay()
  (source.out)+ -> relays.inp
}
""",
}
"""Each takes how often its first reactor acts."""

UNITS = {"ping-pong": ("rounds", 30_000, 1), "timer": ("events", 100_000, 1)}
"""What is counted, how many times the first reactor acts, and how many units that is each time."""

WIDE = ("reactions", 1_000, WIDTH)


def seconds(path: Path) -> float:
    """How long a program ran, as it says itself."""
    command = [str(Path(sys.executable).with_name("hprm")), "run", str(path)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=600, check=True)
    return float(done.stdout)


def main() -> None:
    """Measure, print and write."""
    results, rows = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for name, text in PROGRAMS.items():
            unit, actions, each = UNITS.get(name, WIDE)
            path = Path(folder) / "Workload.lf"
            path.write_text(CLOCK + text % actions)
            rates = [actions * each / seconds(path) / 1e3 for _ in range(REPETITIONS)]
            median, low, high = statistics.median(rates), min(rates), max(rates)
            rows.append([name, unit, *(f"{rate:.0f}" for rate in (median, low, high))])
            results[name] = {"unit": unit, "thousand_per_second": rates}
    columns = ["workload", "of", "median", "least", "greatest"]
    show("Bodies in Python: thousands a second", columns, rows, names=2)
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
