"""How a process of nodes learns which federation it is part of.

What it has declared when it blocks for the first time is its share of the graph. A process that was
started by ``hprm ros run`` or ``hprm launch`` tells it to the coordinator, which answers with the
graph of all of them; any other process is a graph of its own.
"""

from __future__ import annotations

import json
import os
import socket
import threading
from dataclasses import asdict, dataclass
from typing import Any, Protocol

from hprm import _hprm
from hprm._declared import Declared
from hprm.ros._federation import Process, Scripts
from hprm.ros._graph import Endpoint, Flow, Graph, Script
from hprm.ros._offers import matched

#: The environment variable with the descriptor of the socket to the coordinator.
COORDINATOR = "HPRM_ROS_COORDINATOR"

#: The environment variable of a process that runs alone and does not wait for physical time.
FAST = "HPRM_ROS_FAST"
#: Which launch the processes that have it belong to.
LAUNCH = "HPRM_ROS_LAUNCH"


@dataclass
class Membership:
    """The place of this process in a graph."""

    graph: Graph
    declared: Declared
    #: The reactor of this process.
    process: Process
    #: The port for each flow that another process takes.
    outputs: dict[Flow, str]
    #: The port for each flow that another process sends.
    inputs: list[tuple[str, Flow]]
    #: How the federate joins its federation; none if this process is alone.
    joining: dict[str, Any] | None
    name: str
    #: At which logical time the script begins.
    delay_ns: int = 0
    #: Whether logical time does not wait for the physical one.
    is_fast: bool = False

    def undeclared(self, endpoints: list[Endpoint]) -> list[Endpoint]:
        """Return what the graph does not have of this process, which has come back with more."""
        own = next(it for it in self.graph.scripts if it.name == self.name)
        known = list(own.endpoints)
        return [it for it in endpoints if it not in known]

    def unnamed(self, nodes: list[str]) -> list[str]:
        """Return the nodes of this process that the graph does not have."""
        own = next(it for it in self.graph.scripts if it.name == self.name)
        return [it for it in nodes if it not in own.nodes]

    @property
    def has_hub(self) -> bool:
        """Whether there are other processes, and a hub between them."""
        return self.graph.has_hub

    def run(self, failures: list[str]) -> int:
        """Run the federate in this thread to its end, and return the exit code."""
        if self.joining is None:
            return _hprm.run_declared(self.declared, properties(self.is_fast), failures=failures)
        return run_member(self.declared, self.name, self.joining, failures, self.is_fast)


class Meeting(Protocol):
    """What a process tells of itself, and what it learns."""

    #: What it has declared.
    nodes: list[str]
    endpoints: list[Endpoint]

    def declare_node(self, name: str) -> None:
        """Declare a node, by its full name."""

    def declare(self, endpoint: Endpoint) -> None:
        """Declare an endpoint of a node."""

    def has_service(self, client: Endpoint) -> bool | None:
        """Return whether a process has declared a service of a client; none if it still may.

        Waits until it is declared, or all other processes have declared what they have.
        """

    def meet(self) -> Membership | None:
        """Wait for the graph; none if there is no federation any more."""

    def leave(self) -> None:
        """Take part no more, before the start."""

    def strand(self) -> None:
        """Tell that the federation has ended because of another process."""

    def again(self) -> Meeting | None:
        """Return what follows after the process has left; none if it cannot come back."""


def properties(is_fast: bool) -> list[str]:
    """Return the properties of a federation."""
    return ["fast=true"] if is_fast else []


def membership(
    graph: Graph, name: str, joining: dict[str, Any] | None, is_fast: bool
) -> Membership:
    """Find the place of the process ``name`` in a graph."""
    federation = Scripts(graph, is_fast)
    process: Process = vars(federation)[name]
    member = next(it for it in graph.members if it.name == name)
    outputs = {it.flow: it.name for it in member.outputs}
    inputs = [(it.name, it.flow) for it in member.inputs]
    declared = Declared(federation, federated=joining is not None)
    return Membership(graph, declared, process, outputs, inputs, joining, name, is_fast=is_fast)


