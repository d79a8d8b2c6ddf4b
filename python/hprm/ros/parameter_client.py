"""Clients of the parameters of other nodes, as ``rclpy.parameter_client``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from hprm.ros._interfaces import interface
from hprm.ros.parameter import Parameter, parameter_dict_from_yaml_file
from hprm.ros.qos import QoSProfile, qos_profile_parameter_events, qos_profile_services_default
from hprm.ros.task import Future

if TYPE_CHECKING:
    from hprm.ros.callback_groups import CallbackGroup
    from hprm.ros.client import Client
    from hprm.ros.node import Node
    from hprm.ros.subscription import Subscription

Callback = Callable[[Any], Any]


class AsyncParameterClient:
    """Reads and sets the parameters of another node; each request returns a future."""

    def __init__(
        self,
        node: Node,
        remote_node_name: str,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> None:
        """Make clients for the services of the node ``remote_node_name``."""
        self.node = node
        self.remote_node_name = remote_node_name

        def client(type_: str, name: str) -> Client:
            return node.create_client(
                interface("rcl_interfaces.srv", type_),
                f"{remote_node_name}/{name}",
                qos_profile=qos_profile,
                callback_group=callback_group,
            )

        self._get = client("GetParameters", "get_parameters")
        self._list = client("ListParameters", "list_parameters")
        self._set = client("SetParameters", "set_parameters")
        self._types = client("GetParameterTypes", "get_parameter_types")
        self._describe = client("DescribeParameters", "describe_parameters")
        self._set_atomically = client("SetParametersAtomically", "set_parameters_atomically")
        self._clients = [
            *(self._list, self._set, self._get),
            *(self._types, self._describe, self._set_atomically),
        ]

    def services_are_ready(self) -> bool:
        """Return whether the node serves all requests."""
        return all(it.service_is_ready() for it in self._clients)

    def wait_for_services(self, timeout_sec: float | None = None) -> bool:
        """Wait until the node serves all requests, or for so long; return whether it does."""
        if timeout_sec is None:
            return all(it.wait_for_service() for it in self._clients)
        until = self.node._runtime.now() + round(timeout_sec * 1e9)
        for client in self._clients:
            left = max(until - self.node._runtime.now(), 0)
            if not client.service_is_ready() and not client.wait_for_service(left / 1e9):
                return False
        return True

    def list_parameters(
        self,
        prefixes: list[str] | None = None,
        depth: int | None = None,
        callback: Callback | None = None,
    ) -> Future[Any]:
        """Ask for the names of parameters, below prefixes, down to a depth."""
        request = self._list.srv_type.Request(prefixes=prefixes or [], depth=depth or 0)
        return _called(self._list, request, callback)

    def get_parameters(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        """Ask for the values of parameters."""
        return _called(self._get, self._get.srv_type.Request(names=names), callback)

    def set_parameters(
        self, parameters: Sequence[Any], callback: Callback | None = None
    ) -> Future[Any]:
        """Set parameters one after the other."""
        request = self._set.srv_type.Request(parameters=_messages(parameters))
        return _called(self._set, request, callback)

    def describe_parameters(
        self, names: list[str], callback: Callback | None = None
    ) -> Future[Any]:
        """Ask for the descriptors of parameters."""
        return _called(self._describe, self._describe.srv_type.Request(names=names), callback)

    def get_parameter_types(
        self, names: list[str], callback: Callback | None = None
    ) -> Future[Any]:
        """Ask for the types of parameters."""
        return _called(self._types, self._types.srv_type.Request(names=names), callback)

    def set_parameters_atomically(
        self, parameters: Sequence[Any], callback: Callback | None = None
    ) -> Future[Any]:
        """Set parameters all together, or none of them."""
        request = self._set_atomically.srv_type.Request(parameters=_messages(parameters))
        return _called(self._set_atomically, request, callback)

    def delete_parameters(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        """Take values away from parameters that may have any type."""
        return self.set_parameters([Parameter(name) for name in names], callback)

    def load_parameter_file(
        self, parameter_file: str, use_wildcard: bool = False, callback: Callback | None = None
    ) -> Future[Any]:
        """Set the parameters that a file states."""
        stated = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters(list(stated.values()), callback)

    def load_parameter_file_atomically(
        self, parameter_file: str, use_wildcard: bool = False, callback: Callback | None = None
    ) -> Future[Any]:
        """Set the parameters that a file states, or none of them."""
        stated = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters_atomically(list(stated.values()), callback)

    def on_parameter_event(
        self,
        callback: Callback,
        qos_profile: QoSProfile = qos_profile_parameter_events,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
    ) -> Subscription:
        """Call back with what becomes of the parameters of all nodes."""
        return self.node.create_subscription(
            interface("rcl_interfaces.msg", "ParameterEvent"),
            "/parameter_events",
            callback,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )


def _called(client: Client, request: Any, callback: Callback | None) -> Future[Any]:
    future = client.call_async(request)
    if callback is not None:
        future.add_done_callback(callback)
    return future


def _messages(parameters: Sequence[Any]) -> list[Any]:
    return [it.to_parameter_msg() if isinstance(it, Parameter) else it for it in parameters]
