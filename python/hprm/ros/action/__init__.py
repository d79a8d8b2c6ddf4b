"""Actions, as ``rclpy.action``: goals that take a while, with feedback, results and cancelling.

An action is three services and two topics with hidden names, as in ROS 2.
"""

from hprm.ros.action.client import ActionClient as ActionClient
from hprm.ros.action.client import ClientGoalHandle as ClientGoalHandle
from hprm.ros.action.graph import (
    get_action_client_names_and_types_by_node as get_action_client_names_and_types_by_node,
)
from hprm.ros.action.graph import get_action_names_and_types as get_action_names_and_types
from hprm.ros.action.graph import (
    get_action_server_names_and_types_by_node as get_action_server_names_and_types_by_node,
)
from hprm.ros.action.server import ActionServer as ActionServer
from hprm.ros.action.server import CancelResponse as CancelResponse
from hprm.ros.action.server import GoalResponse as GoalResponse
from hprm.ros.action.server import ServerGoalHandle as ServerGoalHandle

__all__ = [
    "ActionClient",
    "ActionServer",
    "CancelResponse",
    "ClientGoalHandle",
    "GoalResponse",
    "ServerGoalHandle",
    "get_action_client_names_and_types_by_node",
    "get_action_names_and_types",
    "get_action_server_names_and_types_by_node",
]