def run_member(
    declared: Declared, name: str, joining: dict[str, Any], failures: list[str], is_fast: bool
) -> int:
    """Run a federate in this thread to its end, and return the exit code."""
    membership: Any = {
        "connect_timeout": 60.0,
        "advertise": None,
        "tls": None,
        "launched": True,
        "logical_trace": None,
        "share_of": None,
        "properties": properties(is_fast),
        **joining,
    }
    return _hprm.run_member(declared, name, membership, failures)


class Alone:
    """A process that nothing coordinates: its nodes are the whole graph."""

    def __init__(self, is_fast: bool) -> None:
        """Begin without nodes."""
        self.nodes: list[str] = []
        self.endpoints: list[Endpoint] = []
        self._is_fast = is_fast

    def declare_node(self, name: str) -> None:
        """Declare a node."""
        self.nodes.append(name)

    def declare(self, endpoint: Endpoint) -> None:
        """Declare an endpoint."""
        self.endpoints.append(endpoint)

    def has_service(self, client: Endpoint) -> bool | None:
        """Return whether a node of this process has declared a service of a client."""
        return bool(matched(client, self.endpoints))

    def meet(self) -> Membership:
        """Make a graph of what has been declared."""
        script = Script("script", tuple(self.nodes), tuple(self.endpoints))
        return membership(Graph([script]), "script", None, self._is_fast)

    def leave(self) -> None:
        """Take part no more."""

    def strand(self) -> None:
        """Tell nothing: there are no others."""

    def again(self) -> Alone:
        """Begin anew, with other nodes."""
        return Alone(self._is_fast)


class Coordinated:
    """A process that a coordinator has started."""

    def __init__(self, connection: socket.socket) -> None:
        """Tell what is declared over a connection to the coordinator."""
        self.nodes: list[str] = []
        self.endpoints: list[Endpoint] = []
        self._lock = threading.Lock()
        self._connection = connection
        self._answers = connection.makefile("r", encoding="utf-8")

    def declare_node(self, name: str) -> None:
        """Declare a node."""
        self.nodes.append(name)
        self._tell({"node": name})

    def declare(self, endpoint: Endpoint) -> None:
        """Declare an endpoint."""
        self.endpoints.append(endpoint)
        self._tell({"endpoint": asdict(endpoint)})

    def has_service(self, client: Endpoint) -> bool | None:
        """Ask whether a process has declared a service of a client, or may still do so."""
        with self._lock:
            self._tell({"find": asdict(client)})
            found: bool | None = self._answer().get("found", False)
            return found

    def meet(self) -> Membership | None:
        """Wait for the graph of all processes."""
        with self._lock:
            self._tell({"ready": True})
            answer = self._answer()
        if "graph" not in answer:
            return None
        graph = Graph.read(answer["graph"])
        found = membership(graph, answer["name"], answer["joining"], answer["is_fast"])
        found.delay_ns = answer["delay_ns"]
        return found

    def leave(self) -> None:
        """Take part no more."""
        self._tell({"leave": True})

    def strand(self) -> None:
        """Tell the coordinator that what happens to this process now follows from another one."""
        self._tell({"stranded": True})

    def again(self) -> None:
        """Do not come back: the others go on without this process."""

    def _tell(self, message: dict[str, Any]) -> None:
        try:
            self._connection.sendall(json.dumps(message).encode() + b"\n")
        except OSError:
            # The coordinator has ended, which ends this process, too.
            return

    def _answer(self) -> dict[str, Any]:
        line = self._answers.readline()
        answer: dict[str, Any] = json.loads(line) if line else {}
        return answer


def of_this_process() -> Meeting:
    """Return the meeting that the environment names."""
    number = os.environ.pop(COORDINATOR, None)
    if number is None:
        return Alone(os.environ.pop(FAST, "") == "1")
    connection = socket.socket(fileno=int(number))
    connection.set_inheritable(False)
    return Coordinated(connection)
