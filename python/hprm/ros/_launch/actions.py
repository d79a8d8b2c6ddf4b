"""What a launch does, as in ``launch.actions``."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from hprm.ros._launch._entities import (
    Action,
    Condition,
    LaunchContext,
    LaunchDescriptionEntity,
    Pair,
    SomeText,
    checked,
    flag,
    named,
    normalized,
    number,
    perform,
    shown,
    visit,
)
from hprm.ros._launch._plans import ArgumentPlan, LaunchError, NodePlan, ProcessPlan, Respawn
from hprm.ros._launch._reactions import listed, place
from hprm.ros._launch.event_handlers import EventHandler, OnProcessExit
from hprm.ros._launch.events import Shutdown as _ShutdownEvent
from hprm.ros._launch.launch_description_sources import (
    LaunchDescriptionSource,
    PythonLaunchDescriptionSource,
    being_read,
)


class DeclareLaunchArgument(Action):
    """An argument that the command line may give, or the launch file that includes this one."""

    def __init__(
        self,
        name: str,
        *,
        default_value: SomeText | None = None,
        description: str | None = None,
        choices: Iterable[str] | None = None,
        condition: Condition | None = None,
    ) -> None:
        """Take the name, what counts if it is not given, and what it may be."""
        super().__init__(condition=condition)
        self.name = name
        self.default_value = None if default_value is None else normalized(default_value)
        self.description = description
        self.choices = None if choices is None else list(choices)

    def describe(self) -> str:
        """Return what it is, with its name."""
        return named(self, name=self.name)

    def execute(self, context: LaunchContext) -> None:
        """Set the configuration; raise ``LaunchError`` if there is no value, or a wrong one."""
        default = None if self.default_value is None else perform(context, self.default_value)
        context.plan.known.add(self.name)
        context.plan.arguments.append(
            ArgumentPlan(self.name, default, self.description, self.choices)
        )
        if self.name not in context.launch_configurations:
            if default is None and context.finds_arguments:
                return
            if default is None:
                raise LaunchError(
                    f"required launch argument '{self.name}' was not provided"
                    f"{self.description and f' (description: {self.description})' or ''}: "
                    f"add {self.name}:=VALUE"
                )
            context.launch_configurations[self.name] = default
        value = context.launch_configurations[self.name]
        if self.choices is not None and value not in self.choices:
            raise LaunchError(
                f"launch argument '{self.name}' is '{value}': it has to be one of "
                f"{', '.join(self.choices)}"
            )


class SetLaunchConfiguration(Action):
    """A value for a configuration."""

    def __init__(
        self, name: SomeText, value: SomeText, *, condition: Condition | None = None
    ) -> None:
        """Take name and value."""
        super().__init__(condition=condition)
        self.name, self.value = name, value

    def execute(self, context: LaunchContext) -> None:
        """Set it."""
        context.launch_configurations[perform(context, self.name)] = perform(context, self.value)


class UnsetLaunchConfiguration(Action):
    """No value for a configuration."""

    def __init__(self, name: SomeText, *, condition: Condition | None = None) -> None:
        """Take the name."""
        super().__init__(condition=condition)
        self.name = name

    def execute(self, context: LaunchContext) -> None:
        """Remove it."""
        context.launch_configurations.pop(perform(context, self.name), None)


class SetEnvironmentVariable(Action):
    """A value for a variable of the environment of processes that come later."""

    def __init__(
        self, name: SomeText, value: SomeText, *, condition: Condition | None = None
    ) -> None:
        """Take name and value."""
        super().__init__(condition=condition)
        self.name, self.value = name, value

    def execute(self, context: LaunchContext) -> None:
        """Set it."""
        context.environment[perform(context, self.name)] = perform(context, self.value)


class UnsetEnvironmentVariable(Action):
    """No such variable in the environment of processes that come later."""

    def __init__(self, name: SomeText, *, condition: Condition | None = None) -> None:
        """Take the name."""
        super().__init__(condition=condition)
        self.name = name

    def execute(self, context: LaunchContext) -> None:
        """Set it to an empty text, which is what the processes get."""
        context.environment[perform(context, self.name)] = ""


class AppendEnvironmentVariable(Action):
    """More of a variable of the environment, such as ``PATH``."""

    def __init__(
        self,
        name: SomeText,
        value: SomeText,
        prepend: bool | SomeText = False,
        separator: SomeText = os.pathsep,
        *,
        condition: Condition | None = None,
    ) -> None:
        """Take name and value; it comes behind what is there, unless ``prepend``."""
        super().__init__(condition=condition)
        self.name, self.value = name, value
        self.prepend, self.separator = prepend, separator

    def execute(self, context: LaunchContext) -> None:
        """Add it."""
        name = perform(context, self.name)
        parts = [context.environment.get(name, ""), perform(context, self.value)]
        if flag(context, self.prepend, "prepend"):
            parts.reverse()
        context.environment[name] = perform(context, self.separator).join(filter(None, parts))


class GroupAction(Action):
    """Several actions; what they set counts among them only, unless ``scoped`` is false."""

    def __init__(
        self,
        actions: Iterable[LaunchDescriptionEntity],
        *,
        scoped: bool = True,
        forwarding: bool = True,
        launch_configurations: Mapping[Any, Any] | None = None,
        condition: Condition | None = None,
    ) -> None:
        """Take the actions, and configurations for them."""
        super().__init__(condition=condition)
        self.actions = list(actions)
        self._scoped, self._forwarding = scoped, forwarding
        self._configurations = dict(launch_configurations or {})

    def execute(self, context: LaunchContext) -> None:
        """Visit the actions."""
        configurations = {
            perform(context, name): perform(context, value)
            for name, value in self._configurations.items()
        }
        if not self._scoped:
            self._visit_all(context, configurations)
            return
        with context.scope(forwarding=self._forwarding):
            self._visit_all(context, configurations)

    def _visit_all(self, context: LaunchContext, configurations: dict[str, str]) -> None:
        context.launch_configurations.update(configurations)
        for action in self.actions:
            visit(action, context)


class IncludeLaunchDescription(Action):
    """Another launch file. As in ROS 2, the arguments stay set behind it; a group limits them."""

    def __init__(
        self,
        launch_description_source: LaunchDescriptionSource | SomeText,
        *,
        launch_arguments: Iterable[Pair] | None = None,
        condition: Condition | None = None,
    ) -> None:
        """Take the file and its arguments."""
        super().__init__(condition=condition)
        if not isinstance(launch_description_source, LaunchDescriptionSource):
            launch_description_source = PythonLaunchDescriptionSource(launch_description_source)
        self.launch_description_source = launch_description_source
        self.launch_arguments = list(launch_arguments or ())

    def describe(self) -> str:
        """Return what it is, with its file."""
        return named(self, file=self.launch_description_source.location)

    def execute(self, context: LaunchContext) -> None:
        """Evaluate the file, in its own folder."""
        arguments = [
            (perform(context, name), perform(context, value))
            for name, value in self.launch_arguments
        ]
        file = self.launch_description_source.path(context)
        if file is not None and file in context.including:
            chain = " -> ".join(str(one) for one in (*context.including, file))
            raise LaunchError(f"launch files include one another: {chain}")
        context.launch_configurations.update(arguments)
        outer, including = context.file, context.including
        description = self.launch_description_source.get_launch_description(context)
        if file is not None:
            context.file, context.including = file, (*including, file)
        visit(description, context)
        # Not after an error: then the context tells in which file it was.
        context.file, context.including = outer, including


class TimerAction(Action):
    """Actions after a time."""

    def __init__(
        self,
        *,
        period: float | SomeText,
        actions: Iterable[LaunchDescriptionEntity],
        cancel_on_shutdown: bool | SomeText = True,
        condition: Condition | None = None,
    ) -> None:
        """Take the time in seconds, and the actions then."""
        super().__init__(condition=condition)
        self.period = period
        self.actions = list(actions)

    def execute(self, context: LaunchContext) -> None:
        """Visit the actions: their processes start later."""
        seconds = number(context, self.period, "the period of a timer")
        outer, context.delay = context.delay, context.delay + seconds
        for action in self.actions:
            visit(action, context)
        context.delay = outer


class OpaqueFunction(Action):
    """A function that gets the context, and may return actions."""

    def __init__(
        self,
        *,
        function: Callable[..., Iterable[LaunchDescriptionEntity] | None],
        args: Iterable[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        condition: Condition | None = None,
    ) -> None:
        """Take the function and its arguments."""
        super().__init__(condition=condition)
        self._function = function
        self._args, self._kwargs = tuple(args or ()), dict(kwargs or {})

    def execute(self, context: LaunchContext) -> Iterable[LaunchDescriptionEntity] | None:
        """Call the function."""
        with being_read(context.file):
            return self._function(context, *self._args, **self._kwargs)


class OpaqueCoroutine(Action):
    """Not supported: a launch is evaluated before it runs."""

    def __init__(self, **kwargs: Any) -> None:
        """Raise ``LaunchError``."""
        raise LaunchError("OpaqueCoroutine is not supported: use OpaqueFunction")


class LogInfo(Action):
    """A message."""

    def __init__(self, *, msg: SomeText, condition: Condition | None = None) -> None:
        """Take the message."""
        super().__init__(condition=condition)
        self.msg = normalized(msg)

    def execute(self, context: LaunchContext) -> None:
        """Add the message to the plan."""
        context.plan.messages.append(perform(context, self.msg))


class Shutdown(Action):
    """The end of the launch, when something happens."""

    def __init__(
        self, *, reason: SomeText = "reason not given", condition: Condition | None = None
    ) -> None:
        """Say why."""
        super().__init__(condition=condition)
        self.reason = reason

    def execute(self, context: LaunchContext) -> None:
        """End the launch when something happens; one that ends at once starts nothing.

        Raises ``LaunchError`` if that is not later, or at a time instead.
        """
        if context.is_later and not context.delay:
            context.plan.ends = True
            return
        if context.delay:
            raise LaunchError(
                "Shutdown() in a TimerAction is not supported: end the launch when a process ends,"
                " as of ExecuteProcess(cmd=['sleep', '10'], on_exit=Shutdown())"
            )
        raise LaunchError(
            f"the launch ends before it starts anything: {perform(context, self.reason)}"
        )


class EmitEvent(Shutdown):
    """An event, which can only be ``Shutdown``."""

    def __init__(self, *, event: Any, condition: Condition | None = None) -> None:
        """Take the event."""
        if not isinstance(event, _ShutdownEvent):
            raise LaunchError(
                f"{place()}: EmitEvent of {shown(event)} is not supported: only of Shutdown()"
            )
        super().__init__(reason=event.reason, condition=condition)


class RegisterEventHandler(Action):
    """What is done when something happens; see ``launch.event_handlers`` for what is supported."""

    def __init__(self, event_handler: EventHandler, *, condition: Condition | None = None) -> None:
        """Take the handler."""
        super().__init__(condition=condition)
        if not isinstance(event_handler, EventHandler):
            raise LaunchError(
                f"{place()}: RegisterEventHandler takes a handler such as OnProcessExit, not"
                f" {shown(event_handler)}"
            )
        self.event_handler = event_handler

    def execute(self, context: LaunchContext) -> None:
        """Add to the plan what the handler asks for."""
        try:
            self.event_handler.register(context)
        except LaunchError as error:
            where, text = self.event_handler.place, str(error)
            if where.rpartition(":")[0] in text:
                raise
            raise type(error)(f"{where}: {text}") from None


class ExecuteProcess(Action):
    """Another program.

    Of the arguments of ``launch.actions.ExecuteProcess``, those that concern signals and formats
    of output have no effect: the launcher decides that.
    """

    _IGNORED = frozenset(
        ("cached_output", "emulate_tty", "log_cmd", "output_format")
        + ("sigkill_timeout", "sigterm_timeout")
    )

    def __init__(
        self,
        *,
        cmd: Iterable[SomeText],
        name: SomeText | None = None,
        cwd: SomeText | None = None,
        env: Mapping[Any, Any] | None = None,
        additional_env: Mapping[Any, Any] | None = None,
        condition: Condition | None = None,
        **options: Any,
    ) -> None:
        """Take the command: each element is one word of it."""
        super().__init__(condition=condition)
        self.cmd = [normalized(word) for word in cmd]
        self._name, self.cwd = name, cwd
        self.env, self.additional_env = env, additional_env
        self._variables = {**dict(env or {}), **dict(additional_env or {})}
        self.shell = options.pop("shell", False)
        self._output = options.pop("output", "log")
        self._respawn = options.pop("respawn", False)
        self._respawn_delay = options.pop("respawn_delay", None) or 0.0
        self._respawn_retries = options.pop("respawn_max_retries", -1)
        self._prefix = options.pop("prefix", None)
        self._on_exit = options.pop("on_exit", None)
        self._place = "" if self._on_exit is None else place()
        if not callable(self._on_exit):
            self._on_exit = checked(listed(self._on_exit), self._place) or None
        unknown = sorted(set(options) - self._IGNORED)
        if unknown:
            raise TypeError(f"{type(self).__name__} has no argument {', '.join(unknown)}")

    def execute(self, context: LaunchContext) -> None:
        """Add the process to the plan: a program of a package is a node."""
        if context.finds_arguments or self._program(context):
            return
        command = [perform(context, word) for word in self.cmd]
        shell = flag(context, self.shell, "shell")
        if self._prefix is not None:
            command = shlex.split(perform(context, self._prefix)) + command
        folder = None if self.cwd is None else Path(perform(context, self.cwd))
        name = None if self._name is None else perform(context, self._name)
        self._start(context, ProcessPlan(command, name, folder=folder, shell=shell))

    def _program(self, context: LaunchContext) -> bool:
        """Add a node if the command begins with a program of a package, or with ``ros2 run``."""
        from hprm.ros._launch_ros.actions import Node
        from hprm.ros._launch_ros.substitutions import ExecutableInPackage

        if not self.cmd or self._prefix is not None:
            return False
        first = self.cmd[0][0] if len(self.cmd[0]) == 1 else None
        if isinstance(first, ExecutableInPackage):
            package, executable, arguments = first.package, first.executable, self.cmd[1:]
        elif [perform(context, word) for word in self.cmd[:2]] == ["ros2", "run"]:
            if len(self.cmd) < 4:
                raise LaunchError("ros2 run needs a package and a program of it")
            package, executable, arguments = self.cmd[2], self.cmd[3], self.cmd[4:]
        else:
            return False
        node = Node(package=package, executable=executable, arguments=arguments)
        node._variables, node._output = self._variables, self._output
        node._respawn, node._on_exit, node._place = self._respawn, self._on_exit, self._place
        node._respawn_delay, node._respawn_retries = self._respawn_delay, self._respawn_retries
        node.execute(context)
        # A handler that waits for this action means the node.
        context.started.append((self, context.plan.processes[-1]))
        return True

    def _start(self, context: LaunchContext, plan: NodePlan | ProcessPlan) -> None:
        """Fill in what nodes and other programs have in common, and add the plan."""
        plan.environment = changed_environment(context) | {
            perform(context, name): perform(context, value)
            for name, value in self._variables.items()
        }
        plan.delay = context.delay
        plan.output = self._output if isinstance(self._output, str) else "screen"
        if flag(context, self._respawn, "respawn"):
            delay = number(context, self._respawn_delay, "respawn_delay")
            retries = number(context, self._respawn_retries, "respawn_max_retries")
            plan.respawn = Respawn(delay, int(retries))
        context.plan.processes.append(plan)
        context.started.append((self, plan))
        if self._on_exit is not None:
            handler = OnProcessExit(target_action=self, on_exit=self._on_exit)
            handler.place = self._place
            handler.register(context)


def changed_environment(context: LaunchContext) -> dict[str, str]:
    """Return the variables that the launch has set, or set differently."""
    return {
        name: value for name, value in context.environment.items() if os.environ.get(name) != value
    }


#: A process of this machine, which is what all are.
ExecuteLocal = ExecuteProcess
