"""Starts the processes of a session, waits for its results, and leaves nothing behind.

Whatever happens, every process that a session has started, and what those have started, has ended
when `Launcher.run` returns, and the session's files are gone, those in /dev/shm too. Ends are by
process id: orphans become children of the harness, which asks the kernel for that.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import descendants
import environments
import plan as planning
from contenders import Contender

HERE = Path(__file__).resolve().parent
WORKER = HERE / "worker"
PROGRAMS = HERE / "programs"
SHARED_MEMORY = Path("/dev/shm")
_VARIABLE = "HPRM_BENCH_SESSION"
_GRACE_S = 3.0
_LOOK_EVERY_S = 0.01
_PLASMA_BYTES = 4_000_000_000

Cell = dict[str, Any]
Result = dict[str, Any]


class Failed(Exception):
    """A session did not end well. What it had measured until then is in ``results``."""

    def __init__(self, reason: str, results: list[Result]) -> None:
        """Says why."""
        super().__init__(reason)
        self.results = results


@dataclass(frozen=True)
class Command:
    """A process to start."""

    words: list[str]
    awaited: bool = True
    """Whether the session lasts until it has ended."""


def sessions_of(contender: Contender, cells: list[Cell]) -> list[list[Cell]]:
    """Which cells are measured in one session.

    W6 has one of its own: the longest message of a session decides how much memory contenders
    reserve, and how long their queues are, so that it would change what W2 measures. W5 has its own
    programs in HPRM.
    """
    alone = ("W5", "W6") if contender.ours else ("W6",)
    parts: dict[str, list[Cell]] = {}
    for cell in cells:
        workload = cell["workload"]
        parts.setdefault(workload if workload in alone else "", []).append(cell)
    return list(parts.values())


class Launcher:
    """Runs sessions, one at a time."""

    def __init__(self, hprm: Path, limit_s: float) -> None:
        """`hprm` is the command of the package that is measured."""
        self._command = hprm
        self._limit_s = limit_s
        self._count = 0
        descendants.adopt_orphans()

    def run(self, contender: Contender, group: str, cells: list[Cell]) -> list[Result]:
        """The sessions of a contender in a group; the results of its cells.

        Raises:
            Failed: a process ended with an error, or the session took too long.

        """
        results: list[Result] = []
        for part in sessions_of(contender, cells):
            try:
                results += self._session(contender, group, part)
            except Failed as failure:
                raise Failed(str(failure), results + failure.results) from None
        return results

    def _session(self, contender: Contender, group: str, cells: list[Cell]) -> list[Result]:
        self._count += 1
        name = f"hprmbench-{os.getpid()}-{self._count}"
        directory = Path(tempfile.mkdtemp(prefix="hb-"))
        session = self._describe(name, directory, contender, group, cells)
        environment = self._environment(contender, session)
        build = getattr(self, f"_{contender.kind}")
        running: list[tuple[Command, subprocess.Popen[bytes]]] = []
        log = directory / "log"
        before = {path.name for path in SHARED_MEMORY.iterdir()}
        grace_s = 0.0
        try:
            with log.open("wb") as output:
                with _affinity(planning.CPUS.get(group, ())):
                    for command in build(contender, session):
                        running.append((command, _start(command, environment, output)))
                reason = self._wait(running)
            results = _results(session)
            if reason is None and contender.ours:
                results += _rates(directory, cells)
            if reason is not None:
                raise Failed(f"{reason}{_last_line(log)}", results)
            grace_s = _GRACE_S
            return results
        finally:
            with undisturbed():
                for command, process in running:
                    if not command.awaited:
                        process.terminate()
                descendants.end_all(grace_s)
                _remove_segments(name, before)
                shutil.rmtree(directory, ignore_errors=True)

    def _describe(
        self,
        name: str,
        directory: Path,
        contender: Contender,
        group: str,
        cells: list[Cell],
    ) -> dict[str, Any]:
        usable = sorted(os.sched_getaffinity(0))
        cpus = [usable[place] for place in planning.CPUS.get(group, ())]
        return {
            "name": name,
            "transport": contender.transport,
            "nodes": planning.NODES.get(group, 0),
            "directory": str(directory),
            "out": str(directory / "results"),
            "plan": cells,
            "largest": max(int(cell["size"]) for cell in cells),
            "hub_cpu": cpus[0] if cpus else None,
            "node_cpu": cpus[1] if cpus else None,
            "options": contender.options | {"domain": self._count % 100},
        }

    def _environment(self, contender: Contender, session: dict[str, Any]) -> dict[str, str]:
        kept = {key: value for key, value in os.environ.items() if key != "VIRTUAL_ENV"}
        ours = {_VARIABLE: json.dumps(session), "PYTHONUNBUFFERED": "1", "RUST_LOG": "error"}
        return kept | ours | contender.variables

    def _wait(self, running: Sequence[tuple[Command, subprocess.Popen[bytes]]]) -> str | None:
        """Waits until all have ended that are to end; why the session failed, if it did."""
        deadline = time.monotonic() + self._limit_s
        while True:
            ended = [(command, process.poll()) for command, process in running]
            for command, code in ended:
                if code not in (None, 0) or (code == 0 and not command.awaited):
                    return f"a process ended with exit code {code}"
            if all(code == 0 for command, code in ended if command.awaited):
                return None
            if time.monotonic() > deadline:
                return f"not ready after {self._limit_s:.0f} s"
            time.sleep(_LOOK_EVERY_S)

    # How the processes of each kind of contender are started.

    def _processes(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        python = str(environments.python_of(contender.environment))
        roles = [["hub"], *(["node", str(index)] for index in range(session["nodes"]))]
        return [Command([python, str(WORKER / "main.py"), *role]) for role in roles]

    def _plasma(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        store = environments.python_of("plasma").parent / "plasma_store"
        socket = str(Path(session["directory"]) / "plasma")
        words = [str(store), "-m", str(_PLASMA_BYTES), "-s", socket]
        rest = self._processes if session["nodes"] else self._alone
        return [Command(words, awaited=False), *rest(contender, session)]

    def _ray(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        return self._processes(contender, session | {"nodes": 0})

    def _alone(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        python = str(environments.python_of(contender.environment))
        role = "place" if session["plan"][0]["workload"] == "W3" else "encode"
        return [Command([python, str(WORKER / "alone.py"), role])]

    def _dora(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        description = Path(session["directory"]) / "dataflow.yml"
        description.write_text(json.dumps(_dataflow(session)))  # JSON is YAML
        dora = environments.python_of("dora").parent / "dora"
        return [Command([str(dora), "run", str(description)])]

    def _hprm(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        coordination = contender.options.get("coordination", "decentralized")
        words = [str(self._command), "run", *contender.arguments]
        if session["plan"][0]["workload"] == "W3":
            program = "Place.lf"
        elif session["plan"][0]["workload"] == "W5":
            words += ["--property", f"coordination={coordination}"]
            program = f"Rate{session['nodes']}.lf"
        else:
            shape = "Gather" if session["nodes"] > 1 else "Pair"
            program = f"{shape}{coordination.capitalize()}.lf"
        return [Command([*words, str(PROGRAMS / program)])]


def _dataflow(session: dict[str, Any]) -> dict[str, Any]:
    """The nodes of dora's dataflow: a hub and those that answer it, with long queues."""
    python = str(environments.python_of("dora"))
    names = [f"node{index}" for index in range(session["nodes"])]

    def node(name: str, role: str, sources: list[str]) -> dict[str, Any]:
        inputs = {source: {"source": f"{source}/data", "queue_size": 50_000} for source in sources}
        arguments = f"{WORKER / 'main.py'} {role}"
        return {
            "id": name,
            "path": python,
            "args": arguments,
            "inputs": inputs,
            "outputs": ["data"],
        }

    hub = node("hub", "hub", names)
    return {"nodes": [hub, *(node(name, f"node {name[4:]}", ["hub"]) for name in names)]}


