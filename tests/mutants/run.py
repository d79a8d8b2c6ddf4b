"""Checks that simulation and model checking find the faults that the mutants describe.

A mutant is a text in this folder: what is wrong with it, a file, the lines that are replaced, and
those that replace them. Behind the file, the text may name the test that is known to find it, as
`model::boards`, which is run first then. This script puts each mutant into a copy of the pure
crates, so the code that ships has no hooks for this; then it runs the tests of `crates/hprm-sim`,
which must fail. A mutant is an error if its old lines are not there exactly once, or if it does not
compile: it has to follow the code.
"""

from __future__ import annotations

import argparse
import os
import queue
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parents[2]
CRATES = ("hprm-core", "hprm-federated", "hprm-sim")
HUNTS = ("seeds", "model")
"""The tests of `hprm-sim` that look for faults, the quickest first."""

RANDOM = "seeds::random_federations_do_what_their_program_does"
"""The test that finds most mutants."""

RELAY = "crates/hprm-federated/src/relay"
"""Links between machines; the test `relay` looks for their faults."""

PATIENCE = 600
"""Seconds of a processor for a test; if it takes longer, the mutant counts as found: it never
ends."""

STANDSTILL = 3600.0
"""Seconds after which a test is over that takes no processor either."""

QUICK = 30
"""Seconds of a processor for a test that is compiled in a moment and runs slowly: most mutants are
found soon."""

FAULT = re.compile(r"seed (\d+): (.*)|(\w+: .*), in state (\d+), after")
"""How a test names a fault: then it need not look for others."""


RUNNING: set[int] = set()
"""The groups of processes that have been started, and have not ended."""


class Unusable(Exception):
    """A mutant that no longer fits the code."""


@dataclass(frozen=True)
class Mutant:
    """A fault: what is wrong, and the lines of code that cause it."""

    name: str
    what: str
    file: str
    old: str
    new: str
    found_by: str | None = None

    @classmethod
    def read(cls, path: Path) -> Mutant:
        """Return the mutant that a file describes."""
        what, file, *lines = path.read_text().splitlines()
        old = "\n".join(line[1:] for line in lines if line.startswith("-"))
        new = "\n".join(line[1:] for line in lines if line.startswith("+"))
        if not what.startswith("# ") or not old:
            raise Unusable(
                f"{path.name} lacks the line that says what is wrong, or lines to replace"
            )
        file, *found_by = file.split()
        if found_by and found_by[0].partition("::")[0] not in HUNTS:
            raise Unusable(f"{path.name} names no test that looks for faults: {found_by}")
        return cls(path.stem, what[2:], file, old, new, *found_by)

    def ways(self, allowed: tuple[str, ...]) -> list[tuple[str, bool]]:
        """Return the tests that look for it, and whether thoroughly, in the order of their runs."""
        if self.file.startswith(RELAY):
            return [("relay", False), ("relay", True)]
        hunts = [(hunt, True) for hunt in allowed]
        if self.found_by and self.found_by.partition("::")[0] in allowed:
            return [(self.found_by, True), *hunts]
        # Models have so many states that only optimized code looks at them.
        return [(RANDOM, False), *hunts] if "seeds" in allowed else hunts

    def apply(self, text: str) -> str:
        """Return the source text with the fault in it."""
        found = text.count(self.old)
        if found != 1:
            raise Unusable(
                f"{self.name}: its old lines occur {found} times in {self.file}, not once"
            )
        return text.replace(self.old, self.new)


