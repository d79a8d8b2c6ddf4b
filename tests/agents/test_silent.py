"""An agent whose peer has fallen silent with much on its way to it."""

from __future__ import annotations

import array
import contextlib
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from machines import HPRM, Machines, finish, listens_at, until
from tcp_ports import free_ports

#: Links that much is written to.
FLOODS = 6


def test_a_silent_machine_holds_up_no_other_one_and_no_local_process(machines: Machines) -> None:
    three(machines)
    there = [connected(machines, "robot2") for _ in range(FLOODS)]
    here, far = connected(machines, "robot3")
    with flooded(there):
        machines.agents["robot2"].send_signal(signal.SIGSTOP)
        (shown,) = (it for it in machines.tell_machines("robot1") if it["name"] == "robot2")
        assert shown["about"] is None
        longest = {"link": 0.0, "local": 0.0}
        # Zenoh takes the machine for gone after ten seconds, and closes the connection.
        end = time.monotonic() + 16
        while time.monotonic() < end:
            began = time.monotonic()
            here.sendall(b"ping")
            far.sendall(far.recv(4))
            assert here.recv(4) == b"ping"
            longest["link"] = max(longest["link"], time.monotonic() - began)
            began = time.monotonic()
            ask(machines, "robot1", "route robot3").close()
            longest["local"] = max(longest["local"], time.monotonic() - began)
            time.sleep(0.02)
        assert max(longest.values()) < 5, longest
        assert "robot2" not in machines.machines("robot1")
        machines.agents["robot2"].send_signal(signal.SIGCONT)


def test_an_agent_ends_soon_while_a_machine_is_silent(machines: Machines) -> None:
    machines.start_agents()
    with flooded([connected(machines, "robot2") for _ in range(FLOODS)]):
        machines.agents["robot2"].send_signal(signal.SIGSTOP)
        time.sleep(1)
        machines.agents["robot1"].terminate()
        assert machines.agents["robot1"].wait(8) == 0
        machines.agents["robot2"].send_signal(signal.SIGCONT)


def test_an_agent_whose_standard_error_nothing_reads_goes_on(machines: Machines) -> None:
    three(machines)
    here, _ = connected(machines, "robot2")
    mine, far = connected(machines, "robot3")
    far.settimeout(10)
    filled(machines.agents["robot1"])
    # It has something to tell of that link.
    machines.agents["robot2"].terminate()
    assert machines.agents["robot2"].wait(10) == 0
    assert here.recv(1) == b""
    mine.sendall(b"ping")
    assert far.recv(4) == b"ping"
    until(lambda: machines.machines("robot1") == ["robot1", "robot3"])
    machines.agents["robot1"].terminate()
    assert machines.agents["robot1"].wait(10) == 0


def test_an_agent_that_stands_still_is_named(machines: Machines) -> None:
    machines.start_agents()
    machines.agents["robot1"].send_signal(signal.SIGSTOP)
    code, out, err = finish(machines.spawn("robot1", HPRM, "machines"))
    text = "error: the agent of this machine does not answer: is it stopped?\n"
    assert (code, out, err) == (1, "", text)
    machines.agents["robot1"].send_signal(signal.SIGCONT)
    # Others may have taken it for gone.
    machines.wait_for("robot1", ["robot1", "robot2"])


def test_starters_that_end_at_once_do_not_count(machines: Machines) -> None:
    keys = machines.folder / "keys"
    keys.touch(0o600)
    machines.start_agents("--fleet-keys", str(keys), "--allow-root")
    for _ in range(70):
        ask(machines, "robot1", "connect robot2/starters").close()
    until(lambda: children(machines.agents["robot2"]) == 0, 20)


def filled(process: subprocess.Popen[str]) -> None:
    """Writes to the standard error of a process until it takes no more."""
    descriptor = os.open(f"/proc/{process.pid}/fd/2", os.O_WRONLY | os.O_NONBLOCK)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(descriptor, b"\n")
    os.close(descriptor)


def three(machines: Machines) -> None:
    """Three agents: all reach the first one."""
    machines.start_agents()
    (port,) = free_ports(1)
    connect = ["--connect", listens_at(machines.agents["robot1"]).removeprefix("tcp/")]
    machines.start_agent("robot3", "--listen", f"127.0.0.1:{port}", *connect)
    until(lambda: "robot3" in machines.machines("robot1"))


def ask(machines: Machines, machine: str, words: str) -> socket.socket:
    """Asks an agent for something, which it has done."""
    stream = socket.socket(socket.AF_UNIX)
    machines.sockets.append(stream)
    stream.settimeout(30)
    stream.connect(f"\0{machines.address(machine)}")
    stream.sendall(f"hprm-agent-1 {words}\n".encode())
    answer = b""
    while not answer.endswith(b"\n"):
        answer += stream.recv(1)
    assert answer.startswith(b"done "), answer
    return stream


def connected(machines: Machines, machine: str) -> tuple[socket.socket, socket.socket]:
    """A link from the first machine to another one: both ends."""
    name = f"sink{len(machines.sockets)}"
    listener = ask(machines, machine, f"listen ./{name}")
    here = ask(machines, "robot1", f"connect {machine}/{name}")
    _, control, _, _ = listener.recvmsg(1, socket.CMSG_SPACE(4))
    ((_, _, data),) = control
    (descriptor,) = array.array("i", data)
    far = socket.socket(fileno=descriptor)
    far.setblocking(True)
    machines.sockets.append(far)
    return here, far


@contextlib.contextmanager
def flooded(links: list[tuple[socket.socket, socket.socket]]) -> Iterator[None]:
    """Writes to links without a pause, and reads what comes."""

    def write(end: socket.socket) -> None:
        end.settimeout(None)
        with contextlib.suppress(OSError):
            while True:
                end.send(bytes(65_536))

    def read(end: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while end.recv(1 << 20):
                pass

    ends = [*((write, here) for here, _ in links), *((read, far) for _, far in links)]
    threads = [threading.Thread(target=work, args=[end]) for work, end in ends]
    for thread in threads:
        thread.start()
    time.sleep(1)
    try:
        yield
    finally:
        for pair in links:
            for end in pair:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
        for thread in threads:
            thread.join()


def children(process: subprocess.Popen[str]) -> int:
    """How many children a process has, those included that it has not taken note of."""
    each = Path(f"/proc/{process.pid}/task").glob("*/children")
    return sum(len(path.read_text().split()) for path in each)
