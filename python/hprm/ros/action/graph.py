"""Names and types of actions, as ``rclpy.action.graph``: what services and topics stand for."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hprm.ros.node import Node

Names = list[tuple[str, list[str]]]

_SEND_GOAL = "/_action/send_goal"


def get_action_client_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> Names:
    """Return the actions of which another node is a client, with their types."""
    return _of_services(
        node.get_client_names_and_types_by_node(remote_node_name, remote_node_namespace)
    )


def get_action_server_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> Names:
    """Return the actions that another node serves, with their types."""
    return _of_services(
        node.get_service_names_and_types_by_node(remote_node_name, remote_node_namespace)
    )


def get_action_names_and_types(node: Node) -> Names:
    """Return all actions with their types."""
    endpoints = [it for it in node._runtime.endpoints() if it.name.endswith(_SEND_GOAL)]
    return _of_services(
        [
            (name, sorted({it.type for it in endpoints if it.name == name}))
            for name in sorted({it.name for it in endpoints})
        ]
    )


def _of_services(services: Names) -> Names:
    """Tell actions by their services that take goals."""
    suffix = "_SendGoal"
    return [
        (name.removesuffix(_SEND_GOAL), [it.removesuffix(suffix) for it in types])
        for name, types in services
        if name.endswith(_SEND_GOAL)
    ]
