"""A process of nodes while it runs: its federate, the tags of its callbacks, and what it sends.

The script declares endpoints. When it blocks for the first time, a *meeting* (``_meeting.py``) says
which graph it is part of, and the federate's loop begins in a thread of its own. From then on,
reactions put what has come into the queues of the script and let its threads take turns
(``_turns.py``); what those publish leaves at the tag that they hold. What happens in threads that
hold no tag is *requested*: it is done by a reaction to a physical action.

This knows no nodes and no callbacks, but functions that take messages.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict
from threading import get_ident
from typing import Any

from hprm import _hprm
from hprm.ros._alarms import Alarm, Alarms
from hprm.ros._federation import Process
from hprm.ros._graph import Endpoint, Flow
from hprm.ros._keeping import PATIENCE_NS, Keeping, Kept, LateTaker, durable_scripts, is_durable
from hprm.ros._late import LateEndpoints
from hprm.ros._meeting import Meeting, Membership
from hprm.ros._offers import matched
from hprm.ros._pace import STEP_NS, Pace
from hprm.ros._turns import Turns, place

#: For how many seconds a thread of a script may hold a tag without blocking.
PATIENCE_S = 10.0

#: For how many seconds a fast federate may go on before it is made to leave.
NOTICING_S = 0.1

#: For how many seconds if another thread sleeps meanwhile: this one may wait for a lock of that.
PATIENCE_WITH_SLEEPERS_S = 2.0

#: How many seconds after it has published first a script begins that does not block.
STARTING_S = 0.5

#: The environment variable with the time that clocks show at the start, in nanoseconds.
START_TIME = "HPRM_ROS_START_TIME"

Deliver = Callable[[Any], None]


class Runtime:
    """The federate of this process, from its declaration to its end."""

    def __init__(self, meeting: Meeting) -> None:
        """Declare endpoints to a meeting, and run what it decides."""
        self.turns = Turns(PATIENCE_S, PATIENCE_WITH_SLEEPERS_S, self._lost)
        #: Where this process learns which federation it is part of.
        self.meeting = meeting
        self._takers: dict[Flow, list[Deliver]] = {}
        self._lock = threading.Lock()
        self._loop: threading.Thread | None = None
        self._loop_ident = 0
        self._thread_hook = threading.excepthook
        self._membership: Membership | None = None
        self._has_hub = False
        self._process: Process | None = None
        self._ended = threading.Event()
        self._requests: deque[Callable[[], None]] = deque()
        self._asked = False
        self._alarms = Alarms()
        self._starter: threading.Timer | None = None
        self._outgoing: dict[Flow, list[Any]] = {}
        self._begun_at: Any = None
        self._first: dict[Flow | None, list[Any]] = {}
        self._to_itself: list[tuple[Flow, Any]] = []
        #: What the federate says of its tags, and its actions, and port from the hub if it has one.
        self._api: Any = None
        self._ports: tuple[Any, Any, Any, Any] = (None,) * 4
        #: The time of the tag; and the last tag of a reaction, only if fast.
        self._time = 0
        self._tag: Any = None
        self._has_begun = False
        self._waits_to_begin = False
        stated = os.environ.get(START_TIME)
        #: What clocks show at the start, if that is stated, and how much less they show since then.
        self._start_ns = None if stated is None else int(stated)
        self._shift_ns = 0
        #: Whether the script has asked for the end, and whether a reaction knows it.
        self._is_left = self._leaves = False
        #: Whether that was asked for at no tag: the one at which it is noticed says nothing then.
        self._is_stopped_by_clock = False
        #: Only if logical time does not wait for the physical one.
        self._pace: Pace | None = None
        self._late = LateEndpoints()
        #: What publishers here keep for later subscriptions.
        self.keeping = Keeping()
        #: What is called when there are other endpoints, and whether that is due.
        self._lookers: list[Callable[[], None]] = []
        self._graph_is_new = True
        self._news: list[tuple[list[int], Any]] = []
        #: Services of which it was said that no node serves them.
        self._unserved: set[Flow] = set()
        #: What is called when the federate has ended, with its exit code.
        self.on_end: list[Callable[[int], None]] = []
        self.code = 0
        self.failures: list[str] = []

    # What scripts declare.

    def declare(
        self, endpoint: Endpoint, deliver: Deliver | None = None, late: LateTaker | None = None
    ) -> None:
        """Declare an endpoint; ``deliver`` gets each message that it takes.

        ``late`` is what takes them if it also gets those that publishers have kept.
        """
        flow, is_early = endpoint.takes, self._loop is None
        if flow is not None and deliver is not None and (is_early or late is None):
            self._takers.setdefault(flow, []).append(deliver)
        if is_early:
            self.meeting.declare(endpoint)
            if flow is not None and late is not None:
                self.keeping.first.append((flow, late))
            return
        # Too late for a connection.
        self._late.note(self._own_name(), endpoint)
        self._announce_first("endpoint", asdict(endpoint))
        if flow is not None and late is not None:
            if self._holds():
                self._take_kept(flow, late)
            else:
                self.request(lambda: self._take_kept(flow, late))

    def declare_node(self, name: str) -> None:
        """Declare a node, by its full name."""
        if self._loop is None:
            self.meeting.declare_node(name)
            return
        self._late.note_node(self._own_name(), name)
        self._announce_first("node", name)

    def withdraw_endpoint(self, endpoint: Endpoint) -> None:
        """Have an endpoint count no more, here and in other processes."""
        is_early = self._loop is None
        self._late.withdraw("" if is_early else self._own_name(), endpoint)

        def tell() -> None:
            if is_early:
                self._late.withdraw(self._own_name(), endpoint)
            self._announce("endpoint gone", asdict(endpoint))

        self.request(tell)

    def tell_alive(self, endpoint: Endpoint, is_alive: bool) -> None:
        """Tell whether a publisher has asserted in time that it is alive."""

        def tell() -> None:
            self._late.note_alive(endpoint, is_alive)
            self._announce("alive", [asdict(endpoint), is_alive])

        if self._holds():
            tell()
            # What looks at the graph has done so at this tag, perhaps, so it does again.
            self._alarms.set(self._time, Alarm(lambda: None))
        else:
            self.request(tell)

    def dead(self) -> list[Endpoint]:
        """Return the publishers that are there, but not alive."""
        return self._late.dead()

    def _own_name(self) -> str:
        return self._membership.name if self._membership else ""

    def on_graph(self, look: Callable[[], None]) -> None:
        """Call ``look`` in a reaction when there are other endpoints than before, and now."""
        self._lookers.append(look)
        self.request(self._see_graph)

    def off_graph(self, look: Callable[[], None]) -> None:
        """Call ``look`` no more."""
        if look in self._lookers:
            self._lookers.remove(look)

    def _see_graph(self) -> None:
        self._graph_is_new = True

    def withdraw(self, flow: Flow, deliver: Deliver) -> None:
        """Give no more messages to a function that :meth:`declare` has had."""
        takers = self._takers.get(flow, [])
        if deliver in takers:
            takers.remove(deliver)

    # What threads of scripts do.

    @property
    def can_run(self) -> bool:
        """Whether the federate may still begin, or runs."""
        return not self._ended.is_set()

    @property
    def has_left(self) -> bool:
        """Whether the script has asked for the end, and nothing runs any more."""
        return self._is_left and self._ended.is_set()

    @property
    def is_stranded(self) -> bool:
        """Whether the federation has ended because of another process."""
        return self._ended.is_set() and self.code != 0 and not self.failures

    @property
    def is_fast(self) -> bool:
        """Whether logical time does not wait for the physical one."""
        return self._pace is not None

    @property
    def has_begun(self) -> bool:
        """Whether the federation has begun."""
        return self._has_begun

    def now(self) -> int:
        """The time of the tag that this thread holds, or that of the clock, in nanoseconds."""
        ident = get_ident()
        held = ident in self.turns.holders or ident == self._loop_ident
        if held or (self._pace is not None and self._has_begun):
            return self._time - self._shift_ns
        if self._start_ns is not None and not self._has_begun:
            return self._start_ns
        return time.time_ns() - self._shift_ns

    def publish(self, flow: Flow, message: Any, kept: Kept | None = None) -> None:
        """Send a message at the tag that this thread holds, or as soon as possible.

        It is one of those in ``kept`` from then on.
        """
        if self._holds():
            self._send(flow, message, kept)
            return
        with self._lock:
            if not self._has_begun and self._starter is None:
                # A script that only publishes may never block.
                self._starter = threading.Timer(STARTING_S, self.start)
                self._starter.daemon = True
                self._starter.start()
        self.request(lambda: self._send(flow, message, kept))

    def tell(self, flow: Flow, make: Callable[[], Any]) -> None:
        """Publish what a node tells of itself, if it is taken; this is no reason to begin."""
        if self._holds():
            if self.is_taken(flow):
                self._send(flow, make())
        elif not self._has_begun or self.is_taken(flow):
            self.request(lambda: self.tell(flow, make))

    def is_taken(self, flow: Flow) -> bool:
        """Return whether there is a taker of a flow, as far as that is known."""
        membership = self._membership
        if self._takers.get(flow) or membership is None:
            return bool(self._takers.get(flow))
        return flow in membership.outputs or bool(self._late.unlinked(flow, membership))

    def request(self, action: Callable[[], None]) -> None:
        """Have a reaction call ``action``, at a tag that is now or later: the start, at first."""
        self._requests.append(action)
        self._poke()

    def wake(self) -> None:
        """Have blocked threads look at what they wait for."""
        if not self._holds():
            self._poke()

    def call_at(self, delay_ns: int, action: Callable[[], object], period_ns: int = 0) -> Alarm:
        """Call ``action`` in a reaction that much later than the tag of this thread.

        If it returns true, it is called again after the period, if there is one.
        """
        alarm = Alarm(action, period_ns)
        if self._holds():
            self._alarms.set(self._time + delay_ns, alarm)
        else:
            self.request(lambda: self._alarms.set(self._time + delay_ns, alarm))
        return alarm

    def call_again(self, alarm: Alarm) -> None:
        """Have an alarm with a period happen again, which was not to."""
        if self._holds():
            self._alarms.set_again(self._time, alarm)
        else:
            self.request(lambda: self._alarms.set_again(self._time, alarm))

    def block(
        self, condition: Callable[[], bool], timeout_ns: int | None = None, *, sleeps: bool = False
    ) -> bool:
        """Block this thread until the condition is true, or for so long; return whether it is.

        A thread that ``sleeps`` may have locks of the program.
        """
        self.wait(condition, timeout_ns, sleeps=sleeps)
        return condition()

    def wait(
        self, condition: Callable[[], bool], timeout_ns: int | None = None, *, sleeps: bool = False
    ) -> None:
        """Do the same for a caller that finds out itself why it goes on."""
        if self._loop is None:
            self.start()
        if timeout_ns is None:
            # The end of the federate is the end of all turns.
            self.turns.block(condition, self._poke, sleeps=sleeps)
            # What the thread makes for its messages need not be copied when it publishes them.
            _hprm.use_store()
            return
        is_over = False

        def end() -> None:
            nonlocal is_over
            is_over = True

        alarm = None
        if timeout_ns > 0:
            alarm = self.call_at(timeout_ns, end)
        else:
            # By the clock: a loop that polls would otherwise stop logical time.
            self.request(end)
        self.wait(lambda: is_over or condition(), sleeps=sleeps)
        if alarm is not None:
            alarm.cancel()

    def wait_for_service(self, client: Endpoint, timeout_ns: int | None) -> bool:
        """Wait until a process serves a client, or for so long; return whether one does."""
        if self._loop is None and self.meeting.has_service(client):
            return True
        return self.block(lambda: self.serves(client), timeout_ns)

    def serves(self, client: Endpoint) -> bool:
        """Return whether a process serves a client."""
        if self._loop is None:
            return bool(self.meeting.has_service(client))
        return bool(matched(client, self.endpoints()))

    def count(self, kind: str, name: str) -> int:
        """Return how many endpoints there are of a kind, with that name."""
        return sum(it.kind == kind and it.name == name for it in self.endpoints())

    def node_names(self) -> list[str]:
        """Return the full names of all nodes."""
        membership = self._membership
        if membership is None:
            return list(self.meeting.nodes)
        names = [name for script in membership.graph.scripts for name in script.nodes]
        return [*names, *self._late.nodes()]

    def endpoints(self) -> Iterator[Endpoint]:
        """Return all endpoints that are known."""
        membership = self._membership
        if membership is None:
            yield from self._late.left("", self.meeting.endpoints)
        else:
            for script in membership.graph.scripts:
                yield from self._late.left(script.name, script.endpoints)
        yield from self._late.endpoints()

    def start(self) -> None:
        """Begin with what has been declared by now, unless the federate has begun."""
        if self._loop is not None:
            return
        with self._lock:
            if self._loop is not None or self._ended.is_set():
                return
            self._loop = threading.Thread(target=self._run, name="hprm federate", daemon=True)
        self._loop.start()

    def note_stop(self, by_signal: bool = False) -> None:
        """Note that this thread, or a signal, asks for the end, which others notice at any tag."""
        if by_signal or not self._holds():
            self._is_stopped_by_clock = True

    def leave(self, patience_s: float = 5.0) -> None:
        """End the federate in order, and wait for that."""
        loop = self._loop
        self._is_left = True
        if loop is None:
            self.meeting.leave()
            self._end(0)
            return
        if self._holds() and not self._is_stopped_by_clock:
            self._leaves = True
        else:
            # At a tag of the clock, so that no other tag depends on when this was.
            self.request(self._leave_now)
        self.turns.leave()
        self._poke()
        if loop is threading.current_thread():
            return
        try:
            if self._await_end(patience_s):
                return
        except KeyboardInterrupt:
            self.turns.end()
            raise
        # A callback in another thread goes on: nothing waits for it any more.
        self.turns.end()
        self._ended.wait(1.0)

    def _await_end(self, patience_s: float) -> bool:
        """Wait for the end, no longer than that; return whether it has come."""
        until = time.monotonic() + patience_s
        while not self._ended.wait(NOTICING_S):
            if time.monotonic() > until:
                return False
            if self.is_fast and not self._leaves:
                # A federate in which nothing happens any more notices no request if it is fast;
                # again, as one that is about to begin notices nothing else either.
                self._leave_at_once()
        return True

    def _leave_at_once(self) -> None:
        try:
            if self._process is not None:
                self._process.leave()
        except RuntimeError:
            # It has not begun, or it has ended.
            return

    def _leave_now(self) -> None:
        self._leaves = True

    def _holds(self) -> bool:
        ident = get_ident()
        return ident in self.turns.holders or ident == self._loop_ident

    def _poke(self) -> None:
        """Have a reaction run soon."""
        with self._lock:
            process = self._process
            if process is None or self._asked or not self._has_begun:
                return
            self._asked = True
        if self._pace is not None:
            self._pace.ask()
            return
        try:
            process.outside.schedule(0)  # type: ignore[attr-defined]
        except RuntimeError:
            # It has ended.
            return

    def _lost(self, ident: int, patience_s: float) -> None:
        named = {it.ident: it.name for it in threading.enumerate()}
        print(
            f"warning: {named.get(ident, 'a thread')} of this script has not come back to rclpy for"
            f" {patience_s:g} s, so logical time goes on without it\n"
            f"{place(ident)}"
            "  hint: what it publishes until it spins again has the time of the clock as its tag",
            file=sys.stderr,
        )

    # The thread of the federate.

    def _run(self) -> None:
        self._loop_ident = threading.get_ident()
        try:
            membership = self.meeting.meet()
            if membership is not None:
                self._membership = membership
                self._has_hub = membership.has_hub
                self._process = membership.process
                membership.process.behavior = self
                if membership.is_fast:
                    self._pace = Pace(self.turns.blocked)
                # A reaction is nothing that scripts know: `_lost` tells which thread it waits for.
                _hprm.leave_out_long_reactions()
                self.code = membership.run(self.failures)
        except BaseException as error:
            self.code = 1
            sys.excepthook(type(error), error, error.__traceback__)
        finally:
            self._end(self.code)

    def _end(self, code: int) -> None:
        self._ended.set()
        for action in self.on_end:
            action(code)
        self.turns.end()

    # What reactions do: ``hprm.ros._federation.Behavior``.

    def begin(self) -> None:
        """Do what was asked for before the start."""
        self._find_parts()
        self._begun_at = self._api.tag()
        self._see_tag()
        # What a thread of a script raises is told, and ends nothing else, as with rclpy.
        threading.excepthook = self._thread_hook
        with self._lock:
            self._has_begun = True
        if self._start_ns is not None:
            self._shift_ns = self._time - self._start_ns
        process, membership = self._process, self._membership
        assert process is not None and membership is not None
        if self._pace is not None:
            self._pace.wait_for_threads()
        if membership.delay_ns:
            self._waits_to_begin = True
            process.wake.schedule(membership.delay_ns)  # type: ignore[attr-defined]
            return
        if process.elapsed():
            self._announce("joined", None)
        for name in membership.unnamed(self.meeting.nodes):
            self._late.note_node(membership.name, name)
            self._announce("node", name)
        for endpoint in membership.undeclared(self.meeting.endpoints):
            self._late.note(membership.name, endpoint)
            self._announce("endpoint", asdict(endpoint))
        if process.elapsed():
            # One that may come back has begun later than others, or again.
            for flow, taker in self.keeping.first:
                self._ask_for_kept(flow, taker, {})
        self._do_requests()
        self._finish()

    def react(self) -> None:
        """Take all that is present at a tag, and let callbacks run for it."""
        self._see_tag()
        process, membership = self._process, self._membership
        assert process is not None and membership is not None
        if self._waits_to_begin:
            self._take_early(process, membership)
            return
        local, wake, outside, from_hub = self._ports
        if self._to_itself and local.is_present:
            # First: what follows at this tag may send more, which is for the next one.
            arrived, self._to_itself = self._to_itself, []
            for flow, message in arrived:
                self._deliver(flow, message)
        for name, flow in membership.inputs:
            self._take(process, name, flow)
        if from_hub is not None and from_hub.is_present:
            self._take_news(from_hub.value)
        if wake.is_present:
            self._alarms.happen(self._time)
        if (self._asked or self._pace is not None) and outside.is_present:
            self._look()
            self._do_requests()
        self._finish()

    def end(self) -> None:
        """Send what a fast federate has not noticed, unless a reaction has sent at this tag."""
        before = self._tag
        self._see_tag()
        if self.is_fast and self._tag != before:
            self._do_requests()
            self._send_outgoing()

    def _take(self, process: Process, name: str, flow: Flow) -> None:
        for number, channel in enumerate(getattr(process, name)):
            if channel.is_present:
                if flow.kind == "topic":
                    self.keeping.note_taken(name, number, len(channel.value))
                for message in channel.value:
                    self._deliver(flow, message)

    def _take_early(self, process: Process, membership: Membership) -> None:
        """Keep requests until the script begins; what is on topics is not for it yet."""
        for name, flow in membership.inputs:
            if flow.kind != "topic":
                self._take(process, name, flow)
            else:
                self.keeping.take_early(name, flow, process, membership)
        if self._has_hub and process.from_hub.is_present:  # type: ignore[attr-defined]
            news = process.from_hub.value  # type: ignore[attr-defined]
            self._take_news([it for it in news if it[0] != "message" or it[1] != "topic"])
        if process.outside.is_present:  # type: ignore[attr-defined]
            self._look()
        if self._is_left:
            process.leave()
        elif process.wake.is_present:  # type: ignore[attr-defined]
            self._waits_to_begin = False
            self.keeping.deliver_early(membership)
            for flow, taker in self.keeping.first:
                self._ask_for_kept(flow, taker, {}, self._linked(flow))
            self._do_requests()
            self._finish()

    def _look(self) -> None:
        """Look at what threads have asked for."""
        with self._lock:
            self._asked = False
        if self._pace is not None:
            self._pace.looks()

    def _find_parts(self) -> None:
        """Find what each reaction needs, once: a process that does nothing has reactions, too."""
        process: Any = self._process
        self._api = process._hprm_api_
        from_hub = process.from_hub if self._has_hub else None
        self._ports = process.local, process.wake, process.outside, from_hub

    def _see_tag(self) -> None:
        self._time = self._api.logical()
        if self._pace is not None:
            self._tag = self._api.tag()

    def _take_news(self, news: list[Any]) -> None:
        """Note what others have made, and deliver what has come over the hub."""
        for kind, *told in news:
            if kind == "message":
                flow_kind, name, message, *sender = told
                self._deliver(Flow(flow_kind, name), message, *sender)
            elif kind == "kept wanted":
                self._tell_kept(*told)
            elif kind == "kept":
                self.keeping.answer(*told)
            elif kind == "joined":
                self._introduce(told[0])
            else:
                self._late.take(kind, told)
                self._see_graph()
                if kind == "endpoint known":
                    self._ask_known(told[0], Endpoint(**told[1]))

    def _introduce(self, script: str) -> None:
        """Tell a script that begins later than others what this one has made since the start."""
        membership = self._membership
        assert membership is not None
        self._late.forget(script)
        number = [it.name for it in membership.graph.scripts].index(script)
        for kind, what in self._late.introduction(membership.name):
            self._news.append(([number], (kind, membership.name, what)))
        self._see_graph()

    def _ask_known(self, script: str, endpoint: Endpoint) -> None:
        """Ask a script for what its publisher has kept since before this one began."""
        scripts = [] if self._membership is None else self._membership.graph.scripts
        others = {it.name for it in scripts if it.name != script}
        for flow, taker in self.keeping.first:
            if endpoint.sends == flow and is_durable(endpoint):
                self._ask_for_kept(flow, taker, {}, others)

    def _do_requests(self) -> None:
        while self._requests:
            self._requests.popleft()()

    def _deliver(self, flow: Flow, message: Any, sender: str | None = None) -> None:
        """Deliver a message, which has come over the hub if the sender is stated."""
        # What it has sent before it answers is in the answer.
        waiting = () if sender is None else self.keeping.waiting(sender)
        for deliver in self._takers.get(flow, ()):
            if not waiting or getattr(deliver, "__self__", None) not in waiting:
                deliver(message)

    def _send(self, flow: Flow, message: Any, kept: Kept | None = None) -> None:
        if flow.kind == "request" and flow not in self._unserved and not self.is_taken(flow):
            self._unserved.add(flow)
            print(
                f"warning: no node serves {flow.name}, so a request is lost, and its response will"
                " not come\n"
                "  hint: call wait_for_service() of the client before, and look what it returns",
                file=sys.stderr,
            )
        if flow.kind == "topic":
            self.keeping.note_sent(flow, message, kept, 0 if kept is None else self.now())
        self._outgoing.setdefault(flow, []).append(message)
        if flow in self._takers:
            self._to_itself.append((flow, message))
        membership = self._membership
        if membership is not None and membership.joining is not None:
            receivers = self._late.unlinked(flow, membership)
            if receivers:
                what = ("message", flow.kind, flow.name, message, membership.name)
                self._news.append((receivers, what))

    def _announce(self, kind: str, what: Any) -> None:
        """Tell the other processes, and nodes elsewhere, what there is now, or is no more."""
        self._see_graph()
        membership = self._membership
        if membership is not None and membership.joining is not None:
            graph = membership.graph
            names = [it.name for it in graph.scripts]
            others = [number for number, it in enumerate(names) if it != membership.name]
            if graph.is_bridged:
                others.append(len(names))
            self._news.append((others, (kind, membership.name, what)))

    def _announce_first(self, kind: str, what: Any) -> None:
        """Tell others of what this thread has made, before what it sends by means of that."""
        if self._holds():
            self._announce(kind, what)
            # What looks at the graph has done so at this tag, perhaps, so it does again.
            self.request(self._see_graph)
        else:
            self.request(lambda: self._announce(kind, what))

    def _take_kept(self, flow: Flow, taker: LateTaker) -> None:
        """Let a late subscription take messages from now on, and before what was kept."""
        membership = self._membership
        if taker.is_destroyed or membership is None:
            return
        self._takers.setdefault(flow, []).append(taker.deliver)
        coming = {id(message) for to, message in self._to_itself if to == flow}
        kept = self.keeping.of(flow, self.now())
        taker.deliver_before([message for message in kept if id(message) not in coming])
        taken = self.keeping.taken(flow, membership)
        self._ask_for_kept(flow, taker, taken)

    def _ask_for_kept(
        self,
        flow: Flow,
        taker: LateTaker,
        taken: dict[str, int],
        but: Collection[str] = (),
    ) -> None:
        """Ask other scripts, but some, for what they have kept, up to what was taken of them."""
        membership = self._membership
        assert membership is not None
        if membership.joining is None:
            return
        scripts = [it.name for it in membership.graph.scripts]
        found = durable_scripts(flow, membership, self._late.of_scripts()).difference(but)
        if not found:
            return
        number = self.keeping.ask(taker, found)
        self.call_at(PATIENCE_NS, lambda: self.keeping.forget_asked(number))
        what = ("kept wanted", scripts.index(membership.name), flow.kind, flow.name, number, taken)
        receivers = [scripts.index(it) for it in sorted(found)]
        # After they have been told that there is a subscription.
        self.request(lambda: self._news.append((receivers, what)))

    def _tell_kept(
        self, asker: int, kind: Any, name: str, number: int, taken: dict[str, int]
    ) -> None:
        messages = self.keeping.of(Flow(kind, name), self.now(), taken.get(self._own_name()))
        self._news.append(([asker], ("kept", number, self._own_name(), messages)))

    def _linked(self, flow: Flow) -> set[str]:
        """Return which scripts have a connection for a topic to this one."""
        membership = self._membership
        assert membership is not None
        return set(self.keeping.taken(flow, membership))

    def _with_first(self, flow: Flow | None, messages: list[Any]) -> list[Any]:
        """Return what a port gets: at the first tag two reactions run, and the later adds to it.

        Nothing else may keep the list: then an array that only a message has is not copied.
        """
        if self._api.tag() != self._begun_at:
            self._first.clear()
            return messages
        first = self._first.setdefault(flow, [])
        first += messages
        return list(first)

    def _send_outgoing(self) -> None:
        """Set the ports for what was published."""
        membership, process = self._membership, self._process
        assert membership is not None and process is not None
        for flow, messages in self._outgoing.items():
            name = membership.outputs.get(flow)
            if name is not None:
                getattr(process, name).set(self._with_first(flow, messages))
        self._outgoing.clear()
        if self._news:
            news, self._news = self._news, []
            process.to_hub.set(self._with_first(None, news))  # type: ignore[attr-defined]

    def _finish(self) -> None:
        """Let threads run for which there is something; then send what they have published."""
        process = self._process
        assert process is not None
        local, wake, outside, _ = self._ports
        if self._graph_is_new:
            self._graph_is_new = False
            for look in list(self._lookers):
                look()
        self.turns.settle()
        if self._outgoing or self._news:
            self._send_outgoing()
        if self._to_itself:
            local.schedule(0)
        due = self._alarms.next()
        if due is not None:
            wake.schedule(max(due - self._time, 0))
        if self._leaves:
            process.leave()
        elif self._pace is not None and self._pace.end_tag(self._time):
            outside.schedule(STEP_NS)
