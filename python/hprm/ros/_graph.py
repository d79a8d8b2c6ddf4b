"""What scripts declare, and the graph of a federation that follows from it: plain data.

Each script is a federate. A *flow* is what goes from federate to federate: the messages of a
topic, the requests to a service, or its responses. A federate has one port for each flow, whatever
nodes and endpoints it has there: the messages of one tag travel together, in their order.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from hprm._reactor import Reactor

#: By which name the bridge to nodes elsewhere is told from scripts; its number is behind theirs.
BRIDGE = "<bridge>"

Kind = Literal["publisher", "subscription", "client", "service"]


@dataclass(frozen=True)
class Flow:
    """What goes from federate to federate."""

    kind: Literal["topic", "request", "response"]
    #: The full name of the topic or service.
    name: str


@dataclass(frozen=True)
class Endpoint:
    """A publisher, a subscription, a client or a service of a node."""

    kind: Kind
    #: The full name of the node.
    node: str
    #: The full name of the topic or service.
    name: str
    #: As ``std_msgs/msg/String``.
    type: str
    #: What others have to know of its quality of service.
    qos: dict[str, Any] = field(default_factory=dict, hash=False)

    @property
    def sends(self) -> Flow | None:
        """What it sends."""
        match self.kind:
            case "publisher":
                return Flow("topic", self.name)
            case "client":
                return Flow("request", self.name)
            case "service":
                return Flow("response", self.name)
        return None

    @property
    def takes(self) -> Flow | None:
        """What it takes."""
        match self.kind:
            case "subscription":
                return Flow("topic", self.name)
            case "client":
                return Flow("response", self.name)
            case "service":
                return Flow("request", self.name)
        return None


@dataclass(frozen=True)
class Script:
    """A process with its nodes."""

    name: str
    #: The full names of its nodes.
    nodes: tuple[str, ...]
    endpoints: tuple[Endpoint, ...]
    #: Whether it comes back when it has ended.
    is_transient: bool = False


@dataclass(frozen=True)
class Port:
    """A port of a federate."""

    name: str
    flow: Flow
    #: For inputs, the federates that send, in order.
    senders: tuple[str, ...] = ()


@dataclass(frozen=True)
class Member:
    """A federate of the graph."""

    name: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]


class Graph:
    """Scripts, and what connects them."""

    def __init__(
        self, scripts: Sequence[Script], is_bridged: bool = False, is_aligned: bool = False
    ) -> None:
        """Match what scripts send and take; there may be a bridge to nodes elsewhere.

        What comes over that has tags by its stamps if it is aligned.
        """
        self.scripts = tuple(scripts)
        self.is_bridged = is_bridged
        self.is_aligned = is_aligned
        senders: dict[Flow, list[str]] = {}
        takers: dict[Flow, list[str]] = {}
        for script in scripts:
            for flow in _once(it.sends for it in script.endpoints):
                senders.setdefault(flow, []).append(script.name)
            for flow in _once(it.takes for it in script.endpoints):
                takers.setdefault(flow, []).append(script.name)
        self.members = tuple(_member(it, senders, takers) for it in scripts)

    def linked(self, flow: Flow, sender: str) -> set[str]:
        """The federates to which a connection carries a flow from ``sender``."""
        return {
            member.name
            for member in self.members
            for port in member.inputs
            if port.flow == flow and sender in port.senders
        }

    def connections(self) -> Iterator[tuple[str, Port, str, Port, int]]:
        """Each output with an input that it is connected to, and its channel there."""
        members = {it.name: it for it in self.members}
        for member in self.members:
            for port in member.inputs:
                for channel, name in enumerate(port.senders):
                    output = next(it for it in members[name].outputs if it.flow == port.flow)
                    yield name, output, member.name, port, channel

    @property
    def has_hub(self) -> bool:
        """Whether there is a hub, for other processes or for nodes elsewhere."""
        comes_back = any(it.is_transient for it in self.scripts)
        return len(self.members) > 1 or self.is_bridged or comes_back

    def document(self) -> dict[str, Any]:
        """What :meth:`read` makes the same graph of, for JSON."""
        scripts = [asdict(it) for it in self.scripts]
        facts = {"is_bridged": self.is_bridged, "is_aligned": self.is_aligned}
        return {"scripts": scripts, **facts}

    @classmethod
    def read(cls, document: dict[str, Any]) -> Graph:
        """Make the graph that :meth:`document` has described."""
        scripts = [read_script(it) for it in document["scripts"]]
        return cls(scripts, document["is_bridged"], document["is_aligned"])


def read_script(document: dict[str, Any]) -> Script:
    """Make a script of what ``dataclasses.asdict`` has made of it."""
    endpoints = tuple(Endpoint(**it) for it in document["endpoints"])
    nodes = tuple(document["nodes"])
    return Script(document["name"], nodes, endpoints, document["is_transient"])


def mismatches(scripts: Iterable[Script]) -> list[str]:
    """Name topics and services whose endpoints have several types."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for script in scripts:
        for it in script.endpoints:
            what = "topic" if it.kind in ("publisher", "subscription") else "service"
            found.setdefault((what, it.name), {}).setdefault(it.type, it.node)
    return [
        f"the {what} {name} has several types: "
        + ", ".join(f"{type_} of the node {node}" for type_, node in types.items())
        for (what, name), types in found.items()
        if len(types) > 1
    ]


def _once(flows: Iterable[Flow | None]) -> Iterator[Flow]:
    yield from dict.fromkeys(flow for flow in flows if flow is not None)


def _member(
    script: Script, senders: dict[Flow, list[str]], takers: dict[Flow, list[str]]
) -> Member:
    taken = set(RESERVED)
    outputs, inputs = [], []
    for flow in _once(it.sends for it in script.endpoints):
        if any(name != script.name for name in takers.get(flow, ())):
            outputs.append(Port(_port_name(flow, taken), flow))
    for flow in _once(it.takes for it in script.endpoints):
        others = tuple(name for name in senders.get(flow, ()) if name != script.name)
        if others:
            inputs.append(Port(_port_name(flow, taken), flow, others))
    return Member(script.name, tuple(inputs), tuple(outputs))


def _port_name(flow: Flow, taken: set[str]) -> str:
    """Make a name of Python: ``camera_image`` of ``/camera/image``."""
    suffix = "" if flow.kind == "topic" else f"_{flow.kind}"
    return identifier(flow.name + suffix, taken)


#: Names that a federate has besides those of its flows.
RESERVED = ("behavior", "wake", "local", "outside", "to_hub", "from_hub", "hub")


def identifier(text: str, taken: set[str]) -> str:
    """Make a name of Python that is not taken, and take it."""
    name = re.sub(r"\W+", "_", text).strip("_") or "port"
    if name[0].isdigit() or keyword.iskeyword(name) or hasattr(Reactor, name):
        name = f"{name}_" if not name[0].isdigit() else f"_{name}"
    found, number = name, 2
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    taken.add(found)
    return found
