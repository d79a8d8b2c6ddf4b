"""Endpoints and nodes that were made after the start, of this process and others, and elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from hprm.ros._graph import Endpoint, Flow

if TYPE_CHECKING:
    from hprm.ros._meeting import Membership


class LateEndpoints:
    """Late endpoints and nodes, here and elsewhere, and where messages go without a connection."""

    def __init__(self) -> None:
        """Begin without late endpoints."""
        self._late: list[tuple[str, Endpoint]] = []
        #: What was declared before the start, and is there no more.
        self._gone: list[tuple[str, Endpoint]] = []
        self._nodes: list[tuple[str, str]] = []
        #: Publishers that are there and have not asserted in time that they are alive.
        self._dead: list[Endpoint] = []
        self._open: set[Flow] = set()
        self._receivers: dict[Flow, list[int]] = {}

    def note(self, script: str, endpoint: Endpoint) -> None:
        """Note that a script has made an endpoint."""
        self._late.append((script, endpoint))
        self._receivers.clear()

    def withdraw(self, script: str, endpoint: Endpoint) -> None:
        """Note that a script has destroyed an endpoint."""
        if (script, endpoint) in self._late:
            self._late.remove((script, endpoint))
        else:
            self._gone.append((script, endpoint))
        self.note_alive(endpoint, True)
        self._receivers.clear()

    def note_alive(self, endpoint: Endpoint, is_alive: bool) -> None:
        """Note whether a publisher has asserted that it is alive; one that is gone counts not."""
        if not is_alive:
            self._dead.append(endpoint)
        elif endpoint in self._dead:
            self._dead.remove(endpoint)

    def dead(self) -> list[Endpoint]:
        """Return the publishers that are there, but not alive."""
        return list(self._dead)

    def left(self, script: str, declared: Iterable[Endpoint]) -> Iterator[Endpoint]:
        """Return what is still there of what a script had declared at the start."""
        gone = [it for name, it in self._gone if name == script]
        for endpoint in declared:
            if endpoint in gone:
                gone.remove(endpoint)
            else:
                yield endpoint

    def forget(self, script: str) -> None:
        """Forget what a script has made: it begins again, and says what there is."""
        self._late = [it for it in self._late if it[0] != script]
        self._gone = [it for it in self._gone if it[0] != script]
        self._nodes = [it for it in self._nodes if it[0] != script]
        self._receivers.clear()

    def introduction(self, script: str) -> Iterator[tuple[str, Any]]:
        """Return what a script has to tell one that begins later than others."""
        for name, node in self._nodes:
            if name == script:
                yield "node", node
        for name, endpoint in self._gone:
            if name == script:
                yield "endpoint gone", asdict(endpoint)
        for name, endpoint in self._late:
            if name == script:
                yield "endpoint known", asdict(endpoint)

    def note_node(self, script: str, name: str) -> None:
        """Note that a script has made a node."""
        self._nodes.append((script, name))

    def take(self, kind: str, told: Sequence[Any]) -> None:
        """Take news of other scripts, or of nodes elsewhere."""
        match kind:
            case "endpoint" | "endpoint known":
                self._late.append((told[0], Endpoint(**told[1])))
            case "endpoint gone":
                self.withdraw(told[0], Endpoint(**told[1]))
            case "alive":
                self.note_alive(Endpoint(**told[1][0]), told[1][1])
            case "node":
                self._nodes.append((told[0], told[1]))
            case "node gone":
                self._nodes.remove((told[0], told[1]))
            case "open":
                self._open.add(Flow(*told))
            case "close":
                self._open.discard(Flow(*told))
        self._receivers.clear()

    def endpoints(self) -> Iterator[Endpoint]:
        """Return the late endpoints."""
        yield from (endpoint for _, endpoint in list(self._late))

    def of_scripts(self) -> list[tuple[str, Endpoint]]:
        """Return the late endpoints with the names of their scripts."""
        return list(self._late)

    def nodes(self) -> Iterator[str]:
        """Return the full names of late nodes."""
        yield from (name for _, name in list(self._nodes))

    def unlinked(self, flow: Flow, membership: Membership) -> list[int]:
        """Return the numbers of those that take a flow without a connection for it."""
        if not self._late and not membership.graph.is_bridged:
            return []
        found = self._receivers.get(flow)
        if found is None:
            found = self._receivers[flow] = self._find(flow, membership)
        return found

    def _find(self, flow: Flow, membership: Membership) -> list[int]:
        graph, me = membership.graph, membership.name
        takers = {name for name, it in self._late if it.takes == flow}
        for script in graph.scripts:
            if any(it.takes == flow for it in script.endpoints):
                takers.add(script.name)
        takers -= graph.linked(flow, me) | {me}
        found = [number for number, it in enumerate(graph.scripts) if it.name in takers]
        if graph.is_bridged and (flow in self._open or self._is_kept(flow, membership)):
            found.append(len(graph.scripts))
        return found

    def _is_kept(self, flow: Flow, membership: Membership) -> bool:
        """Whether the bridge keeps the messages for subscriptions elsewhere that come later."""
        own = [it for name, it in self._late if name == membership.name]
        for script in membership.graph.scripts:
            if script.name == membership.name:
                own.extend(script.endpoints)
        return any(
            it.kind == "publisher"
            and it.sends == flow
            and it.qos.get("durability") == "TRANSIENT_LOCAL"
            for it in own
        )
