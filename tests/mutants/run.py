"""Checks that simulation and model checking find the faults that the mutants describe.

A mutant is a text in this folder: what is wrong with it, a file, the lines that are replaced, and
those that replace them. Behind the file, the text may name the test that is known to find it, as
`model::boards`, which is run first then. This script makes one copy of the pure crates, in which
all mutants are and a variable of the environment chooses one (`schemata.py`); so the code that
ships has no hooks for this. With each mutant, the tests of `crates/hprm-sim` must fail. A mutant is
an error if its old lines are not there exactly once: it has to follow the code.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from mutant import HUNTS, Mutant, Unusable
from schemata import CHOICE, with_mutants

ROOT = Path(__file__).resolve().parents[2]
CRATES = ("hprm-core", "hprm-federated", "hprm-sim")
RANDOM = "seeds::random_federations_do_what_their_program_does"
"""The test that finds most mutants."""

SOUND = ("seeds", "relay")
"""The tests that are also run without a mutant: then they must find nothing."""

RELAY = "crates/hprm-federated/src/relay"
"""Links between machines; the test `relay` looks for their faults."""

PATIENCE = 600
"""Seconds of a processor for a test; if it takes longer, the mutant counts as found: it never
ends."""

QUICK = 30
"""Seconds of a processor for the test that finds most of them soon; then all tests look for it."""

STANDSTILL = 3600.0
"""Seconds after which a test is over that takes no processor either."""

FAULT = re.compile(r"seed (\d+): (.*)|(\w+: .*), in state (\d+), after")
"""How a test names a fault: then it need not look for others."""


RUNNING: set[int] = set()
"""The groups of processes that have been started, and have not ended."""


def ways(mutant: Mutant, allowed: tuple[str, ...]) -> list[tuple[str, int]]:
    """Return the tests that look for a mutant, in their order, and how long each may take."""
    if mutant.file.startswith(RELAY) and not mutant.found_by:
        return [("relay", PATIENCE)]
    hunts = [(hunt, PATIENCE) for hunt in allowed]
    if mutant.found_by and mutant.found_by.partition("::")[0] in allowed:
        return [(mutant.found_by, PATIENCE), *hunts]
    return [(RANDOM, QUICK), *hunts] if "seeds" in allowed else hunts


class Copy:
    """A copy of the pure crates with all mutants in it, compiled."""

    def __init__(self, folder: Path, numbered: dict[int, Mutant]) -> None:
        self.folder = folder / "source"
        self.target = folder / "target"
        shutil.rmtree(self.folder, ignore_errors=True)
        for crate in CRATES:
            # The copies are as old as this run: cargo would take older files for those of its last
            # build.
            source, copy = ROOT / "crates" / crate, self.folder / "crates" / crate
            shutil.copytree(source, copy, copy_function=shutil.copyfile)
        manifest = (ROOT / "Cargo.toml").read_text()
        (self.folder / "Cargo.toml").write_text(
            manifest.replace('debug = "line-tables-only"', "debug = 0")
        )
        shutil.copy(ROOT / "Cargo.lock", self.folder)
        self._insert(numbered)
        self.tests = self._compiled()

    def _insert(self, numbered: dict[int, Mutant]) -> None:
        """Put the mutants into the files."""
        of_files: dict[str, list[tuple[int, Mutant]]] = defaultdict(list)
        for number, mutant in numbered.items():
            of_files[mutant.file].append((number, mutant))
        for file, mutants in of_files.items():
            path = self.folder / file
            crate = "crate" if file.startswith("crates/hprm-core/") else "hprm_core"
            text = with_mutants(path.read_text(), mutants, f"{crate}::mutants::active")
            path.write_text(text)
        core = self.folder / "crates/hprm-core/src/lib.rs"
        core.write_text(core.read_text() + CHOICE)

    def _compiled(self) -> dict[str, Path]:
        """Return where the tests of the simulation are."""
        words = [f"--test={suite}" for suite in (*HUNTS, "relay")]
        command = ["cargo", "test", "--quiet", "-p", "hprm-sim", *words, "--no-run"]
        environment = os.environ | {"CARGO_TARGET_DIR": str(self.target), "CARGO_INCREMENTAL": "0"}
        built = ran([*command, "--message-format=json"], self.folder, environment)
        messages = [json.loads(line) for line in built.stdout.splitlines() if line[:1] == "{"]
        if built.returncode != 0:
            errors = (it.get("message", {}).get("rendered") for it in messages)
            text = "".join(it for it in errors if it and it.startswith("error"))
            raise Unusable(f"with the mutants, the tests do not compile:\n{text or built.stdout}")
        tests = (it for it in messages if it.get("executable"))
        return {it["target"]["name"]: Path(it["executable"]) for it in tests}

    def check(self) -> None:
        """Check that the tests find nothing if no mutant is chosen."""
        for suite in SOUND:
            if found := self._run(0, suite, PATIENCE):
                raise Unusable(f"without a mutant, a test fails: {found}")

    def hunt(self, number: int, mutant: Mutant, hunts: tuple[str, ...]) -> str | None:
        """Return which test finds the mutant, and at which seed or state; None if no test does."""
        found = (self._run(number, *way) for way in ways(mutant, hunts))
        return next(filter(None, found), None)

    def _run(self, number: int, hunt: str, seconds: int) -> str | None:
        """Return the first fault that a test finds with the mutant; None if it finds none."""
        suite, _, test = hunt.partition("::")
        command = [str(self.tests[suite]), "--nocapture", *(["--exact", test] if test else [])]
        environment = os.environ | {"HPRM_MUTANT": str(number), "RUST_BACKTRACE": "0"}
        folder = self.folder / "crates" / "hprm-sim"
        done = ran(command, folder, environment, until=FAULT, seconds=seconds)
        match = FAULT.search(done.stdout)
        if done.returncode == 0 or not (match or seconds == PATIENCE):
            return None
        if not match:
            return f"{hunt}: " + " ".join(done.stdout.split()[-12:])
        seed, wrong, told, states = match.groups()
        found = f"seed {seed}" if seed else f"state {states}"
        return f"{found:<12} {shortened(wrong or told)}"


def ran(
    command: list[str],
    folder: Path,
    environment: dict[str, str],
    until: re.Pattern[str] | None = None,
    seconds: int = PATIENCE,
) -> subprocess.CompletedProcess[str]:
    """Run a command, up to a line that is looked for.

    It may take so many ``seconds`` of a processor.
    """
    with subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=lambda: begin(seconds),
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


def hunted(copy: Copy, numbered: dict[int, Mutant], hunts: tuple[str, ...]) -> list[str | None]:
    """Hunt mutants side by side; return of each what finds it, and None if nothing does."""

    def hunted_one(number: int) -> str | None:
        begun = time.monotonic()
        found = copy.hunt(number, numbered[number], hunts)
        seconds = time.monotonic() - begun
        what = numbered[number].what
        print(f"{what:<68} {seconds:4.0f} s  {found or 'NOT FOUND'}", flush=True)
        return found

    # Those that simulation does not find soon take longest, and begin first.
    order = sorted(numbered, key=lambda number: numbered[number].found_by is None)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        return list(pool.map(hunted_one, order))


def begin(limit: int) -> None:
    """Be a group of processes, each of which may take so many seconds of a processor.

    What it has started ends with it.
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
        numbered = dict(enumerate(map(Mutant.read, paths), 1))
        copy = Copy(options.folder, numbered)
        names = options.names or [it.name for it in numbered.values()]
        chosen = {number: it for number, it in numbered.items() if it.name in names}
        hunts = (options.hunt,) if options.hunt else HUNTS
        copy.check()
        alive = hunted(copy, chosen, hunts).count(None)
    except Unusable as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{len(chosen)} mutants, {alive} not found")
    return 1 if alive or not chosen else 0


if __name__ == "__main__":
    sys.exit(main())