@contextmanager
def _affinity(cpus: Sequence[int]) -> Iterator[None]:
    """What is started meanwhile stays on one processor, if only one is to be used.

    Otherwise hub and node pin themselves, and daemons are free.
    """
    before = os.sched_getaffinity(0)
    if len(set(cpus)) == 1:
        os.sched_setaffinity(0, {sorted(before)[cpus[0]]})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Requests to end wait meanwhile, and are one afterwards: impatient users ask again."""
    requests = {signal.SIGINT, signal.SIGTERM}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, requests)
    asked = False
    try:
        yield
    finally:
        while signal.sigtimedwait(requests, 0) is not None:
            asked = True
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if asked:
            raise KeyboardInterrupt


def _start(command: Command, environment: dict[str, str], output: Any) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        command.words,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )


def _results(session: dict[str, Any]) -> list[Result]:
    """What the hub has written; a line that it could not finish does not count."""
    try:
        lines = Path(session["out"]).read_text().split("\n")
    except FileNotFoundError:
        return []
    return [json.loads(line) for line in lines[:-1]]


def _rates(directory: Path, cells: list[Cell]) -> list[Result]:
    """What the source and the sinks of HPRM's programs wrote down, as a hub would have said it."""
    if not (directory / "source").exists():
        return []
    source = json.loads((directory / "source").read_text())
    sinks = [json.loads(path.read_text()) for path in sorted(directory.glob("sink-*"))]
    ended = max(sink["ended_ns"] for sink in sinks)
    return [
        {
            "workload": "W5",
            "size": cells[0]["size"],
            "sent": source["sent"],
            "received": [sink["received"] for sink in sinks],
            "seconds": (ended - source["started_ns"]) / 1e9,
        }
    ]


def _last_line(log: Path) -> str:
    """What the processes said that tells most: an error that stands in one line, or the end."""
    lines = log.read_text(errors="replace").splitlines()
    said = [line.strip() for line in lines if line.strip()]
    errors = [line for line in said if line.startswith("error:")]
    traced = any(line.startswith("Traceback") for line in said)
    chosen = (said if traced or not errors else errors)[-1:]
    return f": {chosen[0][:200]}" if chosen else ""


def _remove_segments(name: str, before: set[str]) -> None:
    """Removes from /dev/shm what a session has left there.

    That is what it named after itself, and what zenoh names by number, if it was not there before
    and nobody has it mapped.
    """
    for path in SHARED_MEMORY.glob(f"*{name}*"):
        path.unlink(missing_ok=True)
    left = [path for path in SHARED_MEMORY.glob("*.zenoh") if path.name not in before]
    if left:
        mapped = "".join(_maps(process) for process in Path("/proc").glob("[0-9]*"))
        for path in left:
            if f"{path}\n" not in mapped:
                path.unlink(missing_ok=True)


def _maps(process: Path) -> str:
    try:
        return (process / "maps").read_text()
    except OSError:  # it has ended, or it is another user's
        return ""
