"""Broadcast and gather against pickle over Unix sockets, side by side in one run.

Every repetition runs each contender once per size, in an order that rotates, so that what the
machine does at the same time meets all of them. A repetition counts with the median of its
rounds, and the ratios are taken within repetitions. The goal is against `pickle`, which is how
Python programs do it; `pickle-reuse` shows what careful hands get out of the same means. Run by
`make bench`; writes out/gather_vs_pickle.json. It says whether the goal is met but is no test.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "broadcast_gather"))

import federation
import machine
import pickle_sockets
from measurement import WARM_UP_ROUNDS
from progress import ProgressBar

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "gather_vs_pickle.json"
RIVALS = {"pickle": False, "pickle-reuse": True}
"""Whether each rival reuses its receive buffers. The goal is against the first."""

OURS = tuple(federation.PROGRAMS)
GOAL_SIZE_MB = 50
GOAL_RATIO = 8

Results = dict[int, dict[str, list[list[int]]]]
"""Latencies in ns: by size and contender, a list of rounds per repetition."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measures, prints the table and the verdict, writes the JSON; returns the exit code."""
    options = parse(argv)
    try:
        results = measure(options.sizes, options.repetitions, options.rounds)
    except federation.FederationError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    medians = {size: medians_ms(by_name) for size, by_name in results.items()}
    ratios = {size: shares(by_name) for size, by_name in medians.items()}
    print(table(medians))
    for size, by_name in ratios.items():
        print("\n".join(verdict(size, name, by_rival) for name, by_rival in by_name.items()))
    write(results, medians, ratios)
    print(f"wrote {OUT.relative_to(ROOT)}")
    return 0


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="broadcast and gather against pickle, in ms")
    parser.add_argument("--sizes", type=_sizes, default=[50], help="in MB, as in 1,10,50")
    parser.add_argument("--repetitions", type=int, default=5, help="of every contender")
    parser.add_argument("--rounds", type=int, default=10, help="measured in each repetition")
    return parser.parse_args(argv)


def _sizes(text: str) -> list[int]:
    return [int(part) for part in text.split(",")]


def measure(sizes: Sequence[int], repetitions: int, rounds: int) -> Results:
    """Runs every contender in every repetition, one after the other."""
    contenders = [*RIVALS, *OURS]
    results: Results = {size: {name: [] for name in contenders} for size in sizes}
    bar = ProgressBar(repetitions * len(sizes) * len(contenders))
    try:
        for repetition in range(repetitions):
            shift = repetition % len(contenders)
            for size in sizes:
                for name in contenders[shift:] + contenders[:shift]:
                    label = f"{name}, {size} MB"
                    bar.show(label, 0)
                    results[size][name].append(latencies_ns(name, size, rounds))
                    bar.step_done(label)
    finally:
        bar.close()
    return results


def latencies_ns(name: str, size: int, rounds: int) -> list[int]:
    """One repetition of one contender: the latencies of its rounds."""
    if name in RIVALS:
        return pickle_sockets.latencies_ns(size, WARM_UP_ROUNDS, rounds, reuse=RIVALS[name])
    run = federation.run(name, [size], rounds)
    if not run["equal"][str(size)]:
        raise federation.FederationError(f"{name}, {size} MB: a gathered array is not the one sent")
    return run["latencies_ns"][str(size)]


def medians_ms(by_name: dict[str, list[list[int]]]) -> dict[str, list[float]]:
    """The median of each repetition, by contender."""
    return {
        name: [statistics.median(rounds) / 1e6 for rounds in repetitions]
        for name, repetitions in by_name.items()
    }


def shares(medians: dict[str, list[float]]) -> dict[str, dict[str, float]]:
    """By our contender and rival: how many of our rounds fit into one of theirs.

    It is taken within each repetition; what counts is the median over the repetitions.
    """
    return {
        name: {rival: _ratio(medians[rival], medians[name]) for rival in RIVALS} for name in OURS
    }


def _ratio(theirs: Sequence[float], ours: Sequence[float]) -> float:
    return statistics.median(their / our for their, our in zip(theirs, ours, strict=True))


def table(medians: dict[int, dict[str, list[float]]]) -> str:
    """The median over the repetitions, one line per size."""
    names = [*RIVALS, *OURS]
    lines = [
        "Broadcast and gather, 4 clients: median latency of a round in ms\n",
        f"{'size':>8}" + "".join(f"{name:>15}" for name in names),
    ]
    for size, by_name in medians.items():
        cells = "".join(f"{statistics.median(by_name[name]):15.2f}" for name in names)
        lines.append(f"{size:>5} MB{cells}")
    return "\n".join(lines) + "\n"


def verdict(size: int, name: str, by_rival: dict[str, float]) -> str:
    """Our share of each rival's time and, at the size it speaks of, whether the goal is met."""
    parts = [f"1/{ratio:.1f} of {rival}" for rival, ratio in by_rival.items()]
    line = f"{size} MB, {name}: a round takes " + ", ".join(parts)
    if size != GOAL_SIZE_MB:
        return line
    met = next(iter(by_rival.values())) >= GOAL_RATIO
    return f"{line}: {'passes' if met else 'fails'} the goal of at most 1/{GOAL_RATIO} of pickle"


def write(
    results: Results,
    medians: dict[int, dict[str, list[float]]],
    ratios: dict[int, dict[str, dict[str, float]]],
) -> None:
    """Writes the raw rounds and what was made of them."""
    OUT.parent.mkdir(exist_ok=True)
    document: dict[str, Any] = {
        "machine": machine.describe(federation.command()),
        "latencies_ns": results,
        "medians_ms": medians,
        "ratios": ratios,
    }
    OUT.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
