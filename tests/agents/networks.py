"""Networks for tests: machines in namespaces, in subnets without a route to one another.

One machine, the hub, is in all subnets. Where the kernel makes no namespaces, all machines are on
the loopback device, and each agent but that of the hub connects to the hub's only.
"""

from __future__ import annotations

import shutil
import subprocess
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

from machines import AGENT, Machines
from tcp_ports import free_ports

HUB = "hub"
PORT = 7650


class NoNamespacesError(Exception):
    """The kernel, or what is installed, does not let this user make networks."""


class Network:
    """Subnets, each a bridge of the hub with a cable to each machine; they end with this."""

    def __init__(self, subnets: Sequence[Sequence[str]]) -> None:
        for tool in ("ip", "nsenter", "unshare"):
            if shutil.which(tool) is None:
                raise NoNamespacesError(f"{tool} is missing")
        self.holders: list[subprocess.Popen[bytes]] = []
        self.pids: dict[str, int] = {}
        #: Where each machine reaches the hub, and where the hub reaches it.
        self.gates: dict[str, str] = {}
        self.addresses: dict[str, str] = {}
        try:
            self.pids[HUB] = self._hold("unshare", "-Urn")
            self(HUB, "ip", "link", "set", "lo", "up")
            for number, machines in enumerate(subnets, start=1):
                self._add_subnet(number, machines)
        except NoNamespacesError:
            self.close()
            raise

    def _add_subnet(self, number: int, machines: Sequence[str]) -> None:
        bridge, subnet = f"bridge{number}", f"10.78.{number}"
        self(HUB, "ip", "link", "add", bridge, "type", "bridge")
        self(HUB, "ip", "address", "add", f"{subnet}.1/24", "dev", bridge)
        self(HUB, "ip", "link", "set", bridge, "up")
        for place, machine in enumerate(machines, start=2):
            pid = self._hold(*self.command(HUB, "unshare", "-n"))
            self.pids[machine] = pid
            self.gates[machine] = f"{subnet}.1"
            self.addresses[machine] = f"{subnet}.{place}"
            near, cable = f"cable{number}-{place}", "cable"
            self(HUB, "ip", "link", "add", near, "type", "veth", "peer", "name", cable)
            self(HUB, "ip", "link", "set", cable, "netns", str(pid))
            self(HUB, "ip", "link", "set", near, "master", bridge, "up")
            self(machine, "ip", "address", "add", f"{subnet}.{place}/24", "dev", cable)
            self(machine, "ip", "link", "set", cable, "up")
            self(machine, "ip", "link", "set", "lo", "up")

    def _hold(self, *command: str) -> int:
        """Starts something that stays in its namespace as long as its input is open."""
        holder = subprocess.Popen(
            [*command, "sh", "-c", "echo; exec cat"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self.holders.append(holder)
        assert holder.stdout is not None
        if holder.stdout.readline() != b"\n":
            _, err = holder.communicate()
            raise NoNamespacesError(f"{' '.join(command)}: {err.decode().strip()}")
        return holder.pid

    def command(self, machine: str, *arguments: str) -> list[str]:
        """A command line that runs on a machine."""
        enter = ["nsenter", "-t", str(self.pids[machine]), "-U", "-n", "--preserve-credentials"]
        return [*enter, *arguments]

    def __call__(self, machine: str, *arguments: str) -> None:
        """Runs a command on a machine, to its end."""
        command = self.command(machine, *arguments)
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise NoNamespacesError(f"{' '.join(arguments)}: {done.stderr.strip()}")

    def close(self) -> None:
        """Leaves nothing behind."""
        for holder in reversed(self.holders):
            if holder.stdin is not None and not holder.stdin.closed:
                holder.communicate()


@dataclass
class Fleet(Machines):
    """Machines in subnets, and the hub, which is in all of them, and whose agent is a router."""

    network: Network | None = None
    ports: dict[str, int] = field(default_factory=dict)

    def lay_out(self, subnets: Sequence[Sequence[str]], with_namespaces: bool = True) -> None:
        """Makes the network, as far as that is possible here."""
        names = [HUB, *(machine for subnet in subnets for machine in subnet)]
        if with_namespaces:
            try:
                self.network = Network(subnets)
            except NoNamespacesError as error:
                warnings.warn(f"all machines are on the loopback device: {error}", stacklevel=2)
        if self.network is None:
            self.ports = dict(zip(names, free_ports(len(names)), strict=True))

    def entered(self, machine: str, command: Sequence[str]) -> tuple[str, ...]:
        """A command line that runs on a machine."""
        # What is about credentials needs no network: the authority listens on the loopback device.
        if self.network is None or tuple(command[:2]) in [(AGENT, word) for word in CREDENTIALS]:
            return tuple(command)
        return tuple(self.network.command(machine, *command))

    def start(self, machine: str, *options: str) -> None:
        """Starts the agent of a machine, which connects to that of the hub."""
        if self.network is None:
            listen = f"127.0.0.1:{self.ports[machine]}"
            hub = f"127.0.0.1:{self.ports[HUB]}"
            only = ["--connect-only"]
        else:
            listen = f"0.0.0.0:{PORT}"
            hub = f"{self.network.gates.get(machine)}:{PORT}"
            only = []
        connect = [] if machine == HUB else ["--connect", hub, *only]
        self.start_agent(machine, "--listen", listen, *connect, *options)

    def meet(self, *machines: str) -> None:
        """Waits until all agents know of all machines."""
        for machine in machines:
            others = sorted(set(machines) - {machine})
            self.wait_for(machine, [machine, *others])

    def through(self, machine: str) -> dict[str, str | None]:
        """Through which machine the agent of one reaches the others."""
        return {one["name"]: one["through"] for one in self.tell_machines(machine)[1:]}

    def close(self) -> None:
        """Leaves nothing behind."""
        super().close()
        if self.network is not None:
            self.network.close()


CREDENTIALS = ("authority", "invite", "enroll", "revoke")
