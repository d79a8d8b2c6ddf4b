"""The memory of agents, for each link that they lead: `make bench-fleet`.

Two agents lead up to a thousand links, each of which has carried a message both ways; once
directly, and once through a router. Printed is by how much the memory of each agent has grown.
"""

from __future__ import annotations

import array
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ports import free_ports

ROOT = Path(__file__).resolve().parents[1]
AGENT = ROOT / "out" / "agent" / "release" / "hprm-agent"
LINKS = [100, 1000]
MESSAGE = b"x" * 1024


def main() -> None:
    """Measures without a router, and through one."""
    if not AGENT.exists():
        sys.exit(f"error: {AGENT} is missing\n  hint: make agent")
    print("                      links   KiB a link, at the agent of")
    for through in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            measure(through, Path(folder))


def measure(through: bool, folder: Path) -> None:
    """Opens more and more links between two agents."""
    names = ["here", "there", *(["hub"] if through else [])]
    ports = dict(zip(names, free_ports(len(names)), strict=True))
    target = "hub" if through else "here"
    agents = {}
    try:
        for name in reversed(names):
            only = ["--connect-only"] if through else []
            connect = ["--connect", f"127.0.0.1:{ports[target]}", *only]
            options = ["--router"] if name == "hub" else connect if name != target else []
            agents[name] = start(name, ports[name], folder, options)
        report(through, agents)
    finally:
        for agent in agents.values():
            agent.kill()
            agent.wait()


def start(name: str, port: int, folder: Path, options: list[str]) -> subprocess.Popen[str]:
    """An agent that listens."""
    agent = subprocess.Popen(
        [AGENT, "--name", name, "--listen", f"127.0.0.1:{port}", *options],
        env=os.environ | {"HPRM_AGENT": f"unix:@{address(name)}", "XDG_CONFIG_HOME": str(folder)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert agent.stdout is not None
    assert agent.stdout.readline().startswith("the agent of")
    return agent


def report(through: bool, agents: dict[str, subprocess.Popen[str]]) -> None:
    """Opens links, and prints what that takes."""
    listener = say("there", "listen ./sink")
    ends: list[socket.socket] = []
    open_links(ends, listener, 1)
    before = {name: memory(agent) for name, agent in agents.items()}
    for count in LINKS:
        open_links(ends, listener, count + 1 - len(ends) // 2)
        grown = {name: memory(agent) - before[name] for name, agent in agents.items()}
        shown = ", ".join(f"{name} {size / count:.1f}" for name, size in grown.items())
        print(f"{'through a router' if through else 'directly':<20} {count:>6}   {shown}")
    for end in ends:
        end.close()


def open_links(ends: list[socket.socket], listener: socket.socket, count: int) -> None:
    """Opens links, and has a message go each way."""
    for _ in range(count):
        here = say("here", "connect there/sink", patience=10)
        there = received(listener)
        for one, other in [(here, there), (there, here)]:
            one.sendall(MESSAGE)
            got = b""
            while len(got) < len(MESSAGE):
                got += other.recv(len(MESSAGE))
        ends += [here, there]


def say(agent: str, words: str, patience: float = 0) -> socket.socket:
    """Asks an agent for something, again and again if it is not there yet."""
    deadline = time.monotonic() + patience
    while True:
        connection = socket.socket(socket.AF_UNIX)
        connection.connect("\0" + address(agent))
        connection.sendall(f"hprm-agent-1 {words}\n".encode())
        answer = b""
        while not answer.endswith(b"\n"):
            answer += connection.recv(1)
        if answer.startswith(b"done "):
            return connection
        connection.close()
        assert time.monotonic() < deadline, answer
        time.sleep(0.05)


def received(listener: socket.socket) -> socket.socket:
    """The connection that an agent hands over next."""
    _, control, _, _ = listener.recvmsg(1, socket.CMSG_SPACE(4))
    ((_, _, data),) = control
    (descriptor,) = array.array("i", data)
    connection = socket.socket(fileno=descriptor)
    connection.setblocking(True)
    return connection


def address(name: str) -> str:
    """The Unix socket of an agent."""
    return f"hprm-bench-{os.getpid()}-{name}"


def memory(agent: subprocess.Popen[str]) -> float:
    """The memory of a process, in KiB."""
    status = Path(f"/proc/{agent.pid}/status").read_text()
    (kilobytes,) = re.findall(r"VmRSS:\s+(\d+) kB", status)
    return float(kilobytes)


if __name__ == "__main__":
    main()
