"""The paper's evaluation on this machine: every figure and table of it, and one page about all.

Run by `make evaluation`. Each experiment writes its results into a JSON file in out/evaluation as
soon as it has them, and the page, index.html there, is written from these files: so experiments can
be made one by one, and the page again at any time. It states ratios, and is no test.
docs/howto/evaluation.md explains it; the experiments are modules of `evaluation`.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from evaluation import ROOT, gather, inference, order, page, placing, serialization
from evaluation.experiment import Effort, Experiment, ExperimentError
from evaluation.record import Record, RecordError, load
from options import positive

OUT = ROOT / "out" / "evaluation"
EXPERIMENTS: tuple[Experiment, ...] = tuple(
    it.EXPERIMENT for it in (gather, inference, serialization, placing, order)
)
NAMES = [it.name for it in EXPERIMENTS]


def main(argv: Sequence[str] | None = None) -> int:
    """Measures what is asked for, writes the page; returns the exit code."""
    options = parse(argv)
    effort = Effort(options.quick, options.repetitions, options.contenders)
    # A request to end is one for the processes of the experiment too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    failed = False
    try:
        if not options.page:
            options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        print(f"error: cannot write into {options.out}: {error.strerror}", file=sys.stderr)
        return 1
    try:
        for experiment in chosen(options.only) if not options.page else []:
            print(f"{experiment.name}: {experiment.title}", flush=True)
            try:
                print(f"wrote {measured(experiment, effort).save(options.out)}", flush=True)
            except ExperimentError as error:
                print(f"error: {error}", file=sys.stderr)
                failed = True
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    return write_page(options.out, options.page) or int(failed)


def measured(experiment: Experiment, effort: Effort) -> Record:
    """The record of an experiment, with how busy the machine was before.

    Raises:
        ExperimentError: it cannot be made, or there is nothing in it.

    """
    load = os.getloadavg()[0]
    record = experiment.measure(effort)
    if not record.cells:
        reasons = "".join(f"\n  {name}: {reason}" for name, reason in record.absent.items())
        raise ExperimentError(f"{experiment.name}: nothing could be measured{reasons}")
    record.command = effort.command(experiment.name)
    record.notes.append(f"The load average was {load:.1f} at the start.")
    return record


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(
        prog="evaluate.py",
        description="the paper's evaluation on this machine, and a page about it",
    )
    parser.add_argument(
        "--quick", action="store_true", help="a little of everything: does it work?"
    )
    parser.add_argument(
        "--only",
        type=_experiments,
        default=NAMES,
        metavar="NAMES",
        help=f"some of {','.join(NAMES)}",
    )
    parser.add_argument(
        "--contenders", type=_words, metavar="NAMES", help="parts of names, as in hprm,ros2"
    )
    parser.add_argument("--repetitions", type=positive, metavar="N", help="how often, in turns")
    parser.add_argument(
        "--page", action="store_true", help="measure nothing, write the page from earlier results"
    )
    parser.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help="for all files")
    return parser.parse_args(argv)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _experiments(text: str) -> list[str]:
    words = _words(text)
    if not words or not set(words) <= set(NAMES):
        raise argparse.ArgumentTypeError(f"{text!r}: must be some of {', '.join(NAMES)}")
    return words


def chosen(names: Sequence[str]) -> list[Experiment]:
    """The experiments of these names, in the order of the page."""
    return [it for it in EXPERIMENTS if it.name in names]


def write_page(folder: Path, alone: bool) -> int:
    """Writes the page from all results that are there; returns the exit code.

    With `alone`, nothing was measured before: then there must be results.
    """
    records: dict[str, Record] = {}
    missing: dict[str, str] = {}
    for name in NAMES:
        try:
            records[name] = load(folder, name)
        except RecordError as error:
            missing[name] = str(error).partition("\n")[0]
    if not records:
        if alone:
            print(
                f"error: {folder} has no results\n  hint: measure first: make evaluation",
                file=sys.stderr,
            )
        return 1
    target = folder / "index.html"
    try:
        target.write_text(page.html(records, missing, EXPERIMENTS))
    except OSError as error:
        print(f"error: cannot write {target}: {error.strerror}", file=sys.stderr)
        return 1
    print(f"wrote {target}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
