"""Actions, as ``rclpy.action``: goals that take a while, with feedback, results and cancelling.

An action is three services and two topics with hidden names, as in ROS 2.
"""

from hprm.ros.action.client import ActionClient as ActionClient
from hprm.ros.action.client import ClientGoalHandle as ClientGoalHandle
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
]
