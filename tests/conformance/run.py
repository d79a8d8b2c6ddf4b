"""Runs Lingua Franca's own tests of its Python target, from a checkout of its repository.

    python tests/conformance/run.py /path/to/lingua-franca

Every program must end with exit code 0. The command ``hprm`` beside this interpreter runs them.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import discover
import report
from execute import Job, Result, Runner

NEEDS = {
    "federated/DistributedCountSST.lf": "needs an authentication server of another project",
}
"""What no machine has without further ado."""


def main(words: list[str] | None = None) -> int:
    """Run what the command line says; return the exit code."""
    options = parser().parse_args(words)
    hprm = Path(sys.executable).with_name("hprm")
    if not hprm.exists():
        print(f"error: there is no {hprm}; `make build` puts it there", file=sys.stderr)
        return 2
    try:
        programs = discover.discover(options.checkout)
    except discover.Unusable as error:
        print(f"error: {error}", file=sys.stderr)
        print("  hint: name a checkout of Lingua Franca's repository", file=sys.stderr)
        return 2
    programs = discover.chosen(programs, options.only, options.folder, options.federated)
    if not programs:
        print("error: no program fits --only, --folder and --federated", file=sys.stderr)
        return 2
    words = ["--in-process"] if options.in_process else []
    jobs, skipped = plan(programs, options.single_threaded)
    results: list[Result] = []
    progress = report.Progress(len(jobs))

    def done(result: Result) -> None:
        results.append(result)
        progress.show(result)

    with Runner(options.checkout, hprm, options.timeout, words) as runner:
        try:
            runner.run(jobs, options.jobs, done)
        finally:
            progress.end()
    print(report.summary(results, skipped))
    if options.json:
        options.json.write_text(json.dumps(report.as_json(results, skipped), indent=2) + "\n")
    return 0 if all(result.passed for result in results) else 1


def plan(
    programs: list[discover.Program], single_threaded: bool
) -> tuple[list[Job], dict[Job, str]]:
    """What to run, and what not and why."""
    jobs = [Job(program) for program in programs]
    if single_threaded:
        jobs += [
            Job(program, single_threaded=True)
            for program in programs
            if not program.federated and program.folder in discover.SINGLE_THREADED
        ]
    skipped = {job: NEEDS[job.program.path] for job in jobs if job.program.path in NEEDS}
    return [job for job in jobs if job not in skipped], skipped


def parser() -> argparse.ArgumentParser:
    """What can be typed."""
    parser = argparse.ArgumentParser(
        description="Run Lingua Franca's tests of its Python target with HPRM.",
        epilog="The exit code is 0 if all passed, 1 if one failed, 2 if nothing could be run.",
    )
    parser.add_argument("checkout", type=Path, help="a checkout of Lingua Franca's repository")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results there as well")
    parser.add_argument(
        "--jobs",
        type=_positive,
        default=os.cpu_count() or 1,
        metavar="N",
        help="how many at a time",
    )
    parser.add_argument(
        "--timeout",
        type=float,
        default=120,
        metavar="SECONDS",
        help="how long a program may take (120)",
    )
    parser.add_argument("--only", metavar="PATTERN", help="only programs whose path fits, as Mode*")
    parser.add_argument(
        "--folder",
        type=lambda text: text.split(","),
        default=[],
        metavar="NAMES",
        help="only these folders, as src,multiport",
    )
    parser.add_argument(
        "--single-threaded",
        action="store_true",
        help="run again with one thread what Lingua Franca runs so",
    )
    parser.add_argument(
        "--federated",
        action=argparse.BooleanOptionalAction,
        help="only federated programs, or none",
    )
    parser.add_argument(
        "--in-process", action="store_true", help="run federates as threads of one process"
    )
    return parser


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("at least 1")
    return number


if __name__ == "__main__":
    sys.exit(main())
