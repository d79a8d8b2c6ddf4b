"""Running several scripts as one federation: from what they declare to the end of the last one.

The scripts run until they block for the first time. Then the graph of all that they have declared
is the federation; each gets it and joins, and the coordinator is left with the RTI, the output of
the scripts, and their ends.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import secrets
import selectors
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any

from hprm import _hprm
from hprm._declared import Declared
from hprm.ros._federation import Scripts
from hprm.ros._functions import Functions
from hprm.ros._graph import Graph, Script, identifier, mismatches
from hprm.ros._lines import lines_of, write_line
from hprm.ros._meeting import properties, run_member
from hprm.ros._members import NO_NODES_IF_FAST, Member, Plan
from hprm.ros._messages import find_beside
from hprm.ros._offers import matched
from hprm.ros._zenoh.session import BridgeError, Settings, open_session

if TYPE_CHECKING:
    from hprm.ros._following import Answer, Following
    from hprm.ros._zenoh.bridge import ZenohBridge

#: For how many seconds scripts may go on after a signal, before they are killed.
PATIENCE_S = 8.0

#: After how many seconds scripts are named that the others wait for.
SLOW_S = 10.0

#: For how many seconds the last lines of a process may come after its end, or of the last one.
LINES_S = 1.0

#: How many nodes that only functions of a launch file know may start once the others run, and what
#: stands for one until then.
SPARES = 8
SPARE = Plan("later", ())

#: How many processes that functions of a launch file start may run at once, or wait to do so.
AT_ONCE = 64
_TOO_MANY = (
    f"functions of handlers start at most {AT_ONCE} processes that run at once\n"
    "  hint: a handler without target_action counts for the processes of its own function, too"
)

# Why a node cannot be started by a function, without and with `--fast`.
_NO_PLACE = (
    f"functions of handlers start at most {SPARES} nodes once the others run\n"
    "  hint: state nodes as actions of handlers, of which there may be any number",
    NO_NODES_IF_FAST,
)

#: What ends a federation if all processes end well.
WITHOUT_LEAVING = (
    "has ended without leaving its federation, so the other scripts end\n"
    "  hint: a script leaves when it ends as Python ends it, but not with os._exit()"
)


class Coordinator:
    """Some scripts, from their start to the end of the last one."""

    def __init__(
        self,
        plans: Sequence[Plan],
        bridge: ZenohBridge | None = None,
        logical_trace: str | None = None,
        *,
        is_fast: bool = False,
        following: Following | None = None,
    ) -> None:
        """Take the scripts, and let there be a bridge between their hub and nodes elsewhere."""
        self._bridge = bridge
        self._is_fast = is_fast
        self._logical_trace = logical_trace
        self._hub: threading.Thread | None = None
        self._taken: set[str] = set()
        self._numbers = itertools.count(1)
        #: What follows of what happens, and lines that were printed of which that is not decided.
        self._following = following
        self._printed: deque[tuple[Member, bytes, int]] = deque()
        self._has_told_end = False
        #: Whether an error of a handler was told, after which others may follow from that.
        self._is_wrong = False
        #: What functions of handlers have started, as far as it runs.
        self._called: list[Member] = []
        self._rti: _hprm.LocalRti | None = None
        self._selector = selectors.DefaultSelector()
        self._signals = 0
        #: What the RTI tells of federates, in its thread, and what is not decided of that.
        self._told: deque[tuple[str, str, str, float]] = deque()
        self._lost: list[str] = []
        #: The exit code of the first script that has failed by itself.
        self._failed = 0
        self._is_refused = False
        #: Whether the federation has failed, so that no script can join it any more.
        self._is_failed = False
        self._is_over = False
        #: What is started again, and when.
        self._due: list[tuple[float, Member]] = []
        self._graph: Graph | None = None
        self._until: float | None = None
        self._slow_at: float | None = time.monotonic() + SLOW_S
        self._wakes, self._wakeup = socket.socketpair()
        self._wakeup.setblocking(False)
        self._selector.register(self._wakes, selectors.EVENT_READ)
        self.members: list[Member] = []
        self._first = [self._add(plan) for plan in plans]
        if following is not None:
            # All that begins at another time than the others reads the clock.
            spares = [SPARE] * SPARES if following.calls and not is_fast else []
            for plan in (*following.later, *spares):
                self._add(plan)
        self._readers: list[threading.Thread] = []
        #: Closed at the second when readers are to end, although something keeps a pipe open.
        self._pipe = os.pipe()
        self._functions = Functions() if following is None else following.functions

    def _add(self, plan: Plan) -> Member:
        member = Member(identifier(plan.name, self._taken), plan)
        self.members.append(member)
        return member

    def _start(self, member: Member) -> None:
        """Start a process, for the first time or again, unless the launch ends."""
        if self._functions.came or self._signals or self._is_over or self._is_refused:
            # That has come in between.
            member.code = 0
            return
        try:
            if member.is_started:
                member.lives += 1
                member.start()
            else:
                member.begin(next(self._numbers))
        except OSError as error:
            member.code = 1
            self._failed = self._failed or 1
            write_line(f"error: {member.label} cannot be started: {error}", sys.stderr)
            self._is_over = True
            self._stop(signal.SIGINT)
            return
        self._attend(member)
        if self._following is not None:
            self._follow(self._following.started(member))

    def _attend(self, member: Member) -> None:
        """Listen to a process that was started."""
        self._selector.register(member.connection, selectors.EVENT_READ, member)
        readers = []
        for descriptor, stream, out in (
            (1, member.process.stdout, sys.stdout),
            (2, member.process.stderr, sys.stderr),
        ):
            assert stream is not None
            shown = (member, stream, out, descriptor)
            reader = threading.Thread(target=self._show, args=shown)
            reader.start()
            readers.append(reader)
        self._readers += readers
        threading.Thread(target=self._await, args=(member, readers), daemon=True).start()

    def run(self) -> int:
        """Coordinate to the end; return the exit code."""
        before = {
            number: signal.signal(number, self._signalled)
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        try:
            for member in self._first:
                self._start(member)
            while any(it.code is None for it in self.members):
                dues = [due for due, _ in self._due]
                limits = [it for it in (self._until, self._slow_at, *dues) if it is not None]
                left = max(min(limits) - time.monotonic(), 0) if limits else None
                for key, _ in self._selector.select(left):
                    self._read(key.data)
                self._note_signals()
                self._note_printed()
                for member in self.members:
                    if member.ending is not None and member.code is None:
                        self._note_end(member, member.ending)
                self._note_events()
                if self._signals or self._is_over:
                    self._tell_end()
                self._answer()
                self._look_at_clock()
            self._note_signals()
            self._tell_end()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            self._note_signals()
            # Nothing is left after an error of the coordinator.
            self._send(signal.SIGKILL)
            if self._rti is not None:
                self._end(self._rti)
            self._end_readers()
        return self._code()

    def _end_readers(self) -> None:
        """Show what processes have printed last: others that they have started may go on."""
        until = time.monotonic() + LINES_S
        for reader in self._readers:
            reader.join(max(until - time.monotonic(), 0))
        os.close(self._pipe[1])
        for reader in self._readers:
            reader.join()
        os.close(self._pipe[0])

    def _look_at_clock(self) -> None:
        """Do what is due by now."""
        now = time.monotonic()
        if self._until is not None and now >= self._until:
            self._until = None
            for member in self.members:
                if member.code is None:
                    text = f"has not ended for {PATIENCE_S:g} s, so it is killed"
                    _tell_of(member, f"process {text} [pid {member.process.pid}]")
            self._printed.clear()
            self._functions.until = now + PATIENCE_S
            self._send(signal.SIGKILL)
        for due, member in [it for it in self._due if now >= it[0]]:
            # What another one starts may end the launch.
            if (due, member) in self._due:
                self._due.remove((due, member))
                self._start(member)
        if self._slow_at is not None and now >= self._slow_at:
            self._slow_at = None
            self._name_the_slow()

    def _end(self, rti: _hprm.LocalRti) -> None:
        """End what is left when the scripts have ended; make the trace of what they have done."""
        if self._logical_trace is not None and self._hub is not None:
            # Its share is whole then.
            rti.request_stop()
            self._hub.join(PATIENCE_S)
        rti.abort()
        rti.wait()
        if self._hub is not None:
            # Python cannot end in order while it runs.
            self._hub.join(PATIENCE_S)
        try:
            rti.merge_shares(bool(self._signals), self._code())
        except RuntimeError as error:
            print(f"error: {error}", file=sys.stderr)
            self._is_refused = True

    def _code(self) -> int:
        if self._signals:
            return 128 + self._signals
        if self._is_refused:
            return 1
        return self._failed or next((it.code for it in self.members if it.code), 0)

    def _read(self, member: Member | None) -> None:
        if member is None:
            self._wakes.recv(1 << 10)
        elif not member.read():
            self._selector.unregister(member.connection)

    # Meeting.

    def _answer(self) -> None:
        """Answer what scripts have asked, as far as that is known."""
        members = [
            it
            for it in self.members
            if it.is_member and it.is_started and it.code is None and not it.has_left
        ]
        if self._rti is not None and self._graph is not None:
            self._answer_again(self._rti, self._graph, members)
            return
        if self._rti is not None or self._is_refused or not members:
            return
        endpoints = [endpoint for it in self.members for endpoint in it.endpoints]
        for member in members:
            if member.looks_for and matched(member.looks_for, endpoints):
                member.looks_for = None
                member.answer({"found": True})
        if not all(it.is_ready or it.looks_for for it in members):
            return
        for member in members:
            if member.looks_for and not member.is_ready:
                # Nothing that runs serves it; the script may have more to declare.
                member.looks_for = None
                member.answer({"found": False})
                return
        self._begin(members)

    def _answer_again(self, rti: _hprm.LocalRti, graph: Graph, members: list[Member]) -> None:
        """Answer scripts that come back to a federation that runs."""
        for member in members:
            if member.looks_for:
                endpoints = [endpoint for it in members for endpoint in it.endpoints]
                member.answer({"found": bool(matched(member.looks_for, endpoints))})
                member.looks_for = None
            if member.is_ready and not member.is_answered and self._is_failed:
                self._reject(member)
            elif member.is_ready and not member.is_answered:
                self._admit(rti, graph, member)

    def _admit(self, rti: _hprm.LocalRti, graph: Graph, member: Member) -> None:
        """Let a script join the federation."""
        member.is_answered = True
        member.answer(
            {
                "graph": graph.document(),
                "name": member.name,
                "delay_ns": member.delay_ns if member.lives == 0 else 0,
                "is_fast": self._is_fast,
                "joining": _joining(rti, member.name),
            }
        )

    def _reject(self, member: Member) -> None:
        """End a script that has come too late."""
        member.is_answered = member.is_stranded = True
        member.answer({})
        member.process.send_signal(signal.SIGTERM)
        self._failed = self._failed or 1
        write_line(
            f"error: {member.label} cannot take part: its federation has ended, as a script has"
            " died that was there from the start\n"
            "  hint: a node with respawn=True comes back, and the others go on",
            sys.stderr,
        )

    def _name_the_slow(self) -> None:
        """Name the scripts without which the others do not begin."""
        members = [it for it in self.members if it.is_member and it.is_started and it.code is None]
        waits = [it for it in members if not it.is_ready and not it.looks_for and not it.has_left]
        if self._rti is None and not self._is_refused and waits:
            names = ", ".join(it.label for it in waits)
            write_line(
                f"warning: scripts begin when all of them spin, and wait for: {names}\n"
                "  hint: a script spins with rclpy.spin(), or another call of rclpy that waits",
                sys.stderr,
            )

    def _begin(self, members: list[Member]) -> None:
        scripts = [
            Script(it.name, tuple(it.nodes), tuple(it.endpoints), it.is_transient) for it in members
        ]
        # What starts later says then what it has.
        scripts += [
            Script(it.name, (), (), is_transient=True)
            for it in self.members
            if it.is_member and not it.is_started
        ]
        wrong = mismatches(scripts)
        if wrong:
            self._refuse(members, wrong)
            return
        self._slow_at = None
        bridge = self._bridge
        graph = Graph(scripts, bridge is not None, bridge is not None and bridge.is_aligned)
        address = f"unix:@hprm-{secrets.token_hex(8)}-rti"
        federation = Scripts(graph, self._is_fast)
        if self._bridge is not None:
            federation.hub.bridge = self._bridge
            self._bridge.join(graph)
        declared = Declared(federation)
        try:
            rti = _hprm.start_rti(
                declared,
                address,
                properties(self._is_fast),
                self._take_event,
                logical_trace=self._logical_trace,
            )
        except RuntimeError as error:
            self._refuse(members, [str(error).removeprefix("error: ")])
            return
        self._rti = rti
        self._graph = graph
        for member in members:
            self._admit(rti, graph, member)
        if graph.has_hub:
            hub: tuple[Any, ...] = (declared, "hub", _joining(rti, "hub"), [], self._is_fast)
            self._hub = threading.Thread(target=run_member, args=hub, name="hub", daemon=True)
            self._hub.start()

    def _refuse(self, members: list[Member], wrong: list[str]) -> None:
        """End the scripts before anything begins, because of what is wrong."""
        for text in wrong:
            print(f"error: {text}", file=sys.stderr)
        # What the scripts say of that follows from it.
        self._is_refused = True
        for member in members:
            member.answer({})
        self._stop(signal.SIGTERM)

    # Ends.

    def _await(self, member: Member, readers: list[threading.Thread]) -> None:
        ending = member.process.wait()
        if self._following is not None and self._following.looks_at_output:
            # What follows of the last lines comes first; a process of it may keep the pipes open.
            for reader in readers:
                reader.join(LINES_S)
        member.ending = ending
        self._wake()

    def _note_end(self, member: Member, ending: int) -> None:
        """Note how a process has ended, and what follows for the others."""
        # What it has told last.
        member.read()
        if self._is_over and ending in (-signal.SIGINT, 128 + signal.SIGINT):
            # It was interrupted because another one has done its work: that is how it should end.
            ending = 0
        member.code = 128 - ending if ending < 0 else ending
        is_expected = self._signals or self._is_refused
        comes_back = member.may_respawn() and not (is_expected or self._is_over)
        if member.code and not (member.is_stranded or is_expected or self._is_wrong):
            if not comes_back:
                self._failed = self._failed or member.code
            command = " ".join(map(str, member.process.args))  # type: ignore[arg-type]
            number = member.process.pid
            text = f"process has died [pid {number}, exit code {ending}, cmd '{command}']."
            _tell_of(member, text)
        for text in member.plan.farewell if not is_expected else ():
            write_line(text, sys.stdout)
        if self._following is not None:
            self._note_printed()
            self._follow(self._following.exited(member, ending))
        if self._bridge is not None:
            self._bridge.leave(member.name)
        if comes_back and not member.is_required:
            assert member.plan.respawn is not None
            member.code = member.ending = None
            self._due.append((time.monotonic() + member.plan.respawn.delay, member))
            return
        if member.is_required and not self._signals:
            self._is_over = True
            self._stop(signal.SIGINT)

    def _take_event(self, kind: str, name: str, text: str, seconds: float) -> None:
        """Keep what the RTI tells in its thread."""
        self._told.append((kind, name, text, seconds))
        self._wake()

    def _note_events(self) -> None:
        """Tell what the RTI has told of federates, as far as no process does."""
        labels = {it.name: it.label for it in self.members}
        scripts = () if self._graph is None else self._graph.scripts
        # The others go on without them.
        comes_back = {it.name for it in scripts if it.is_transient}
        while self._told:
            kind, name, text, seconds = self._told.popleft()
            label = labels.get(name, name)
            if kind in ("lost", "failed") and name not in comes_back:
                self._is_failed = True
            if kind == "lost":
                if name not in comes_back:
                    self._lost.append(name)
            elif kind == "silent":
                after = f"for {seconds:.3g} s; scripts that need its messages wait"
                write_line(f"warning: {label} has not answered {after}", sys.stderr)
            elif kind == "answers":
                write_line(f"{label} answers again, after {seconds:.1f} s", sys.stderr)
            elif kind == "refused" and not (self._signals or self._is_over):
                write_line(f"error: {label} cannot take part: {text}", sys.stderr)
            elif kind != "refused" and name not in labels:
                # A script says itself why it has failed.
                write_line(text, sys.stderr)
        if self._signals or self._is_over:
            # Their ends are what was asked for.
            return
        for member in self.members:
            if member.name in self._lost and member.code == 0:
                self._lost.remove(member.name)
                self._failed = self._failed or 1
                write_line(f"error: {member.label} {WITHOUT_LEAVING}", sys.stderr)

    def _signalled(self, number: int, _frame: object) -> None:
        """Note a signal: this may run in the middle of anything."""
        if self._functions.is_again():
            return
        if self._functions.note(number):
            self._wake()
        self._functions.interrupt()

    def _note_signals(self) -> None:
        """Send the first signal to all processes; the next one ends all at once."""
        while self._functions.came:
            number = self._functions.came.popleft()
            first = self._signals == 0
            self._signals = number
            self._stop(signal.Signals(number) if first else signal.SIGKILL)

    def _wake(self) -> None:
        """Have the coordinator look at what has happened, from another thread or a signal."""
        # If there is no room, it is being woken.
        with contextlib.suppress(BlockingIOError):
            self._wakeup.send(b"\0")

    def _stop(self, number: signal.Signals) -> None:
        self._until = self._functions.until = time.monotonic() + PATIENCE_S
        # What waits to come back does not.
        for _, member in self._due:
            member.code = 0
        self._due.clear()
        self._send(number)

    def _send(self, number: signal.Signals) -> None:
        for member in self.members:
            if member.is_started and member.ending is None and member.code is None:
                member.process.send_signal(number)

    # What follows of that, in a launch.

    def _follow(self, answer: Answer) -> None:
        """Say, start and end what follows of something."""
        for text in answer.says:
            write_line(text, sys.stdout)
        for plan, seconds, where in answer.starts:
            if not (self._signals or self._is_over or self._is_refused or answer.wrong):
                self._start_later(plan, seconds, where, answer)
        if answer.wrong is not None and not self._is_wrong:
            self._is_wrong = True
            write_line(f"error: {answer.wrong}", sys.stderr)
            self._failed = self._failed or 1
        if (answer.ends or answer.wrong is not None) and not (self._signals or self._is_over):
            self._is_over = True
            self._stop(signal.SIGINT)

    def _start_later(self, plan: Plan, seconds: float, where: str | None, answer: Answer) -> None:
        """Start a process after some seconds; tell in the answer if there is no place for it.

        A function of the handler that is stated asks for it, if one is.
        """
        if where is not None:
            self._called = [it for it in self._called if it.code is None]
            if len(self._called) >= AT_ONCE:
                answer.wrong = f"{where}: {plan.name} is not started: {_TOO_MANY}"
                return
        free = [it for it in self.members if not it.is_started and it.code == 0]
        member = next((it for it in free if it.plan is plan), None)
        if member is None and plan.is_member and (self._is_fast or self._graph is not None):
            member = next((it for it in free if it.plan is SPARE), None)
            if member is None:
                before = "" if where is None else f"{where}: "
                answer.wrong = f"{before}{plan.name} is not started: {_NO_PLACE[self._is_fast]}"
                return
            member.plan = plan
        member = member or self._add(plan)
        member.code, member.is_transient = None, True
        if where is not None:
            self._called.append(member)
        self._due.append((time.monotonic() + seconds, member))

    def _note_printed(self) -> None:
        """Find out what follows of lines that were printed."""
        while self._printed and self._following is not None and not self._is_urgent():
            self._follow(self._following.printed(*self._printed.popleft()))

    def _is_urgent(self) -> bool:
        """Whether a signal has come, or processes are to be killed by now."""
        is_late = self._until is not None and time.monotonic() >= self._until
        return is_late or bool(self._functions.came)

    def _tell_end(self) -> None:
        """Find out, once, what follows of the end of the launch."""
        if self._following is None or self._has_told_end:
            return
        self._has_told_end = True
        reason = "idle"
        if self._signals:
            reason = f"signal {signal.Signals(self._signals).name}"
        elif self._is_over:
            reason = "a process has ended that ends the launch"
        self._follow(self._following.shut_down(reason, self._signals == signal.SIGINT))

    def _show(self, member: Member, stream: IO[bytes], out: Any, descriptor: int) -> None:
        """Show what a script prints, with its name before each line."""
        for line in lines_of(stream.fileno(), self._pipe[0]):
            if self._following is not None and self._following.looks_at_output:
                self._printed.append((member, line, descriptor))
                self._wake()
            text = line.decode(errors="replace").rstrip("\n")
            if self._is_refused:
                continue
            write_line(f"[{member.label}] {text}", out)


def _tell_of(member: Member, text: str) -> None:
    """Tell what is wrong with a process, as ``ros2 launch`` does."""
    write_line(f"[ERROR] [{member.label}]: {text}", sys.stderr)


def _joining(rti: _hprm.LocalRti, name: str) -> dict[str, Any]:
    """What a federate needs to know to join."""
    joining: dict[str, Any] = {"rti": rti.address, "federation": rti.federation}
    share = rti.share(name)
    if share is not None:
        # Its process may have another working directory.
        joining |= {"logical_trace": os.path.abspath(share[0]), "share_of": str(share[1])}
    return joining


def coordinate(
    plans: Sequence[Plan],
    settings: Settings | None = None,
    logical_trace: str | None = None,
    *,
    is_fast: bool = False,
    following: Following | None = None,
) -> int:
    """Run scripts as one federation, perhaps with a bridge, and return the exit code."""
    rest: dict[str, Any] = {"logical_trace": logical_trace, "following": following}
    if settings is None:
        return Coordinator(plans, is_fast=is_fast, **rest).run()
    try:
        session = open_session(settings.endpoint, lambda text: print(text, file=sys.stderr))
    except BridgeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    from hprm.ros._zenoh.bridge import ZenohBridge

    find_beside([it.script for it in plans if it.script is not None])
    bridge = ZenohBridge(session, settings)
    try:
        return Coordinator(plans, bridge, **rest).run()
    finally:
        bridge.close()