class Copy:
    """A copy of the pure crates, which has one mutant at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "source"
        self.target = folder / "target"
        shutil.rmtree(self.folder, ignore_errors=True)
        for crate in CRATES:
            # The copies are as old as this run. Cargo takes older files for those of its last
            # build, which had another mutant.
            source, copy = ROOT / "crates" / crate, self.folder / "crates" / crate
            shutil.copytree(source, copy, copy_function=shutil.copyfile)
        manifest = (ROOT / "Cargo.toml").read_text()
        manifest = manifest.replace('debug = "line-tables-only"', "debug = 0")
        # Many builds and short runs: optimizing takes longer than it saves, but for what is not
        # found soon.
        manifest = manifest.replace("[profile.dev.package.", "[profile.thorough.package.")
        manifest = manifest.replace("opt-level = 3", "opt-level = 1")
        manifest += '\n[profile.thorough]\ninherits = "dev"\n'
        (self.folder / "Cargo.toml").write_text(manifest)
        shutil.copy(ROOT / "Cargo.lock", self.folder)

    def hunt(self, mutant: Mutant, hunts: tuple[str, ...]) -> str | None:
        """Return which test finds the mutant, and at which seed or state; None if no test does."""
        path = self.folder / mutant.file
        original = path.read_text()
        path.write_text(mutant.apply(original))
        try:
            found = (self.run(mutant, *how) for how in mutant.ways(hunts))
            return next(filter(None, found), None)
        finally:
            path.write_text(original)

    def run(self, mutant: Mutant, hunt: str, thoroughly: bool) -> str | None:
        """Return the first fault that a test finds with the mutant; None if it finds none."""
        suite, _, test = hunt.partition("::")
        words = ["--profile", "thorough" if thoroughly else "dev", "--test", suite]
        built = self.cargo(*words, "--no-run")
        if built.returncode != 0:
            raise Unusable(f"{mutant.name} does not compile:\n{built.stdout}")
        chosen = ["--exact", test] if test else []
        seconds = None if thoroughly else QUICK
        ran = self.cargo(*words, "--", "--nocapture", *chosen, until=FAULT, seconds=seconds)
        match = FAULT.search(ran.stdout)
        if ran.returncode == 0 or not (match or thoroughly):
            return None
        if not match:
            return f"{hunt}: " + " ".join(ran.stdout.split()[-12:])
        seed, wrong, told, states = match.groups()
        found = f"seed {seed}" if seed else f"state {states}"
        return f"{found:<12} {shortened(wrong or told)}"

    def cargo(
        self, *words: str, until: re.Pattern[str] | None = None, seconds: int | None = None
    ) -> subprocess.CompletedProcess[str]:
        """Run the tests of the simulation in the copy, up to a line that is looked for.

        They may take so many ``seconds`` of a processor.
        """
        command = ["cargo", "test", "--quiet", "-p", "hprm-sim", *words]
        limit = PATIENCE if seconds is None else seconds
        environment = os.environ | {
            "CARGO_INCREMENTAL": "1",
            "CARGO_TARGET_DIR": str(self.target),
            "RUST_BACKTRACE": "0",
        }
        with subprocess.Popen(
            command,
            cwd=self.folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            preexec_fn=lambda: begin(limit),
        ) as process:
            assert process.stdout is not None
            RUNNING.add(process.pid)
            watchdog = threading.Timer(STANDSTILL, os.killpg, (process.pid, signal.SIGKILL))
            watchdog.start()
            lines = []
            for line in process.stdout:
                lines.append(line)
                if until and until.search(line):
                    os.killpg(process.pid, signal.SIGKILL)
                    break
            code = process.wait()
            watchdog.cancel()
            RUNNING.discard(process.pid)
        return subprocess.CompletedProcess(command, code, "".join(lines))


class Copies:
    """Copies of the pure crates, each of which has one mutant at a time."""

    def __init__(self, folder: Path, number: int) -> None:
        self.number = number
        self.free: queue.SimpleQueue[Copy] = queue.SimpleQueue()
        first, *others = (Copy(folder / str(index)) for index in range(number))
        built = first.cargo("--no-run")
        if built.returncode == 0:
            built = first.cargo("--profile", "thorough", "--no-run")
        if built.returncode != 0:
            raise Unusable(f"without a mutant, the tests do not compile:\n{built.stdout}")
        self.free.put(first)
        for copy in others:
            # So what the crates depend on is compiled once.
            shutil.rmtree(copy.target, ignore_errors=True)
            shutil.copytree(first.target, copy.target, symlinks=True)
            self.free.put(copy)

    def hunt(self, mutants: list[Mutant], hunts: tuple[str, ...]) -> list[str | None]:
        """Check mutants side by side; return of each what finds it, and None if nothing does."""

        def checked(mutant: Mutant) -> str | None:
            copy = self.free.get()
            begun = time.monotonic()
            try:
                found = copy.hunt(mutant, hunts)
            finally:
                self.free.put(copy)
            seconds = time.monotonic() - begun
            print(f"{mutant.what:<68} {seconds:4.0f} s  {found or 'NOT FOUND'}", flush=True)
            return found

        # Those that simulation does not find soon take longest, and begin first.
        mutants = sorted(mutants, key=lambda mutant: mutant.found_by is None)
        with ThreadPoolExecutor(self.number) as pool:
            return list(pool.map(checked, mutants))


def begin(limit: int) -> None:
    """Be a group of processes, each of which may take so many seconds of a processor.

    A test is a child of cargo: both end at once.
    """
    # A session of its own would have its own share of the processors (`tests/beside.py`).
    os.setpgid(0, 0)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))


def stop(number: int, _frame: object) -> NoReturn:
    """End with all that has been started."""
    for group in list(RUNNING):
        with suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)
    os._exit(128 + number)


def shortened(text: str) -> str:
    """Return the beginning of a text, if it does not fit into the table."""
    return text if len(text) <= 70 else text[:67] + "..."


def main() -> int:
    """Check all mutants, or those that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="check only these mutants")
    parser.add_argument(
        "--hunt", choices=HUNTS, help="run only this test; by default, both until one finds it"
    )
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "mutants")
    options = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    paths = sorted(Path(__file__).parent.glob("*.txt"))
    try:
        mutants = [Mutant.read(path) for path in paths]
        chosen = [mutant for mutant in mutants if mutant.name in (options.names or [mutant.name])]
        copies = Copies(options.folder, min(os.cpu_count() or 1, max(1, len(chosen))))
        hunts = (options.hunt,) if options.hunt else HUNTS
        alive = copies.hunt(chosen, hunts).count(None)
    except Unusable as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{len(chosen)} mutants, {alive} not found")
    return 1 if alive or not chosen else 0


if __name__ == "__main__":
    sys.exit(main())
