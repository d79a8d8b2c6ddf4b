"""The reactors of a graph of scripts: one for each script, with a port for each flow, and the hub.

The hub is connected to all of them by physical connections, with which it delays no script, or by
logical ones if logical time does not wait for the physical one; also if what comes from elsewhere
has tags by its stamps: it forwards at these. What was not declared when the
federation began goes over the hub.

What a reactor does is up to the ``behavior`` of the one that runs here; in the other processes it
has none. Ports carry lists of messages: those of a tag, in their order.
"""

from __future__ import annotations

import heapq
import types
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import hprm
from hprm._connect import connect
from hprm._reactor import Federation, Reactor
from hprm.ros._graph import RESERVED, Graph, Member, identifier


class Behavior(Protocol):
    """What the reactions of a script do."""

    def begin(self) -> None:
        """Begin, at the first tag."""

    def react(self) -> None:
        """Take all that is present at a tag."""

    def end(self) -> None:
        """End, at the last tag."""


class Process(Reactor):
    """A process of nodes; classes for the scripts of a graph are made of it."""

    #: What runs here, set where it does.
    behavior: Behavior


class Bridge(Protocol):
    """What the hub has to do with nodes elsewhere."""

    def begin(self, wake: Callable[[], None]) -> None:
        """Begin; ``wake``, called in any thread, has the hub ask for what has arrived."""

    def take(self, sender: int, news: Any) -> None:
        """Take what a script tells."""

    def arrived(self) -> list[tuple[Sequence[int], Any]]:
        """Return what has come for scripts since the last call."""

    def due(self, news: Any, now: int) -> int:
        """Return at which time news are due that have come now, if they are aligned."""


class Hub(Reactor):
    """Carries what scripts tell one another that no connection is for: news of endpoints, messages.

    What comes in is a list of ``(receivers, news)``: each of these scripts gets the news. The
    number behind those of the scripts is that of the bridge to nodes elsewhere.
    """

    #: What is between here and the nodes elsewhere, set where the hub runs.
    bridge: Bridge | None = None
    outside: Any = hprm.PhysicalAction()
    inputs = hprm.Input(list, width=lambda self: self.width)
    outputs = hprm.Output(list, width=lambda self: self.width)

    def __init__(self, width: int) -> None:
        """Connect that many scripts."""
        self.width = width

    @hprm.reaction(hprm.startup)
    def begin(self) -> None:
        """Let the bridge take from now on what comes from elsewhere."""
        if self.bridge is not None:
            self.bridge.begin(lambda: self.outside.schedule(0))

    @hprm.reaction(inputs, outside, effects=[outputs])
    def forward(self) -> None:
        """Forward what has come."""
        bridge = self.bridge
        if bridge is not None and self.outside.is_present:
            _forward(self, bridge, bridge.arrived())
        else:
            _forward(self, bridge)


class AlignedHub(Reactor):
    """The hub of a federation in which what comes from elsewhere has tags by its stamps.

    It forwards by logical connections, so scripts wait at each tag until it has passed that.
    """

    bridge: Bridge | None = None
    outside: Any = hprm.PhysicalAction()
    due: Any = hprm.Action()
    inputs = hprm.Input(list, width=lambda self: self.width)
    outputs = hprm.Output(list, width=lambda self: self.width)

    def __init__(self, width: int) -> None:
        """Connect that many scripts."""
        self.width = width
        #: What is not due yet: when it is, a number, receivers and news.
        self.held: list[tuple[int, int, Sequence[int], Any]] = []
        self.count = 0
        self.scheduled: set[int] = set()

    @hprm.reaction(hprm.startup)
    def begin(self) -> None:
        """Let the bridge take from now on what comes from elsewhere."""
        if self.bridge is not None:
            self.bridge.begin(lambda: self.outside.schedule(0))

    @hprm.reaction(inputs, outside, due, effects=[outputs, due])
    def forward(self) -> None:
        """Forward what has come from scripts, and from elsewhere what is due."""
        bridge, now = self.bridge, int(self.tag().time)
        if bridge is not None and self.outside.is_present:
            for receivers, news in bridge.arrived():
                self.count += 1
                held = bridge.due(news, now), self.count, receivers, news
                heapq.heappush(self.held, held)
        passed = []
        while self.held and self.held[0][0] <= now:
            _, _, receivers, news = heapq.heappop(self.held)
            passed.append((receivers, news))
        _forward(self, bridge, passed)
        self.scheduled.discard(now)
        if self.held and self.held[0][0] not in self.scheduled:
            self.scheduled.add(self.held[0][0])
            self.due.schedule(self.held[0][0] - now)


