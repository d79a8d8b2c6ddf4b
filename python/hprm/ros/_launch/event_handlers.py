"""What is done when something happens, as in ``launch.event_handlers``.

Actions of a handler are evaluated with the launch file: what they start is known before. What its
functions return is not, so these are called when it happens. See ``_reactions.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from hprm.ros._launch._entities import LaunchContext, checked, perform, shown, visit
from hprm.ros._launch._plans import LaunchError, LaunchPlan
from hprm.ros._launch._reactions import (
    Kind,
    Reaction,
    calling,
    listed,
    matcher,
    place,
    visited,
)


class EventHandler:
    """What is done when something happens.

    Parameters
    ----------
    handle_once
        Whether that is so the first time only.

    """

    def __init__(self, *args: Any, handle_once: bool = False, **kwargs: Any) -> None:
        """Take any other arguments: a launch that uses this class itself is refused."""
        self.handle_once = handle_once
        #: Where it is in its launch file.
        self.place = place()

    @property
    def matcher_description(self) -> str:
        """For which events it counts."""
        return "None"

    @property
    def handler_description(self) -> str:
        """What it does: actions, or functions."""
        return "None"

    def describe(self) -> tuple[str, list[Any]]:
        """Return what it is, and its actions."""
        matcher, handler = self.matcher_description, self.handler_description
        told = f"matcher='{matcher}', handler='{handler}', handle_once={self.handle_once}"
        return f"{type(self).__name__}({told})", []

    def register(self, context: LaunchContext) -> None:
        """Note what the handler asks for, or raise ``LaunchError``."""
        raise LaunchError(
            f"{self.place}: {type(self).__name__} is not supported: use OnProcessStart, "
            "OnProcessIO, OnProcessExit, OnExecutionComplete or OnShutdown"
        )


BaseEventHandler = EventHandler


class _Answering(EventHandler):
    """Actions, or a function that returns some, when something happens."""

    def __init__(self, does: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._function: Callable[..., Any] | None = does if callable(does) else None
        self._actions = [] if callable(does) else checked(listed(does), self.place)

    @property
    def handler_description(self) -> str:
        """What it does: actions, or a function."""
        return "<actions>" if self._function is None else _function(self._function)

    def describe(self) -> tuple[str, list[Any]]:
        """Return what it is, and its actions."""
        return super().describe()[0], list(self._actions)

    def _note(self, context: LaunchContext, reaction: Reaction) -> None:
        """Note a reaction that does that."""
        if self._function is None:
            plan = reaction.plan = visited(context, self._actions)
            reaction.answer = lambda event: plan
        else:
            reaction.answer = calling(context, self._function, takes_context=True)
        context.reactions.append(reaction)


class _OfProcess(_Answering):
    """The same at an event of a process."""

    kind: Kind
    #: The event, as it is called in launch.
    _event = ""

    def __init__(self, target_action: Any, does: Any, **kwargs: Any) -> None:
        from hprm.ros._launch.actions import ExecuteProcess

        super().__init__(does, **kwargs)
        self._target = target_action
        is_process = isinstance(target_action, ExecuteProcess)
        self._counts = matcher(target_action, lambda _: is_process, self.place)

    @property
    def matcher_description(self) -> str:
        """For which events it counts."""
        return _matching(self._event, self._target)

    def register(self, context: LaunchContext) -> None:
        """Note what follows."""
        reaction = Reaction(self.kind, self._counts, _nothing, self.place, self.handle_once)
        self._note(context, reaction)


class OnProcessStart(_OfProcess):
    """Actions with the start of another one."""

    kind = "start"
    _event = "ProcessStarted"

    def __init__(self, *, target_action: Any = None, on_start: Any, **kwargs: Any) -> None:
        """Take the action that is waited for, and the actions then."""
        super().__init__(target_action, on_start, **kwargs)

    def register(self, context: LaunchContext) -> None:
        """Visit the actions if their processes start together; otherwise note what follows."""
        starts = (plan for action, plan in context.started if action is self._target)
        now = [it for it in starts if any(it is other for other in context.plan.processes)]
        if self._function is None and (now or self._target is None):
            for action in self._actions:
                visit(action, context)
            return
        super().register(context)


class OnProcessExit(_OfProcess):
    """What is done at the end of the process of an action."""

    kind = "exit"
    _event = "ProcessExited"

    def __init__(self, *, target_action: Any = None, on_exit: Any, **kwargs: Any) -> None:
        """Take the action whose end counts, and the actions then."""
        super().__init__(target_action, on_exit, **kwargs)

    def register(self, context: LaunchContext) -> None:
        """Add to the plan what is said, and whether the launch ends; or note what follows."""
        is_one = self._target is not None and not callable(self._target)
        is_known = is_one and self._function is None and not self.handle_once
        found = at_exit(context, self._actions) if is_known and not context.is_later else None
        if found is not None:
            context.exits.append((self._target, *found))
        else:
            super().register(context)


class OnExecutionComplete(_OfProcess):
    """What is done when an action is over, which is when its process has ended."""

    kind = "complete"
    _event = "ExecutionComplete"

    def __init__(self, *, target_action: Any = None, on_completion: Any, **kwargs: Any) -> None:
        """Take the action whose end counts, and the actions then."""
        super().__init__(target_action, on_completion, **kwargs)


class OnProcessIO(EventHandler):
    """What is done when the process of an action has printed a line."""

    def __init__(
        self,
        *,
        target_action: Any = None,
        on_stdin: Callable[[Any], Any] | None = None,
        on_stdout: Callable[[Any], Any] | None = None,
        on_stderr: Callable[[Any], Any] | None = None,
        **kwargs: Any,
    ) -> None:
        """Take the action whose output counts, and functions that get each line."""
        from hprm.ros._launch.actions import ExecuteProcess

        super().__init__(**kwargs)
        if on_stdin is not None:
            raise LaunchError(
                f"{self.place}: OnProcessIO with on_stdin is not supported: nothing writes to"
                " processes of a launch"
            )
        is_process = isinstance(target_action, ExecuteProcess)
        self._counts = matcher(target_action, lambda _: is_process, self.place)
        self._target = target_action
        self._functions = {1: on_stdout, 2: on_stderr}
        for function in self._functions.values():
            if function is not None and not callable(function):
                raise LaunchError(
                    f"{self.place}: OnProcessIO calls functions, not {shown(function)}"
                )

    @property
    def matcher_description(self) -> str:
        """For which events it counts."""
        return _matching("ProcessIO", self._target)

    @property
    def handler_description(self) -> str:
        """What it does."""
        return ", ".join(_function(it) for it in self._functions.values() if it is not None)

    def register(self, context: LaunchContext) -> None:
        """Note what follows."""

        def call(event: Any) -> Any:
            function = self._functions[1 if event.from_stdout else 2]
            return None if function is None else function(event)

        answer = calling(context, call, takes_context=False)
        context.reactions.append(
            Reaction("output", self._counts, answer, self.place, self.handle_once)
        )


class OnShutdown(_Answering):
    """What is done when the launch ends; nothing starts then."""

    def __init__(self, *, on_shutdown: Any, **kwargs: Any) -> None:
        """Take the actions, or a function that gets the event and the context."""
        super().__init__(on_shutdown, **kwargs)

    @property
    def matcher_description(self) -> str:
        """For which events it counts."""
        return "event issubclass of launch.events.Shutdown"

    def register(self, context: LaunchContext) -> None:
        """Note what follows."""
        reaction = Reaction("shutdown", lambda action: True, _nothing, self.place, True)
        self._note(context, reaction)
        if reaction.plan is not None and reaction.plan.processes:
            raise LaunchError(
                f"{self.place}: OnShutdown starts no processes, as in ROS 2: the launch ends"
            )


def _matching(event: str, target: Any) -> str:
    """Describe which events count, as launch does."""
    if target is None:
        return f"event == {event}"
    kind = "Action" if event == "ExecutionComplete" else "ExecuteLocal"
    return f"event == {event} and {kind}(event.action)"


def _function(it: Any) -> str:
    return f"<function {getattr(it, '__qualname__', type(it).__qualname__)}>"


def _nothing(event: Any) -> LaunchPlan:
    return LaunchPlan()


def at_exit(context: LaunchContext, actions: Iterable[Any]) -> tuple[bool, list[str]] | None:
    """Return whether actions at the end of a process end the launch, and what they say.

    There is none if one of them does anything else.
    """
    from hprm.ros._launch.actions import LogInfo, Shutdown

    said: list[str] = []
    ends = False
    for action in actions:
        if not isinstance(action, Shutdown | LogInfo):
            return None
        if action.condition is not None and not action.condition.evaluate(context):
            continue
        if isinstance(action, LogInfo):
            said.append(perform(context, action.msg))
        ends = ends or isinstance(action, Shutdown)
    return ends, said
