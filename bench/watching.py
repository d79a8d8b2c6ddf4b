"""What it costs a federation to be looked at: a message there and back, plain and watched.

Ways are `--trace`, `hprm top`, `hprm rate` and `hprm echo`, which reads each value. Each repetition
has all ways in an order that rotates; ratios are taken within repetitions, of medians. Watchers
have two seconds to begin before anything counts. Run by `make bench-watching`; writes
out/watching.json. It states ratios and is no test.
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import statistics
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "broadcast_gather"))

import federation
import machine
from run_text import run_text
from shown import show

OUT = Path(__file__).resolve().parents[1] / "out" / "watching.json"
COORDINATIONS = ("centralized", "decentralized")
PLAIN, TRACE = "plain", "--trace"
WATCHERS = {
    "hprm top": ["top", "Watched"],
    "hprm rate": ["rate", "--of", "Watched", "--wait", "10", "ping.ping"],
    "hprm echo": ["echo", "--of", "Watched", "--wait", "10", "--json", "ping.ping"],
}
WAYS = [PLAIN, TRACE, *WATCHERS]

PROGRAM = """
target Python { coordination: COORDINATION }
preamble {=
  import json, os, time
  BEGINNING_S, ROUNDS = BEGINS, COUNT
=}
reactor Ping {
  input pong
  output ping
  state sent = 0
  state until = 0
  state latencies = []
  reaction(startup) -> ping {=
    self.until = time.perf_counter_ns() + int(BEGINNING_S * 1e9)
    self.sent = time.perf_counter_ns()
    ping.set(0)
  =}
  reaction(pong) -> ping {=
    now = time.perf_counter_ns()
    if now > self.until:
        self.latencies.append(now - self.sent)
    if len(self.latencies) == ROUNDS:
        with open(os.environ["HPRM_BENCH_OUT"], "w") as out:
            json.dump(self.latencies, out)
        lf.request_stop()
        return
    self.sent = time.perf_counter_ns()
    ping.set(pong.value + 1)
  =}
}
reactor Pong {
  input ping
  output pong
  reaction(ping) -> pong {= pong.set(ping.value) =}
}
federated reactor {
  ping = new Ping()
  pong = new Pong()
  ping.ping -> pong.ping
  pong.pong -> ping.pong after 0
}
"""

Medians = dict[str, dict[str, list[float]]]
"""In us: by coordination and way, one for each repetition."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, write; return the exit code."""
    parser = argparse.ArgumentParser(description="what it costs to be looked at")
    parser.add_argument("--repetitions", type=int, default=5, help="of every way")
    parser.add_argument("--messages", type=int, default=20_000, help="in each")
    parser.add_argument("--beginning", type=float, default=2.0, help="seconds that do not count")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FILE", help="for the medians")
    options = parser.parse_args(argv)
    medians: Medians = {it: {way: [] for way in WAYS} for it in COORDINATIONS}
    try:
        for repetition in range(options.repetitions):
            shift = repetition % len(WAYS)
            for coordination in COORDINATIONS:
                for way in WAYS[shift:] + WAYS[:shift]:
                    times = run(coordination, way, options)
                    medians[coordination][way].append(statistics.median(times) / 1e3)
        about = machine.describe(federation.command())
        options.out.parent.mkdir(exist_ok=True)
        options.out.write_text(json.dumps({"machine": about, "us": medians}, indent=1) + "\n")
    except (federation.FederationError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    for coordination, by_way in medians.items():
        title = f"{coordination}: a message there and back, median in us, and as a multiple"
        show(title, ["", "median", "of plain", "least", "greatest"], rows(by_way))
    print(f"wrote {options.out}")
    return 0


def rows(by_way: dict[str, list[float]]) -> Iterator[list[str]]:
    """Each way: the median of its repetitions, and its ratios to plain ones."""
    for way, values in by_way.items():
        ratios = [it / plain for it, plain in zip(values, by_way[PLAIN], strict=True)]
        spread = (statistics.median(ratios), min(ratios), max(ratios))
        yield [way, f"{statistics.median(values):.1f}", *(f"{it:.3f}" for it in spread)]


def run(coordination: str, way: str, options: argparse.Namespace) -> list[int]:
    """Return the times of the messages of one run, in ns."""
    text = PROGRAM.replace("COORDINATION", coordination)
    text = text.replace("BEGINS", str(options.beginning)).replace("COUNT", str(options.messages))
    with tempfile.TemporaryDirectory(prefix="watching-") as folder:
        words = [f"--trace={folder}/a.trace"] if way == TRACE else []
        with watched(WATCHERS.get(way)):
            run_text(text, Path(folder), "Watched", words)
        times: list[int] = json.loads(Path(folder, "out").read_text())
        return times


@contextmanager
def watched(words: Sequence[str] | None) -> Iterator[None]:
    """Have a command look at the federation meanwhile, in a terminal that no person sees."""
    if words is None:
        yield
        return
    here, there = pty.openpty()
    reader = threading.Thread(target=_read_all, args=(here,), daemon=True)
    reader.start()
    # `top` ends at once where there is no federation yet.
    again = ["sh", "-c", 'until "$0" "$@"; do sleep 0.1; done', str(federation.command()), *words]
    watcher = subprocess.Popen(
        again, stdin=there, stdout=there, stderr=there, start_new_session=True
    )
    try:
        yield
    finally:
        os.killpg(watcher.pid, 9)
        watcher.wait()
        os.close(there)
        reader.join(5)
        os.close(here)


def _read_all(file: int) -> None:
    with suppress(OSError):
        while os.read(file, 1 << 16):
            pass


if __name__ == "__main__":
    sys.exit(main())
