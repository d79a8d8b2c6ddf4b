"""What it costs to send an array of 10 MB to one, four and eight federates: a loan, and copied.

Timed is what the sender does: from before `set` until its next tag begins, with everything placed.
The next array is sent when all receivers have answered, so nothing piles up.
Run by `python bench/receivers.py`; it states figures and is no test.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "broadcast_gather"))

import federation
from run_text import run_text
from shown import show

RECEIVERS = (1, 4, 8)
WAYS = {"loan": "hprm.empty(SIZE, np.uint8)", "copy": "self.kept"}

PROGRAM = """
target Python {{ coordination: {coordination} }}
preamble {{=
  import json, os, time
  import numpy as np
  import hprm
  SIZE, WARM_UP, ROUNDS = {size}, 5, {rounds}
=}}
reactor Sender {{
  output out
  input[{receivers}] answers
  logical action sent
  state kept = {{= np.ones(SIZE, np.uint8) =}}
  state began = 0
  state times = {{= [] =}}
  reaction(startup, answers) -> out, sent {{=
    array = {array}
    self.began = time.perf_counter_ns()
    out.set(array)
    sent.schedule(0)
  =}}
  reaction(sent) {{=
    self.times.append(time.perf_counter_ns() - self.began)
    if len(self.times) == WARM_UP + ROUNDS:
        with open(os.environ["HPRM_BENCH_OUT"], "w") as out:
            json.dump(self.times[WARM_UP:], out)
        lf.request_stop()
  =}}
}}
reactor Receiver {{
  input inp
  output answer
  reaction(inp) -> answer {{= answer.set(inp.value[-1]) =}}
}}
federated reactor {{
  sender = new Sender()
  receiver = new[{receivers}] Receiver()
  (sender.out)+ -> receiver.inp
  receiver.answer -> sender.answers after 1 msec
}}
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; return the exit code."""
    parser = argparse.ArgumentParser(description="a large array for several receivers")
    parser.add_argument("--size", type=int, default=10_000_000, help="of the array, in bytes")
    parser.add_argument("--rounds", type=int, default=100, help="in each repetition")
    parser.add_argument("--repetitions", type=int, default=5, help="of every number and way")
    parser.add_argument("--coordination", default="decentralized")
    options = parser.parse_args(argv)
    medians: dict[tuple[str, int], list[float]] = {}
    try:
        for _ in range(options.repetitions):
            for receivers in RECEIVERS:
                for way in WAYS:
                    times = run(way, receivers, options)
                    medians.setdefault((way, receivers), []).append(statistics.median(times) / 1e3)
    except federation.FederationError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    rows = (
        [way, str(receivers), *(f"{of(each):.1f}" for of in (statistics.median, min, max))]
        for (way, receivers), each in medians.items()
    )
    columns = ["array", "receivers", "median", "least", "greatest"]
    show(f"{options.size / 1e6:g} MB, {options.coordination}, in us", columns, rows)
    return 0


def run(way: str, receivers: int, options: argparse.Namespace) -> list[int]:
    """Return the times of one run, in ns."""
    text = PROGRAM.format(
        coordination=options.coordination,
        size=options.size,
        rounds=options.rounds,
        receivers=receivers,
        array=WAYS[way],
    )
    with tempfile.TemporaryDirectory(prefix="receivers-") as folder:
        run_text(text, Path(folder), "Receivers")
        times: list[int] = json.loads(Path(folder, "out").read_text())
        return times


if __name__ == "__main__":
    sys.exit(main())
