"""Time sources, as ``rclpy.time_source``: the clocks of a node show what is told on ``/clock``.

The time is set at the tag at which the message comes, before all callbacks of that tag, whether the
node spins or not.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from hprm.ros._graph import Flow
from hprm.ros._interfaces import interface
from hprm.ros._offers import message_of
from hprm.ros.clock import ROSClock
from hprm.ros.clock_type import ClockType
from hprm.ros.parameter import Parameter
from hprm.ros.qos import QoSProfile, ReliabilityPolicy
from hprm.ros.time import Time

if TYPE_CHECKING:
    from hprm.ros.node import Node

CLOCK_TOPIC = "/clock"
USE_SIM_TIME_NAME = "use_sim_time"


class TimeSource:
    """Sets clocks, if the parameter ``use_sim_time`` of a node asks for it."""

    def __init__(self, *, node: Node | None = None) -> None:
        """Make a time source, of a node perhaps."""
        self._node: Node | None = None
        self._clocks: list[ROSClock] = []
        self._last = Time(clock_type=ClockType.ROS_TIME)
        self._is_active = False
        self._flow: Flow | None = None
        if node is not None:
            self.attach_node(node)

    @property
    def ros_time_is_active(self) -> bool:
        """Whether the clocks show what is told."""
        return self._is_active

    @ros_time_is_active.setter
    def ros_time_is_active(self, enabled: bool) -> None:
        if self._is_active == enabled:
            return
        self._is_active = enabled
        for clock in self._clocks:
            clock._set_ros_time_is_active(enabled)
        if enabled:
            self._subscribe()
        else:
            self._unsubscribe()

    def attach_node(self, node: Node) -> None:
        """Do what the parameter of a node asks for, now and when it is set."""
        self.detach_node()
        self._node = node
        if not node.has_parameter(USE_SIM_TIME_NAME):
            node.declare_parameter(USE_SIM_TIME_NAME, False)
        stated = node.get_parameter_or(USE_SIM_TIME_NAME)
        if stated.type_ is Parameter.Type.BOOL:
            self.ros_time_is_active = stated.value
        elif stated.type_ is not Parameter.Type.NOT_SET:
            node.get_logger().error(
                f"Invalid type for parameter '{USE_SIM_TIME_NAME}' {stated.type_!r} should be bool"
            )
        node.add_on_set_parameters_callback(self._on_set)

    def detach_node(self) -> None:
        """Do no longer what a node asks for."""
        self._unsubscribe()
        if self._node is not None:
            self._node.remove_on_set_parameters_callback(self._on_set)
        self._node = None

    def attach_clock(self, clock: ROSClock) -> None:
        """Set a clock from now on."""
        if not isinstance(clock, ROSClock):
            raise ValueError("Only clocks with type ROS_TIME can be attached.")
        clock.set_ros_time_override(self._last)
        clock._set_ros_time_is_active(self._is_active)
        self._clocks.append(clock)

    def clock_callback(self, msg: Any) -> None:
        """Set the clocks as a ``rosgraph_msgs.msg.Clock`` says."""
        self._last = Time.from_msg(msg.clock)
        for clock in self._clocks:
            clock.set_ros_time_override(self._last)

    def _subscribe(self) -> None:
        node = self._node
        if self._flow is not None or node is None:
            return
        name = node.resolve_topic_name(CLOCK_TOPIC)
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        endpoint = node._endpoint("subscription", name, "rosgraph_msgs/msg/Clock", qos)
        self._flow = Flow("topic", name)
        node._runtime.declare(endpoint, self._take)
        node._runtime.request(lambda: self._check(node, name))

    def _unsubscribe(self) -> None:
        if self._flow is not None and self._node is not None:
            self._node._runtime.withdraw(self._flow, self._take)
        self._flow = None

    def _take(self, sent: Any) -> None:
        # What it requests, every publisher offers.
        self.clock_callback(message_of(sent))

    def _check(self, node: Node, name: str) -> None:
        """Say at the start if nothing will ever set the time."""
        if self._is_active and not node._runtime.count("publisher", name):
            print(
                f"warning: the node {node.get_fully_qualified_name()} has use_sim_time, and no"
                f" node publishes {name} yet, so its time is 0",
                file=sys.stderr,
            )

    def _on_set(self, parameters: list[Parameter]) -> Any:
        result = interface("rcl_interfaces.msg", "SetParametersResult")
        for parameter in parameters:
            if parameter.name != USE_SIM_TIME_NAME:
                continue
            if parameter.type_ is not Parameter.Type.BOOL:
                reason = f"{USE_SIM_TIME_NAME} parameter set to something besides a bool"
                if self._node is not None:
                    self._node.get_logger().error(reason)
                return result(successful=False, reason=reason)
            self.ros_time_is_active = parameter.value
        return result(successful=True)
