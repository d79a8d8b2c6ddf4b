"""Machines for tests: agents on ports of this machine, and a proxy that cuts connections."""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh
from tcp_ports import free_ports

ROOT = Path(__file__).resolve().parents[2]
AGENT = os.environ.get("HPRM_AGENT_PROGRAM", str(ROOT / "out" / "agent" / "release" / "hprm-agent"))
HPRM = str(Path(sys.executable).with_name("hprm"))

PROGRAM = """\
target Python { timeout: 200 msec }
preamble {=
import numpy as np
=}
reactor Source {
  input[2] answers
  output out
  timer t(0, 20 msec)
  state count = 0
  state received = []
  reaction(t) -> out {=
    self.count += 1
    out.set(np.full(20_000, self.count))
    if self.count == 5: print("running", flush=True)
  =}
  reaction(answers) {=
    for answer in answers:
        if answer.is_present:
            self.received.append(answer.value)
  =}
  reaction(shutdown) {= print(len(self.received), sum(self.received)) =}
}
reactor Sink(bank_index = 0) {
  input inp
  output answer
  reaction(inp) -> answer {= answer.set(int(inp.value[-1]) * 10 + self.bank_index) =}
}
federated reactor {
  source = new Source()
  sink = new[2] Sink()
  (source.out)+ -> sink.inp
  sink.answer -> source.answers after 30 msec
}
"""

#: On which machine the federates of PROGRAM run.
PLACES = {"source": "robot1", "sink__0": "robot2", "sink__1": "robot2"}

#: What a federate says that is late, as it is while the link is broken.
LAGS = re.compile(r"(\[\w+\] )?warning: federate \w+ lags .*\n(\[\w+\] )?  hint: .*\n")

#: How many times connections are cut at random; more of them on demand.
CUTS = int(os.environ.get("HPRM_TEST_CUTS", "3"))


def until(holds: Callable[[], bool], within: float = 60) -> None:
    """Waits until a condition holds."""
    deadline = time.monotonic() + within
    while not holds():
        assert time.monotonic() < deadline, "it did not come to hold in time"


def listens_at(agent: subprocess.Popen[str]) -> str:
    """Where an agent listens that was started with one address."""
    words = agent.args
    assert isinstance(words, tuple)
    return str(words[words.index("--listen") + 1])


