"""How often messages are handled out of order, on a loaded machine, with tags and without.

The program is `Ordering.lf`: numbers on three ways of different length that meet again. Tags must
leave no violation that nobody notices: a message is handled at its tag, or the `tardy` handler runs
with the tag that was meant. Beside it, the same without tags (`untagged.py`). Run by
`make bench-ordering`; writes out/ordering.json. The exit code is 1 if a violation went unnoticed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "broadcast_gather"))

import federation
import machine
import untagged
from busy import busy
from progress import ProgressBar
from shown import show

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = Path(__file__).with_name("Ordering.lf")
OUT = ROOT / "out" / "ordering.json"
MESSAGES_A_STEP = len(untagged.WAYS) * untagged.SUBSCRIBERS
SHARES = {10.0: 0.04, 1.0: 0.24, 0.3: 0.36, 0.1: 0.36}
"""Which part of a contender's messages is sent with each period, in ms. Long ones take long."""

TIME_LIMIT_S = 600.0


class Failed(federation.FederationError):
    """A program did not do its work; the message says which and why."""


@dataclass(frozen=True)
class Tagged:
    """A way to run the program with tags."""

    coordination: str
    maxwait_ms: float | None = None

    @property
    def name(self) -> str:
        """For people."""
        if self.coordination == "centralized":
            return "hprm centralized"
        wait = "for ever" if self.maxwait_ms is None else f"{self.maxwait_ms:g} ms"
        return f"hprm decentralized, waits {wait}"

    def run(self, flow: untagged.Flow) -> dict[str, Any]:
        """Runs the program, and adds up what its subscribers have seen."""
        maxwait = -1 if self.maxwait_ms is None else round(self.maxwait_ms * 1e6)
        command = [str(federation.command()), "run", f"--property=coordination={self.coordination}"]
        command += [str(PROGRAM), str(flow.steps), str(flow.period_ns), str(maxwait)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise Failed(f"{' '.join(command)} took longer than {TIME_LIMIT_S:.0f} s") from None
        if done.returncode != 0:
            raise Failed(f"{' '.join(command)} failed\n{done.stderr}")
        said = [json.loads(line.partition("] ")[2]) for line in done.stdout.splitlines()]
        if len(said) != untagged.SUBSCRIBERS:
            raise Failed(f"{' '.join(command)} has not reported\n{done.stdout}")
        total = {key: sum(one[key] for one in said) for key in ["messages", "tardy", "undetected"]}
        return total | {"seconds": max(one["seconds"] for one in said)}


TAGGED = [
    Tagged("centralized"),
    Tagged("decentralized"),
    Tagged("decentralized", 5.0),
    Tagged("decentralized", 1.0),
]


def main(argv: Sequence[str] | None = None) -> int:
    """Measures, prints the table and the verdict, writes the JSON; returns the exit code."""
    options = parse(argv)
    chosen = contenders(not options.only_tagged)
    try:
        with busy(options.load):
            rows = measure(options, chosen)
    except federation.FederationError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    title = f"Messages out of order, beside {options.load} busy loops; noticed: the handler ran"
    columns = ["period", "contender", "messages", "unnoticed", "noticed", "messages/s"]
    show(title, columns, map(cells, rows), names=2)
    if not options.only_tagged and "pyzmq PUB/SUB" not in chosen:
        print("pyzmq PUB/SUB is skipped: pyzmq is not installed")
    missed = sum(row.get("undetected", 0) for row in rows)
    sent = sum(row["messages"] for row in rows if "tardy" in row)
    print(f"with tags: {missed} violations unnoticed in {sent} messages")
    result = {
        "machine": machine.describe(federation.command()),
        "busy_loops": options.load,
        "rows": rows,
    }
    options.out.parent.mkdir(exist_ok=True)
    options.out.write_text(json.dumps(result, indent=1) + "\n")
    return 1 if missed else 0


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="order of messages, with tags and without")
    parser.add_argument("--messages", type=int, default=300_000, help="with tags, in all")
    parser.add_argument("--periods", type=_periods, default=list(SHARES), help="in ms, as in 1,0.1")
    parser.add_argument("--load", type=int, default=os.cpu_count(), help="busy loops beside")
    parser.add_argument("--only-tagged", action="store_true", help="without the peers")
    parser.add_argument("--out", type=Path, default=OUT, help="the JSON file")
    return parser.parse_args(argv)


def _periods(text: str) -> list[float]:
    periods = [float(part) for part in text.split(",")]
    if not set(periods) <= set(SHARES):
        raise argparse.ArgumentTypeError(f"some of {', '.join(map(str, SHARES))} ms")
    return periods


Contenders = dict[str, Callable[[untagged.Flow], dict[str, Any]]]


def contenders(with_untagged: bool) -> Contenders:
    """All ways to run the program, by name."""
    tagged: Contenders = {it.name: it.run for it in TAGGED}
    return tagged | (untagged.contenders() if with_untagged else {})


def measure(options: argparse.Namespace, contenders: Contenders) -> list[dict[str, Any]]:
    """Runs every contender with every period, side by side: period by period."""
    rows = []
    bar = ProgressBar(len(options.periods) * len(contenders))
    shares = sum(SHARES[period] for period in options.periods)
    try:
        for period_ms in options.periods:
            share = SHARES[period_ms] / shares
            steps = round(options.messages / len(TAGGED) / MESSAGES_A_STEP * share)
            flow = untagged.Flow(max(steps, 2), round(period_ms * 1e6))
            for name, run in contenders.items():
                bar.show(f"{name}, {period_ms:g} ms", 0)
                rows.append({"period_ms": period_ms, "contender": name} | run(flow))
                bar.step_done(f"{name}, {period_ms:g} ms")
    finally:
        bar.close()
    return rows


def cells(row: dict[str, Any]) -> list[str]:
    """What the table says of a contender with a period."""
    unnoticed = row.get("undetected", row.get("out_of_order"))
    counts = [row["messages"], unnoticed, row.get("tardy", "-")]
    rate = round(row["messages"] / row["seconds"])
    return [f"{row['period_ms']:g} ms", row["contender"], *map(str, counts), str(rate)]


if __name__ == "__main__":
    sys.exit(main())
