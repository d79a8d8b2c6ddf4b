"""Callbacks for changes of parameters, as ``rclpy.parameter_event_handler``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

from hprm.ros._interfaces import interface
from hprm.ros.qos import QoSProfile, qos_profile_parameter_events

if TYPE_CHECKING:
    from hprm.ros.callback_groups import CallbackGroup
    from hprm.ros.node import Node

Callback = Callable[[Any], Any]


class ParameterCallbackHandle:
    """A callback for one parameter of a node."""

    def __init__(self, parameter_name: str, node_name: str, callback: Callback) -> None:
        """Call back with this parameter."""
        self.parameter_name = parameter_name
        self.node_name = node_name
        self.callback = callback


class ParameterEventCallbackHandle:
    """A callback for all changes of parameters."""

    def __init__(self, callback: Callback) -> None:
        """Call back with each change."""
        self.callback = callback


class ParameterEventHandler:
    """Calls back when parameters of nodes change; the callback that was added last is first."""

    def __init__(
        self,
        node: Node,
        qos_profile: QoSProfile = qos_profile_parameter_events,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
    ) -> None:
        """Take the changes that all nodes tell; the arguments are those of a subscription."""
        self.node = node
        self.qos_profile = qos_profile
        self._of_parameters: dict[tuple[str, str], list[ParameterCallbackHandle]] = {}
        self._of_events: list[ParameterEventCallbackHandle] = []
        self.parameter_event_subscription = node.create_subscription(
            interface("rcl_interfaces.msg", "ParameterEvent"),
            "/parameter_events",
            self._take,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )

    def destroy(self) -> None:
        """Call back no more."""
        self.node.destroy_subscription(self.parameter_event_subscription)

    def add_parameter_callback(
        self, parameter_name: str, node_name: str, callback: Callback
    ) -> ParameterCallbackHandle:
        """Call back with a parameter of a node, as a message, when it is declared or changes."""
        made = ParameterCallbackHandle(parameter_name, self._full_name(node_name), callback)
        self._of_parameters.setdefault((parameter_name, made.node_name), []).insert(0, made)
        return made

    def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
        """Call back no more; raise ``RuntimeError`` if it was not added."""
        key = (handle.parameter_name, handle.node_name)
        handles = self._of_parameters.get(key, [])
        if handle not in handles:
            raise RuntimeError("Callback doesn't exist")
        handles.remove(handle)
        if not handles:
            del self._of_parameters[key]

    def add_parameter_event_callback(self, callback: Callback) -> ParameterEventCallbackHandle:
        """Call back with each event, which has all parameters that a node has set together."""
        made = ParameterEventCallbackHandle(callback)
        self._of_events.insert(0, made)
        return made

    def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
        """Call back no more; raise ``RuntimeError`` if it was not added."""
        if handle not in self._of_events:
            raise RuntimeError("Callback doesn't exist")
        self._of_events.remove(handle)

    @staticmethod
    def get_parameter_from_event(event: Any, parameter_name: str, node_name: str) -> Any:
        """Return a parameter of a node that an event has, or ``None``."""
        if event.node == node_name:
            for parameter in ParameterEventHandler.get_parameters_from_event(event):
                if parameter.name == parameter_name:
                    return parameter
        return None

    @staticmethod
    def get_parameters_from_event(event: Any) -> Iterator[Any]:
        """Return the parameters that an event has."""
        yield from chain(event.new_parameters, event.changed_parameters)

    def _take(self, event: Any) -> None:
        for (name, node_name), handles in list(self._of_parameters.items()):
            parameter = self.get_parameter_from_event(event, name, node_name)
            if parameter is not None:
                for handle in list(handles):
                    handle.callback(parameter)
        for of_event in list(self._of_events):
            of_event.callback(event)

    def _full_name(self, name: str | None) -> str:
        if not name:
            return self.node.get_fully_qualified_name()
        if name.startswith("/"):
            return name
        return f"{self.node.get_namespace().rstrip('/')}/{name}"
