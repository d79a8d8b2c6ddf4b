"""What a launch does with nodes, as in ``launch_ros.actions``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hprm.ros import _names
from hprm.ros._launch._entities import (
    Action,
    Condition,
    LaunchContext,
    Pair,
    SomeText,
    Substitution,
    flag,
    named,
    perform,
)
from hprm.ros._launch._packages import Program, find_program
from hprm.ros._launch._plans import LaunchError, NodePlan, Parameters
from hprm.ros._launch.actions import ExecuteProcess, TimerAction
from hprm.ros._launch_ros.parameter_descriptions import ParameterFile, evaluated, value_of
from hprm.ros._launch_ros.substitutions import ExecutableInPackage


class _NodeName(Substitution):
    """Stands for a node's name, which is known when it starts, in a description."""

    def describe(self) -> str:
        return "LocalVar('node name')"


class Node(ExecuteProcess):
    """A node: a program in Python.

    Parameters
    ----------
    executable
        The name of a program of a package; without a package, the path of a script.
    package
        The package.
    name
        The node's name, if it is another one than in the program.
    namespace
        The namespace; a relative one is below that of the group.
    exec_name
        A name for the process, which has no effect here.
    parameters
        Dictionaries of values, and files.
    remappings
        Pairs of old and new names.
    ros_arguments
        Arguments after ``--ros-args``.
    arguments
        Arguments of the program.
    **kwargs
        Arguments of ``ExecuteProcess``.

    """

    def __init__(
        self,
        *,
        executable: SomeText,
        package: SomeText | None = None,
        name: SomeText | None = None,
        namespace: SomeText | None = None,
        exec_name: SomeText | None = None,
        parameters: Iterable[Any] | None = None,
        remappings: Iterable[Pair] | None = None,
        ros_arguments: Iterable[SomeText] | None = None,
        arguments: Iterable[SomeText] | None = None,
        **kwargs: Any,
    ) -> None:
        """Take what is stated."""
        # As `launch_ros` has it, for descriptions.
        arguments, ros_arguments = list(arguments or ()), list(ros_arguments or ())
        cmd = [executable if package is None else ExecutableInPackage(executable, package)]
        cmd += arguments
        cmd += ["--ros-args", *ros_arguments] if ros_arguments else []
        cmd += ["--ros-args"] if name is None else ["--ros-args", "-r", _NodeName()]
        super().__init__(cmd=cmd, **kwargs)
        self._executable, self._package = executable, package
        self._node_name, self._namespace = name, namespace
        self._parameters = [] if parameters is None else parameters
        self._remappings = list(remappings or ())
        self._ros_arguments, self._arguments = ros_arguments, arguments

    def describe(self) -> str:
        """Return what it is, with what it starts."""
        return named(self, package=self._package, executable=self._executable, name=self._node_name)

    def execute(self, context: LaunchContext) -> None:
        """Find the program, and add the node to the plan."""
        if context.finds_arguments:
            return
        executable = perform(context, self._executable)
        package = None if self._package is None else perform(context, self._package)
        program = _program(package, executable, context)
        arguments = [perform(context, argument) for argument in self._arguments]
        if self._ros_arguments:
            arguments += ["--ros-args", *(perform(context, one) for one in self._ros_arguments)]
            # What the plan adds behind them begins anew.
            arguments.append("--")
        plan = NodePlan(
            program.script,
            self._checked_name(context),
            self._checked_namespace(context),
            parameters=_of_group(context) + evaluated(self._parameters, context),
            remappings=[*context.remappings, *_pairs(self._remappings, context)],
            arguments=arguments,
            function=program.function,
            root=program.root,
            package=package,
            executable=executable,
        )
        self._start(context, plan)

    def _checked_name(self, context: LaunchContext) -> str | None:
        if self._node_name is None:
            return None
        name = perform(context, self._node_name)
        _require(_names.node_name_error(name), name)
        return name

    def _checked_namespace(self, context: LaunchContext) -> str | None:
        given = "" if self._namespace is None else perform(context, self._namespace)
        namespace = below(context.namespace, given)
        if not namespace:
            return None
        _require(_names.namespace_error(namespace), namespace)
        return namespace


