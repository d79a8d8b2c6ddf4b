"""What other nodes ask of a node's parameters, and are told of them: services and a topic."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hprm.ros._interfaces import interface
from hprm.ros._parameters import ParameterChanges
from hprm.ros._sleeping_service import SleepingService
from hprm.ros._telling import Telling
from hprm.ros.exceptions import ParameterNotDeclaredException, ParameterUninitializedException
from hprm.ros.parameter import Parameter
from hprm.ros.qos import qos_profile_parameter_events, qos_profile_parameters

if TYPE_CHECKING:
    from hprm.ros.node import Node


class ParameterEvents:
    """The topic on which a node tells of its parameters."""

    def __init__(self, node: Node) -> None:
        """Declare the publisher."""
        self._node = node
        self._telling = Telling(
            node,
            "rcl_interfaces/msg/ParameterEvent",
            "/parameter_events",
            qos_profile_parameter_events,
        )

    def tell(self, changes: ParameterChanges) -> None:
        """Tell subscriptions that exist by now, which before the start are those of the process."""
        if self._telling.is_taken():
            stamp = self._node.get_clock().now().to_msg()
            self._telling.tell(lambda: self._event(changes, stamp))

    def _event(self, changes: ParameterChanges, stamp: Any) -> Any:
        return interface("rcl_interfaces.msg", "ParameterEvent")(
            stamp=stamp,
            node=self._node.get_fully_qualified_name(),
            new_parameters=[it.to_parameter_msg() for it in changes.new],
            changed_parameters=[it.to_parameter_msg() for it in changes.changed],
            deleted_parameters=[it.to_parameter_msg() for it in changes.deleted],
        )


class ParameterServices:
    """The services by which other nodes read and set the parameters of a node."""

    def __init__(self, node: Node) -> None:
        """Declare the services."""
        self._node = node
        self._services = [
            SleepingService(node, kind, name, answer, qos_profile_parameters)
            for kind, name, answer in [
                ("DescribeParameters", "describe_parameters", self._describe),
                ("GetParameters", "get_parameters", self._get),
                ("GetParameterTypes", "get_parameter_types", self._types),
                ("ListParameters", "list_parameters", self._list),
                ("SetParameters", "set_parameters", self._set),
                ("SetParametersAtomically", "set_parameters_atomically", self._set_atomically),
            ]
        ]

    def destroy(self) -> None:
        """Take no more requests."""
        for service in self._services:
            service.destroy()

    # One name that is not declared makes an answer empty, as with rclpy.

    def _describe(self, request: Any, response: Any) -> Any:
        try:
            response.descriptors = self._node.describe_parameters(request.names)
        except ParameterNotDeclaredException:
            response.descriptors = []
        return response

    def _get(self, request: Any, response: Any) -> Any:
        try:
            found = self._node.get_parameters(request.names)
        except (ParameterNotDeclaredException, ParameterUninitializedException):
            found = []
        response.values = [it.get_parameter_value() for it in found]
        return response

    def _types(self, request: Any, response: Any) -> Any:
        node = self._node
        known = all(node.has_parameter(name) for name in request.names)
        if known or node._allow_undeclared_parameters:
            response.types = [_type_of(node, name) for name in request.names]
        return response

    def _list(self, request: Any, response: Any) -> Any:
        response.result = self._node.list_parameters(list(request.prefixes), int(request.depth))
        return response

    def _set(self, request: Any, response: Any) -> Any:
        response.results = [self._set_together([it]) for it in request.parameters]
        return response

    def _set_atomically(self, request: Any, response: Any) -> Any:
        response.result = self._set_together(request.parameters)
        return response

    def _set_together(self, stated: list[Any]) -> Any:
        parameters = [Parameter.from_parameter_msg(it) for it in stated]
        try:
            return self._node.set_parameters_atomically(parameters)
        except ParameterNotDeclaredException as error:
            refused = interface("rcl_interfaces.msg", "SetParametersResult")
            return refused(successful=False, reason=str(error))


def _type_of(node: Node, name: str) -> int:
    number: int = node.get_parameter_or(name).type_.value
    return number