@dataclass
class Machines:
    """Two machines, each with an agent, in a folder that their processes share."""

    folder: Path
    proxy: Proxy | None = None
    started: list[subprocess.Popen[str]] = field(default_factory=list)
    agents: dict[str, subprocess.Popen[str]] = field(default_factory=dict)
    authority: str = "robot1"
    sockets: list[socket.socket] = field(default_factory=list)
    #: What processes find in their environment besides.
    environment: dict[str, str] = field(default_factory=dict)

    def spawn(
        self, machine: str, *command: str, stdin: int = subprocess.DEVNULL
    ) -> subprocess.Popen[str]:
        """Starts a command on a machine."""
        address = f"unix:@{self.address(machine)}"
        process = subprocess.Popen(
            self.entered(machine, command),
            cwd=self.folder,
            env=os.environ
            | self.environment
            | {
                "HPRM_AGENT": address,
                "XDG_CACHE_HOME": str(self.folder / f"cache-{machine}"),
                "XDG_CONFIG_HOME": str(self.folder / f"config-{machine}"),
                # Where the agent finds the command.
                "PATH": f"{Path(HPRM).parent}:{os.environ['PATH']}",
            },
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.started.append(process)
        return process

    def entered(self, machine: str, command: Sequence[str]) -> tuple[str, ...]:
        """A command line that runs on a machine; here, all machines are this one."""
        del machine
        return tuple(command)

    def start_agents(self, *options: str, through: bool = False) -> None:
        """Starts both agents; with `through`, connections between them lead through a proxy."""
        here, there = free_ports(2)
        target = here
        if through:
            self.proxy = Proxy(here)
            target = self.proxy.port
        self.start_agent("robot1", "--listen", f"127.0.0.1:{here}", *options)
        connect = ["--connect", f"127.0.0.1:{target}"]
        self.start_agent("robot2", "--listen", f"127.0.0.1:{there}", *connect, *options)
        while self.machines("robot2") != ["robot2", "robot1"]:
            pass
        while self.machines("robot1") != ["robot1", "robot2"]:
            pass

    def start_agent(self, machine: str, *options: str) -> None:
        """Starts an agent, and waits until it listens."""
        agent = self.spawn(machine, AGENT, "--name", machine, *options)
        assert agent.stdout is not None
        assert agent.stdout.readline().startswith(f"the agent of {machine} listens at")
        self.agents[machine] = agent

    def make_authority(self, machine: str, *options: str) -> None:
        """Makes a machine's user the authority, and enrols the machine."""
        words = ["authority", "--name", machine, *options]
        code, _, err = finish(self.spawn(machine, AGENT, *words))
        assert (code, err) == (0, "")
        self.authority = machine

    def invite(self, machine: str, *options: str) -> tuple[subprocess.Popen[str], str, str]:
        """Invites a machine. Returns the process that waits, where it listens, and the code."""
        listen = ["--listen", "127.0.0.1:0"]
        host = self.spawn(self.authority, AGENT, "invite", machine, *listen, *options)
        assert host.stdout is not None
        first, second, _ = (host.stdout.readline() for _ in range(3))
        return host, first.split()[-1], second.removeprefix("code: ").strip()

    def begin_to_join(self, machine: str, place: str, code: str) -> subprocess.Popen[str]:
        """A machine enrols where another one listens, with a code."""
        words = ["enroll", "--name", machine, "--authority", place]
        joining = self.spawn(machine, AGENT, *words, stdin=subprocess.PIPE)
        assert joining.stdin is not None
        joining.stdin.write(f"{code}\n")
        joining.stdin.close()
        # Or it would be written to once more.
        joining.stdin = None
        return joining

    def join(self, machine: str, place: str, code: str) -> tuple[int, str, str]:
        """The same, to its end."""
        return finish(self.begin_to_join(machine, place, code))

    def enroll(self, machine: str, *options: str) -> tuple[int, str, str]:
        """Invites a machine, which enrols. Returns how that ends: its code, errors and output."""
        host, place, code = self.invite(machine, *options)
        status, out, err = self.join(machine, place, code)
        assert finish(host) == (0, f"{machine} is enrolled\n", "")
        return status, err, out

    def enrolled_text(self, machine: str) -> str:
        """What a machine says that was enrolled."""
        folder = self.credentials(machine)
        return f"this machine is {machine}, and has its credentials in {folder}\n"

    def credentials(self, machine: str) -> Path:
        """Where a machine has what its authority has given it."""
        return self.folder / f"config-{machine}" / "hprm" / "agent"

    def tls(self, machine: str) -> dict[str, Any]:
        """How sessions of Zenoh use the certificate of a machine."""
        files = self.credentials(machine)
        certificate, key = str(files / "machine.pem"), str(files / "machine.key")
        return {
            "root_ca_certificate": str(files / "authority.pem"),
            "connect_certificate": certificate,
            "connect_private_key": key,
            "listen_certificate": certificate,
            "listen_private_key": key,
            "enable_mtls": True,
            "verify_name_on_connect": False,
        }

    def spy(self, machine: str, connect: str) -> zenoh.Session:
        """A session of Zenoh with the certificate of a machine, which obeys no rule."""
        config = zenoh.Config.from_json5(
            json.dumps(
                {
                    "mode": "peer",
                    "connect": {"endpoints": [f"tls/{connect}"]},
                    "listen": {"endpoints": []},
                    "scouting": {"multicast": {"enabled": False}},
                    "transport": {"link": {"tls": self.tls(machine)}},
                }
            )
        )
        return zenoh.open(config)

    def stand_still(self, machine: str, seconds: float) -> None:
        """Stops the agent of a machine for a while."""
        agent = self.agents[machine]
        os.kill(agent.pid, signal.SIGSTOP)
        threading.Event().wait(seconds)
        os.kill(agent.pid, signal.SIGCONT)

    def cut_until_ended(self, process: subprocess.Popen[str], seed: int) -> int:
        """Cuts connections again and again until a process has ended. Returns how often."""
        assert self.proxy is not None
        stop, proxy, cuts = threading.Event(), self.proxy, list[int]()
        cutter = threading.Thread(target=lambda: cuts.append(proxy.cut_at_random(seed, stop)))
        cutter.start()
        try:
            process.wait(90)
        finally:
            stop.set()
            cutter.join()
        return cuts[0]

    def wait_for(self, machine: str, expected: list[str]) -> None:
        """Waits until an agent knows of these machines, its own first."""
        until(lambda: self.machines(machine) == expected)

    def machines(self, machine: str) -> list[str]:
        """The names of the machines of which an agent knows, its own first."""
        told = self.tell_machines(machine)
        assert [one["is_here"] for one in told] == [True] + [False] * (len(told) - 1)
        return [one["name"] for one in told]

    def tell_machines(self, machine: str) -> list[dict[str, Any]]:
        """What an agent knows of all machines."""
        asked = self.spawn(machine, HPRM, "machines", "--json")
        out, err = asked.communicate(timeout=30)
        assert (asked.returncode, err) == (0, "")
        told: list[dict[str, Any]] = json.loads(out)["machines"]
        return told

    def federation(
        self, program: str, places: dict[str, str], *options: str
    ) -> tuple[subprocess.Popen[str], list[subprocess.Popen[str]]]:
        """Starts the RTI of a program on the first machine, and its federates where they belong."""
        (self.folder / "Fed.lf").write_text(program)
        common = ["--federation-file", "secret", *options]
        rti = self.spawn("robot1", HPRM, "rti", "Fed.lf", "--listen", "agent:robot1/rti", *common)
        assert rti.stdout is not None
        address = rti.stdout.readline().split()[-1]
        federates = []
        for name, machine in places.items():
            joining = ["--rti", address, "--logical-trace", name, *common]
            federates.append(self.spawn(machine, HPRM, "federate", "Fed.lf", name, *joining))
        return rti, federates

    def address(self, machine: str) -> str:
        """The name of the Unix socket of a machine's agent."""
        return f"hprm-test-{os.getpid()}-{self.folder.name}-{machine}"

    def close(self) -> None:
        """Leaves nothing behind."""
        for connection in self.sockets:
            connection.close()
        for process in self.started:
            process.kill()
            process.communicate()
        if self.proxy:
            self.proxy.close()


class Proxy:
    """Leads TCP connections to a port of this machine, until it cuts them."""

    def __init__(self, target: int) -> None:
        self.target = target
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.pairs: list[socket.socket] = []
        self.lock = threading.Lock()
        self.is_cut = False
        #: How many bytes have come through, in both directions.
        self.carried = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            try:
                server = socket.create_connection(("127.0.0.1", self.target))
            except OSError:
                client.close()
                continue
            with self.lock:
                if self.is_cut:
                    client.close()
                    server.close()
                    continue
                self.pairs += [client, server]
            for ends in [(client, server), (server, client)]:
                threading.Thread(target=self._lead, args=ends, daemon=True).start()

    def _lead(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(1 << 16):
                with self.lock:
                    self.carried += len(data)
                sink.sendall(data)
        except OSError:
            pass
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def cut(self) -> None:
        """Ends all connections, and every new one at once."""
        with self.lock:
            self.is_cut = True
            for end in self.pairs:
                # A reset: what was on its way is lost.
                linger = (1).to_bytes(4, sys.byteorder) + (0).to_bytes(4, sys.byteorder)
                try:
                    end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
                    end.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass
                end.close()
            self.pairs.clear()

    def mend(self) -> None:
        """Leads connections again."""
        with self.lock:
            self.is_cut = False

    def cut_at_random(self, seed: int, stop: threading.Event) -> int:
        """Cuts the connections again and again, for a moment each. Returns how often."""
        rng = random.Random(seed)
        cuts = 0
        while not stop.wait(rng.uniform(0.05, 1.5)):
            self.cut()
            cuts += 1
            stop.wait(rng.uniform(0, 1))
            self.mend()
        return cuts

    def close(self) -> None:
        """Ends all of it."""
        self.cut()
        self.listener.close()


def reactions(paths: Iterable[Path]) -> list[dict[str, object]]:
    """What reactions did, by tag and name."""
    lines = [json.loads(line) for path in paths for line in path.read_text().splitlines()]
    return sorted(
        (line for line in lines if "reaction" in line),
        key=lambda line: (line["tag"], line["reaction"]),
    )


def alone(folder: Path, program: str) -> tuple[str, list[dict[str, object]]]:
    """What a program prints and does in one process."""
    (folder / "alone").mkdir(exist_ok=True)
    alone = program.replace("federated reactor", "main reactor")
    assert alone != program
    (folder / "alone" / "Fed.lf").write_text(alone)
    command = [HPRM, "run", "--logical-trace", "trace", "Fed.lf"]
    done = subprocess.run(command, cwd=folder / "alone", capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout, reactions([folder / "alone" / "trace"])


def finish(process: subprocess.Popen[str], read: str = "") -> tuple[int, str, str]:
    """How a process ends, and what it writes; without what it says of what is late."""
    out, err = process.communicate(timeout=90)
    return process.returncode, read + out, LAGS.sub("", err)
