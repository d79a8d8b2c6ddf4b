"""What follows in a launch when its processes start, print and end, for the coordinator."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from hprm.ros._functions import Functions, Interrupted, Late
from hprm.ros._launch._evaluate import note_exits
from hprm.ros._launch._plans import LaunchError, LaunchPlan, NodePlan, ProcessPlan
from hprm.ros._launch._reactions import Kind, Reaction
from hprm.ros._launch.events import ExecutionComplete, Shutdown
from hprm.ros._launch.events.process import ProcessExited, ProcessIO, ProcessStarted
from hprm.ros._members import NO_NODES_IF_FAST, Member, Plan
from hprm.ros._turns import of_scripts

Stated = NodePlan | ProcessPlan


@dataclass
class Answer:
    """What the coordinator has to do."""

    #: What is said.
    says: list[str] = field(default_factory=list)
    #: What is started, after how many seconds, and where the handler is whose function says so.
    starts: list[tuple[Plan, float, str | None]] = field(default_factory=list)
    #: Whether the launch ends.
    ends: bool = False
    #: What is wrong, so that the launch ends.
    wrong: str | None = None
    #: Whether a signal has come, so that no more functions are called for this.
    is_interrupted: bool = False


class Following:
    """The reactions of a launch.

    Parameters
    ----------
    launch
        What the launch file asks for.
    make
        Makes the plan of a process.

    Raises
    ------
    LaunchError
        If something cannot be started that follows later.

    """

    def __init__(self, launch: LaunchPlan, make: Callable[[Stated], Plan]) -> None:
        """Make the plans of what is known before."""
        self._launch, self._make = launch, make
        #: Calls all functions of the launch file.
        self.functions = Functions()
        self._stated: dict[int, Stated] = {}
        self._made: dict[int, Plan] = {}
        #: The actions that have started their processes, and where handlers start what.
        self._begun: list[Any] = []
        self._places: dict[int, str] = {}
        #: What starts first.
        self.first = [self._plan(it, is_later=False) for it in launch.processes]
        for it in launch.processes:
            self._begin(it, "")
        #: What may start later, as far as that is known.
        self.later: list[Plan] = []
        for reaction in launch.reactions:
            if reaction.plan is not None and not reaction.is_over:
                for it in reaction.plan.processes:
                    self._check(it, reaction.place)
                    self.later.append(self._plan(it))
                    self._places[id(self.later[-1])] = reaction.place

    @property
    def calls(self) -> bool:
        """Whether functions decide what else may start."""
        return any(it.plan is None for it in self._launch.reactions)

    @property
    def looks_at_output(self) -> bool:
        """Whether something follows from what processes print."""
        return any(it.kind == "output" and not it.is_over for it in self._launch.reactions)

    def refuse_fast(self) -> None:
        """Raise a ``LaunchError`` if a node starts later: it would read the clock."""
        for plan in self.later:
            if plan.is_member:
                raise LaunchError(f"{self._places[id(plan)]}: {NO_NODES_IF_FAST}")

    def started(self, member: Member) -> Answer:
        """Answer that a process has started."""
        return self._answer(
            "start", member, lambda action: ProcessStarted(**_facts(member, action))
        )

    def exited(self, member: Member, code: int) -> Answer:
        """Answer that a process has ended, with a code as ``subprocess`` has it."""
        answer = self._answer(
            "exit",
            member,
            lambda action: ProcessExited(returncode=code, **_facts(member, action)),
        )
        if not member.may_respawn():
            self._answer(
                "complete", member, lambda action: ExecutionComplete(action=action), answer
            )
        return answer

    def printed(self, member: Member, text: bytes, descriptor: int) -> Answer:
        """Answer that a process has printed a line."""
        return self._answer(
            "output",
            member,
            lambda action: ProcessIO(text=text, fd=descriptor, **_facts(member, action)),
        )

    def shut_down(self, reason: str, by_signal: bool) -> Answer:
        """Answer that the launch ends."""
        event = Shutdown(reason=reason, due_to_sigint=by_signal)
        answer = Answer()
        for reaction in list(self._launch.reactions):
            if reaction.kind == "shutdown" and not (reaction.is_over or answer.is_interrupted):
                reaction.is_over = True
                self._add(answer, reaction, event)
        return answer

    def _plan(self, stated: Stated, *, is_later: bool = True) -> Plan:
        # The coordinator looks after the delay of what starts later.
        made = self._make(replace(stated, delay=0.0) if is_later else stated)
        self._stated[id(made)], self._made[id(stated)] = stated, made
        return made

    def _begin(self, stated: Stated, where: str) -> None:
        self._check(stated, where)
        self._begun += [action for action, it in self._launch.started if it is stated]

    def _check(self, stated: Stated, where: str) -> None:
        """Raise a ``LaunchError`` if the action of a process has started one before."""
        for action, it in self._launch.started:
            if it is stated and any(action is other for other in self._begun):
                raise LaunchError(
                    f"{where}: the process '{_name(stated)}' was started before: an action starts"
                    " one once"
                )

    def _answer(
        self,
        kind: Kind,
        member: Member,
        event: Callable[[Any], Any],
        answer: Answer | None = None,
    ) -> Answer:
        """Answer an event of a process, in addition to what has been answered before."""
        answer = answer or Answer()
        stated = self._stated.get(id(member.plan))
        actions = [action for action, it in self._launch.started if it is stated]
        for reaction in list(self._launch.reactions):
            if answer.wrong is not None or answer.is_interrupted:
                break
            if reaction.kind != kind or reaction.is_over:
                continue
            try:
                found = self.functions.call(_counted, reaction, actions)
            except BaseException as error:
                _note(answer, error, reaction.place)
                continue
            if found is not None:
                reaction.is_over = reaction.once
                self._add(answer, reaction, event(found))
        return answer

    def _add(self, answer: Answer, reaction: Any, event: Any) -> None:
        known = len(self._launch.started)
        try:
            follows = self.functions.call(reaction.answer, event)
            for action, stated in self._launch.started[known:]:
                note_exits(self._launch, action, stated)
            for it in follows.processes:
                self._begin(it, reaction.place)
                made = self._made.get(id(it)) or self._plan(it)
                where = reaction.place if reaction.plan is None else None
                answer.starts.append((made, it.delay, where))
            if follows.processes and reaction.kind == "shutdown":
                raise LaunchError("nothing starts in OnShutdown, as in ROS 2: the launch ends")
        except BaseException as error:
            _note(answer, error, reaction.place)
            return
        answer.says += follows.messages
        answer.ends |= follows.ends


def _name(stated: Stated) -> str:
    if isinstance(stated, NodePlan):
        return stated.name or stated.executable or stated.script.stem
    return stated.name or stated.command[0]


def _facts(member: Member, action: Any) -> dict[str, Any]:
    plan = member.plan
    return {
        "action": action,
        "name": member.label,
        "cmd": list(plan.command),
        "cwd": None if plan.folder is None else str(plan.folder),
        "env": dict(plan.environment),
        "pid": member.process.pid,
    }


def _counted(reaction: Reaction, actions: list[Any]) -> Any:
    """Return the first action of which something counts for a handler, if there is one."""
    return next((it for it in actions if reaction.counts(it)), None)


def _note(answer: Answer, error: BaseException, place: str) -> None:
    """Note why a function of a launch file has not done its work."""
    if isinstance(error, Late):
        answer.wrong = f"{place}: its function goes on when the launch should have ended"
    elif isinstance(error, Interrupted):
        answer.is_interrupted = True
    else:
        # Also what is no `Exception`: only the launch file itself may end the interpreter.
        answer.wrong = _told(error, place)


def _told(error: BaseException, place: str) -> str:
    """Tell what is wrong in a function of a launch file, and where."""
    if isinstance(error, LaunchError):
        return str(error) if place in str(error) else f"{place}: {error}"
    frame = of_scripts(traceback.extract_tb(error.__traceback__))
    where = place if frame is None else f"{frame.filename}:{frame.lineno}"
    return f"{where}: {type(error).__name__}: {error}"