def below(outer: str, namespace: str) -> str:
    """Return an absolute namespace; a relative one is below another one, if there is one."""
    if namespace.startswith("/"):
        return namespace
    joined = "/".join(part for part in (outer.strip("/"), namespace.strip("/")) if part)
    return f"/{joined}" if joined else outer


def _require(wrong: tuple[str, int] | None, name: str) -> None:
    if wrong is not None:
        raise LaunchError(f"'{name}': {wrong[0]}")


def _program(package: str | None, executable: str, context: LaunchContext) -> Program:
    if package is not None:
        return find_program(package, executable, context.folder)
    path = context.folder / executable
    if not path.is_file():
        raise LaunchError(f"there is no script {path}: a node without a package names its file")
    return Program(path)


def _of_group(context: LaunchContext) -> list[Parameters]:
    return [each if isinstance(each, Path) else dict([each]) for each in context.parameters]


def _pairs(pairs: Iterable[Pair], context: LaunchContext) -> list[tuple[str, str]]:
    return [(perform(context, old), perform(context, new)) for old, new in pairs]


class LifecycleNode(Node):
    """A node with a lifecycle, whose name and namespace are stated."""

    def __init__(self, *, name: SomeText, namespace: SomeText, **kwargs: Any) -> None:
        """Take what is stated."""
        if kwargs.pop("autostart", False):
            raise LaunchError("LifecycleNode with autostart is not supported")
        super().__init__(name=name, namespace=namespace, **kwargs)


class PushROSNamespace(Action):
    """A namespace for the nodes that come later in the group."""

    def __init__(self, namespace: SomeText, *, condition: Condition | None = None) -> None:
        """Take the namespace; a relative one is below that of the group."""
        super().__init__(condition=condition)
        self._namespace = namespace

    def execute(self, context: LaunchContext) -> None:
        """Set it."""
        namespace = below(context.namespace, perform(context, self._namespace))
        if namespace:
            _require(_names.namespace_error(namespace), namespace)
        context.namespace = namespace


PushRosNamespace = PushROSNamespace


class SetParameter(Action):
    """A parameter for the nodes that come later in the group."""

    def __init__(self, name: SomeText, value: Any, *, condition: Condition | None = None) -> None:
        """Take name and value."""
        super().__init__(condition=condition)
        self._name, self._value = name, value

    def execute(self, context: LaunchContext) -> None:
        """Set it."""
        name = perform(context, self._name)
        context.parameters.append((name, value_of(name, self._value, context)))


class SetUseSimTime(SetParameter):
    """The parameter ``use_sim_time`` for the nodes that come later in the group."""

    def __init__(self, value: bool | SomeText, *, condition: Condition | None = None) -> None:
        """Take the value."""
        super().__init__("use_sim_time", value, condition=condition)

    def execute(self, context: LaunchContext) -> None:
        """Set it."""
        context.parameters.append(("use_sim_time", flag(context, self._value, "use_sim_time")))


class SetParametersFromFile(Action):
    """A file of parameters for the nodes that come later in the group."""

    def __init__(self, filename: SomeText, *, condition: Condition | None = None) -> None:
        """Take the path."""
        super().__init__(condition=condition)
        self._file = ParameterFile(filename)

    def execute(self, context: LaunchContext) -> None:
        """Set it."""
        context.parameters.append(self._file.evaluate(context))


class SetRemap(Action):
    """A remapping for the nodes that come later in the group."""

    def __init__(self, src: SomeText, dst: SomeText, *, condition: Condition | None = None) -> None:
        """Take the old and the new name."""
        super().__init__(condition=condition)
        self._pair = (src, dst)

    def execute(self, context: LaunchContext) -> None:
        """Set it."""
        context.remappings += _pairs([self._pair], context)


class ROSTimer(TimerAction):
    """Actions after a time, by the clock of ROS."""


RosTimer = ROSTimer


class _Components(Action):
    """Not supported: components are libraries in C++."""

    def __init__(self, **kwargs: Any) -> None:
        """Raise ``LaunchError``."""
        raise LaunchError(
            f"{type(self).__name__} is not supported: components are libraries in C++; "
            "start programs in Python with Node"
        )


class ComposableNodeContainer(_Components):
    """Not supported: components are libraries in C++."""


class LoadComposableNodes(_Components):
    """Not supported: components are libraries in C++."""


#: What a node's parameters may be.
SomeParameters = Iterable[str | Path | Mapping[str, Any]]
