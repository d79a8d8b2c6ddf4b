"""Real processes in tests: starts them, waits for what they do, checks that none is left."""

from __future__ import annotations

import os
import re
import select
import shutil
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parents[2]

COORDINATIONS = ["centralized", "decentralized"]

DEADLINE_S = 30.0

# What the environment of all processes has that this run of the tests brings about, so that other
# runs on the same machine, and other workers of the same run, do not count.
RUN = f"HPRM_TEST_RUN={uuid.uuid4().hex}"
os.environ.update([RUN.split("=")])


@dataclass
class Outcome:
    """How the command ended, and what it wrote."""

    code: int
    out: str
    err: str

    @property
    def errors(self) -> list[str]:
        """The messages that are errors, of the command or of a federate."""
        return [line for line in self.err.splitlines() if re.match(r"(\[\w+\] )?error", line)]

    def assert_one_error(self, *parts: str) -> None:
        """There is exactly one error, and these are in what was written."""
        assert len(self.errors) == 1, self.err
        for part in parts:
            assert part in self.err, self.err


@dataclass
class Bench:
    """A folder, and the processes that are started in it."""

    folder: Path
    mark: str = field(default_factory=lambda: f"HPRM_TEST_MARK={uuid.uuid4().hex}")
    started: list[subprocess.Popen[str]] = field(default_factory=list)

    def start(self, text: str, *options: str) -> subprocess.Popen[str]:
        """Start ``hprm run`` on the text of a program."""
        main = self.folder / "Main.lf"
        # One that has started before may be about to read it.
        if not main.exists() or main.read_text() != text:
            main.write_text(text)
        return self.call("run", *options, "Main.lf")

    def call(
        self,
        *arguments: str,
        environment: dict[str, str] | None = None,
        limit: str | None = None,
    ) -> subprocess.Popen[str]:
        """Start the command, perhaps within a limit, as ``ulimit`` takes it."""
        command = shutil.which("hprm", path=str(Path(sys.executable).parent))
        assert command is not None, "make build puts hprm beside python"
        before = ["bash", "-c", f'ulimit {limit} && exec "$0" "$@"'] if limit else []
        return self._spawn([*before, command, *arguments], environment or {})

    def python(
        self, *arguments: str, environment: dict[str, str] | None = None
    ) -> subprocess.Popen[str]:
        """Start this interpreter, as ``python -m hprm`` for example."""
        return self._spawn([sys.executable, *arguments], environment or {})

    def _spawn(self, command: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
        """Start a process in a session of its own, as a terminal would."""
        name, value = self.mark.split("=")
        process = subprocess.Popen(
            command,
            cwd=self.folder,
            env=os.environ | {name: value} | environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.started.append(process)
        return process

    def federation(self, address: str | None = None) -> Federation:
        """A federation whose members are to be started by hand."""
        address = address or f"unix:@hprm-test-{uuid.uuid4().hex}"
        return Federation(self, address, uuid.uuid4().hex)

    def by_hand(self, text: str, *federates: str, options: Sequence[str] = ()) -> Federation:
        """Start an RTI for the text of a program, and federates, each as a process of its own."""
        (self.folder / "Main.lf").write_text(text)
        federation = self.federation()
        federation.start("rti", *options)
        for name in federates:
            federation.start(name)
        return federation

    def run(self, text: str, *options: str) -> Outcome:
        """Run the text of a program to its end."""
        return finish(self.start(text, *options))

    def ros_lines(self, text: str, *options: str) -> list[str]:
        """Return the lines that a ROS 2 script prints, which ends well and warns of nothing."""
        (self.folder / "one.py").write_text(text)
        outcome = finish(self.call("ros", "run", *options, "one.py"))
        assert (outcome.code, outcome.err) == (0, "")
        return outcome.out.splitlines()

    def pid(self, name: str) -> int:
        """The process that wrote its number into a file, once it has."""
        file = self.folder / f"{name}.pid"
        until(lambda: file.exists() and file.read_text().endswith("\n"), f"{name} is in the middle")
        return int(file.read_text())

    def left(self) -> set[int]:
        """The processes that this test has brought about and that still run."""
        return {pid for pid in processes() if self.mark in environment(pid)}


@dataclass
class Federation:
    """An RTI, and federates that were started by hand."""

    bench: Bench
    address: str
    id: str
    members: dict[str, subprocess.Popen[str]] = field(default_factory=dict)

    def start(self, name: str, *options: str, limit: str | None = None) -> None:
        """Start the RTI, which is called `rti`, or a federate, which needs it."""
        if name == "rti":
            command = ["rti", "Main.lf", "--listen", self.address, *options]
        else:
            command = ["federate", "Main.lf", name, "--rti", self.address, *options]
        environment = {"HPRM_FEDERATION_ID": self.id}
        member = self.bench.call(*command, environment=environment, limit=limit)
        self.members[name] = member
        if name != "rti":
            return
        if self.address.startswith("unix:"):
            until(lambda: listens(self.address), "the RTI listens")
        else:
            # The port may have been zero.
            self.address = hear(member.stdout, "\n").splitlines()[0].split()[-1]

    def await_joined(self, *names: str) -> None:
        """Wait until the RTI says that these have joined."""
        heard = ""
        while not all(f"federate {name} joined\n" in heard for name in names):
            heard += hear(self.members["rti"].stdout, "\n")

    def finish(self, *names: str) -> dict[str, Outcome]:
        """Return how the members end: those that are named, or all."""
        return {name: finish(self.members[name]) for name in names or self.members}


def call(
    *words: str | Path,
    cwd: Path,
    code: int = 0,
    environment: dict[str, str] | None = None,
    timeout: float = 900,
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, which must have this exit code."""
    outcome = subprocess.run(
        words,
        cwd=cwd,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert outcome.returncode == code, outcome.stdout + outcome.stderr
    return outcome


@cache
def rust_examples() -> Path:
    """Where the examples in Rust are, which are built together, once."""
    # As `make test` builds them: other packages would mean other features, and another build.
    packages = ["--workspace", "--features", "hprm-cli/whole"]
    built = ["cargo", "build", "--quiet", "--offline", *packages, "--examples"]
    subprocess.run(built, cwd=ROOT, check=True, timeout=600)
    return Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "debug" / "examples"


def listens(address: str) -> bool:
    """Return whether a process listens at an abstract address, unix:@NAME."""
    name = address.removeprefix("unix:")
    sockets = Path("/proc/net/unix").read_text().splitlines()
    return any(line.split()[-1] == name for line in sockets)


def names_in_shared_memory() -> set[str]:
    """What has a name there, but for files of Zenoh, which other tests may run at the same time."""
    return {name for name in os.listdir("/dev/shm") if not name.endswith(".zenoh")}


#: Signals that come within 0.1 s of one another count as one, and a process that the system
#: does not run for a moment sees the first one late.
ANOTHER_SIGNAL_S = 1.0


def finish(process: subprocess.Popen[str]) -> Outcome:
    """How a process ends."""
    out, err = process.communicate(timeout=DEADLINE_S)
    return Outcome(process.returncode, out, err)


def hear(stream: IO[str] | None, text: str) -> str:
    """Read what a process writes until this is in it, and return what has been read."""
    assert stream is not None, "both streams are pipes"
    heard = ""
    deadline = time.monotonic() + DEADLINE_S
    while text not in heard:
        ready, _, _ = select.select([stream], [], [], max(deadline - time.monotonic(), 0))
        # Past the text object, whose buffer `communicate` would not look at.
        chunk = os.read(stream.fileno(), 4096) if ready else b""
        assert chunk != b"", f"waited in vain for {text!r} after {heard!r}"
        heard += chunk.decode()
    return heard


def hear_number(stream: IO[str] | None) -> int:
    """Read what a process writes, and return the number at the end of its last whole line.

    A pipe may give the first half of a line.
    """
    return int(hear(stream, "\n").rpartition("\n")[0].split()[-1])


def until(condition: Callable[[], bool], what: str) -> None:
    """Wait until a condition holds, and fail if it never does.

    Some conditions read much of ``/proc``: the longer one waits, the less often it looks.
    """
    begun = time.monotonic()
    while not condition():
        waited = time.monotonic() - begun
        assert waited < DEADLINE_S, f"waited in vain until {what}"
        time.sleep(min(0.003 + waited / 10, 0.05))


def processes() -> list[int]:
    """All processes of this machine, but for this one."""
    return [int(p.name) for p in Path("/proc").iterdir() if p.name.isdigit() if p.name != _SELF]


_SELF = str(os.getpid())


def environment(pid: int) -> set[str]:
    """The environment of a process; empty once it has ended, even if it is a zombie."""
    try:
        text = Path(f"/proc/{pid}/environ").read_bytes()
    except OSError:
        return set()
    return set(text.decode(errors="replace").split("\0"))


def stores() -> set[int]:
    """The processes of this run that hold or map memory of an object store."""
    return {pid for pid in processes() if RUN in environment(pid) and _holds_store(pid)}


def _holds_store(pid: int) -> bool:
    try:
        if "memfd:hprm" in Path(f"/proc/{pid}/maps").read_text(errors="replace"):
            return True
        links = [os.readlink(fd) for fd in Path(f"/proc/{pid}/fd").iterdir()]
    except OSError:
        return False
    return any("memfd:hprm" in link for link in links)