class LogicalHub(Reactor):
    """The hub of a federation that does not wait for physical time: it has nothing physical."""

    inputs = hprm.Input(list, width=lambda self: self.width)
    outputs = hprm.Output(list, width=lambda self: self.width)

    def __init__(self, width: int) -> None:
        """Connect that many scripts."""
        self.width = width

    @hprm.reaction(inputs, effects=[outputs])
    def forward(self) -> None:
        """Forward what has come."""
        _forward(self)


def _forward(
    hub: Hub | AlignedHub | LogicalHub,
    bridge: Bridge | None = None,
    arrived: Iterable[tuple[Sequence[int], Any]] = (),
) -> None:
    """Forward what has arrived from elsewhere, and what scripts tell one another and the bridge."""
    passed: dict[int, list[Any]] = {}
    for receivers, news in arrived:
        for receiver in receivers:
            passed.setdefault(receiver, []).append(news)
    for sender, port in enumerate(hub.inputs):
        for receivers, news in port.value if port.is_present else ():
            for receiver in receivers:
                if receiver < hub.width:
                    passed.setdefault(receiver, []).append(news)
                elif bridge is not None:
                    bridge.take(sender, news)
    for receiver, news in passed.items():
        hub.outputs[receiver].set(news)


#: How many lists of news may wait at either end; further ones are dropped, and counted.
WAITING = 10_000


def _class_of(member: Member, with_hub: bool, is_fast: bool) -> type[Process]:
    """Make the class of a script: its ports and its reactions."""

    def body(names: dict[str, Any]) -> None:
        outputs = [_put(names, it.name, hprm.Output(list)) for it in member.outputs]
        wake, local = hprm.Action(), hprm.Action()
        # A federation that does not wait for physical time has nothing physical.
        outside: Any = hprm.Action() if is_fast else hprm.PhysicalAction()
        taken = {it.name for it in (*member.inputs, *member.outputs)} | set(RESERVED)
        names |= {"wake": wake, "local": local, "outside": outside}
        effects = [*outputs, wake, local, *([outside] if is_fast else [])]
        if with_hub:
            effects.append(_put(names, "to_hub", hprm.Output(list)))

        inputs = [
            _put(names, it.name, hprm.Input(list, width=len(it.senders))) for it in member.inputs
        ]
        if with_hub:
            inputs.append(_put(names, "from_hub", hprm.Input(list)))

        def add(called: str, triggers: list[Any], function: Callable[[Any], None]) -> None:
            function.__name__ = name = identifier(called, taken)
            function.__qualname__ = f"{member.name}.{name}"
            names[name] = hprm.reaction(*triggers, effects=effects)(function)

        add("begin", [hprm.startup], lambda self: self.behavior.begin())
        # One for all, so that callbacks begin when all is there that belongs to a tag.
        add("react", [local, *inputs, wake, outside], lambda self: self.behavior.react())
        add("finish", [hprm.shutdown], lambda self: self.behavior.end())
        names["__module__"] = __name__

    made: type[Process] = types.new_class(member.name, (Process,), {}, body)
    return made


def _put(names: dict[str, Any], name: str, part: Any) -> Any:
    names[name] = part
    return part


class Scripts(Federation, coordination="centralized", keepalive=True):
    """The federation of a graph."""

    def __init__(self, graph: Graph, is_fast: bool = False) -> None:
        """Make and connect the reactors of all scripts, which do not wait for the clock if fast."""
        with_hub = graph.has_hub
        made = {it.name: _class_of(it, with_hub, is_fast)() for it in graph.members}
        for script in graph.scripts:
            hprm.federate(made[script.name], transient=script.is_transient)
        vars(self).update(made)
        for sender, output, receiver, port, channel in graph.connections():
            # One microstep later, so that any callback may send what any other one takes.
            source = getattr(made[sender], output.name)
            connect(source, getattr(made[receiver], port.name)[channel], after=0)
        if not with_hub:
            return
        of_kind = LogicalHub if is_fast else AlignedHub if graph.is_aligned else Hub
        self.hub: Any = of_kind(len(made))
        physical: dict[str, Any] = {"physical": True, "bound": (WAITING, "drop")}
        logical: dict[str, Any] = {"after": 0}
        to_hub = logical if is_fast else physical
        from_hub = physical if of_kind is Hub else logical
        for number, process in enumerate(vars(self)[it.name] for it in graph.members):
            connect(process.to_hub, self.hub.inputs[number], **to_hub)
            connect(self.hub.outputs[number], process.from_hub, **from_hub)
