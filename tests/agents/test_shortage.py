"""An agent that can open no more files waits until it can again, and does nothing meanwhile."""

from __future__ import annotations

import contextlib
import hashlib
import os
import resource
import signal
import socket
import threading
from pathlib import Path

from machines import Machines, finish, until

#: How many more files the agent may open.
LEFT = 12


def descriptors(pid: int) -> list[int]:
    """What a process has open."""
    return [int(path.name) for path in Path(f"/proc/{pid}/fd").iterdir()]


def processor_time(pid: int) -> float:
    """For how many seconds a process has used a processor."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def shipping_name(agent: str) -> str:
    """Where the agent takes large values; as `socket_name` in `crates/hprm/src/shipping.rs`."""
    digest = hashlib.sha256(f"unix:@{agent}\0{os.geteuid()}".encode()).digest()
    return f"hprm-shipping-{digest[:16].hex()}"


def registered(agent: str, number: int) -> socket.socket | None:
    """A listener that is registered with an agent; none if it does not answer."""
    stream = socket.socket(socket.AF_UNIX)
    stream.settimeout(2)
    stream.connect("\0" + agent)
    stream.sendall(f"hprm-agent-1 listen ./listener-{number}\n".encode())
    with contextlib.suppress(TimeoutError):
        assert stream.recv(100) == b"done robot1\n"
        return stream
    stream.close()
    return None


def test_the_last_descriptor_is_for_a_connection_that_says_later_what_it_wants(
    machines: Machines,
) -> None:
    machines.start_agent("robot1", "--listen", "127.0.0.1:0")
    agent = machines.agents["robot1"]
    used = descriptors(agent.pid)
    limit = next(number for number in range(len(used) + 1) if number not in used) + 1
    resource.prlimit(agent.pid, resource.RLIMIT_NOFILE, (limit, limit))
    stream = socket.socket(socket.AF_UNIX)
    machines.sockets.append(stream)
    stream.settimeout(10)
    stream.connect("\0" + machines.address("robot1"))
    until(lambda: limit - 1 in descriptors(agent.pid))
    threading.Event().wait(0.2)
    stream.sendall(b"hprm-agent-1 listen ./late\n")
    assert stream.recv(100) == b"done robot1\n"
    agent.terminate()
    assert finish(agent)[::2] == (0, "")


def test_an_agent_without_descriptors_rests_and_accepts_again_later(machines: Machines) -> None:
    machines.start_agent("robot1", "--listen", "127.0.0.1:0")
    agent, name = machines.agents["robot1"], machines.address("robot1")
    limit = max(descriptors(agent.pid)) + 1 + LEFT
    resource.prlimit(agent.pid, resource.RLIMIT_NOFILE, (limit, limit))
    listeners = []
    while one := registered(name, len(listeners)):
        listeners.append(one)
        machines.sockets.append(one)
    # Others may have closed some meanwhile.
    assert len(listeners) >= LEFT - 2
    # A connection waits at each of its sockets.
    machines.sockets += [socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)]
    machines.sockets[-1].connect("\0" + shipping_name(name))
    machines.sockets += [socket.socket(socket.AF_UNIX)]
    machines.sockets[-1].connect("\0" + name)
    assert len(descriptors(agent.pid)) >= limit - 1
    before = processor_time(agent.pid)
    threading.Event().wait(1)
    assert processor_time(agent.pid) - before < 0.3
    for one in listeners:
        one.close()
    assert machines.machines("robot1") == ["robot1"]
    agent.send_signal(signal.SIGINT)
    _, err = agent.communicate(timeout=30)
    assert err == (
        "warning: the agent can open no more files, so new connections wait until others end\n"
        "  hint: let a process open more files: ulimit -n 1024\n"
    )


def test_idle_connections_do_not_keep_others_from_an_agent_without_descriptors(
    machines: Machines,
) -> None:
    machines.start_agent("robot1", "--listen", "127.0.0.1:0")
    agent, name = machines.agents["robot1"], machines.address("robot1")
    limit = max(descriptors(agent.pid)) + 1 + LEFT
    resource.prlimit(agent.pid, resource.RLIMIT_NOFILE, (limit, limit))
    for _ in range(3 * LEFT):
        machines.sockets.append(socket.socket(socket.AF_UNIX))
        machines.sockets[-1].connect("\0" + name)
    assert machines.machines("robot1") == ["robot1"]
