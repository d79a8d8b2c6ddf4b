"""Nodes with a lifecycle, as ``rclpy.lifecycle``."""

from __future__ import annotations

from hprm.ros.lifecycle._machine import TransitionCallbackReturnType as TransitionCallbackReturn
from hprm.ros.lifecycle.managed_entity import ManagedEntity, SimpleManagedEntity
from hprm.ros.lifecycle.node import LifecycleNode, LifecycleNodeMixin, LifecycleState
from hprm.ros.lifecycle.publisher import LifecyclePublisher

#: Shorter names, which rclpy has, too: ``from rclpy.lifecycle import Node``.
Node = LifecycleNode
NodeMixin = LifecycleNodeMixin
State = LifecycleState
Publisher = LifecyclePublisher

# Not the shorter ones: `Node` is also the name of a node without a lifecycle.
__all__ = [
    "LifecycleNode",
    "LifecycleNodeMixin",
    "LifecyclePublisher",
    "LifecycleState",
    "ManagedEntity",
    "SimpleManagedEntity",
    "TransitionCallbackReturn",
]
