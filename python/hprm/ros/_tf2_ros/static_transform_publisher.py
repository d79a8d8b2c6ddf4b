"""A program that publishes where a frame is that never moves, as tf2_ros has it.

``--x 1 --yaw 1.57 --frame-id robot --child-frame-id camera``, or in the old form the numbers
``x y z yaw pitch roll`` (or ``x y z qx qy qz qw``) and the two frames, one behind the other.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import re
import sys
from typing import Any, NamedTuple

from hprm.ros._interfaces import interface
from hprm.ros._tf2_ros._geometry import Quaternion, Rigid, normalized, product
from hprm.ros._tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster

_PROGRAM = "static_transform_publisher"
_QUATERNION = ("qx", "qy", "qz", "qw")
_EULER = ("roll", "pitch", "yaw")


class Placement(NamedTuple):
    """What is published."""

    frame: str
    child: str
    transform: Rigid


def rotation_of(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the rotation about x, then about y, then about z, all of them fixed axes."""
    about_x = (math.sin(roll / 2), 0.0, 0.0, math.cos(roll / 2))
    about_y = (0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2))
    about_z = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return product(about_z, product(about_y, about_x))


def parse(words: list[str]) -> Placement:
    """Read a command line; a wrong one ends the program with its usage."""
    parser = argparse.ArgumentParser(prog=_PROGRAM, description=__doc__, allow_abbrev=False)
    for name in ("x", "y", "z", *_QUATERNION, *_EULER):
        parser.add_argument(f"--{name}", type=float)
    parser.add_argument("--frame-id")
    parser.add_argument("--child-frame-id")
    # Numbers may be negative, so the old form is told by its length, not by argparse.
    if len(words) in (8, 9) and not any(word.startswith("--") for word in words):
        words = _new_form(words)
    options = parser.parse_args(words)
    if not options.frame_id or not options.child_frame_id:
        parser.error("--frame-id and --child-frame-id are needed")
    quaternion = [getattr(options, name) for name in _QUATERNION]
    euler = [getattr(options, name) for name in _EULER]
    if _stated(quaternion) and _stated(euler):
        parser.error("the rotation is either a quaternion or roll, pitch and yaw")
    if _stated(quaternion):
        x, y, z = (part or 0.0 for part in quaternion[:3])
        w = 1.0 if quaternion[3] is None else quaternion[3]
        rotation = normalized((x, y, z, w))
    else:
        roll, pitch, yaw = (part or 0.0 for part in euler)
        rotation = rotation_of(roll, pitch, yaw)
    translation = options.x or 0.0, options.y or 0.0, options.z or 0.0
    return Placement(options.frame_id, options.child_frame_id, Rigid(translation, rotation))


def _stated(parts: list[float | None]) -> bool:
    return any(part is not None for part in parts)


def _new_form(words: list[str]) -> list[str]:
    rotation = ("yaw", "pitch", "roll") if len(words) == 8 else _QUATERNION
    names = ("x", "y", "z", *rotation, "frame-id", "child-frame-id")
    return [f"--{name}={word}" for name, word in zip(names, words, strict=True)]


def message_of(placement: Placement, stamp: Any) -> Any:
    """Return what is published."""
    message = interface("geometry_msgs.msg", "TransformStamped")()
    message.header.frame_id, message.header.stamp = placement.frame, stamp
    message.child_frame_id = placement.child
    moved, turned = message.transform.translation, message.transform.rotation
    moved.x, moved.y, moved.z = placement.transform.translation
    turned.x, turned.y, turned.z, turned.w = placement.transform.rotation
    return message


def main(args: list[str] | None = None) -> None:
    """Publish, and keep the node for those that subscribe later."""
    import hprm.ros as rclpy
    from hprm.ros.executors import ExternalShutdownException
    from hprm.ros.node import Node
    from hprm.ros.utilities import remove_ros_args

    placement = parse(remove_ros_args(sys.argv if args is None else args)[1:])
    rclpy.init(args=args)
    node = Node(f"{_PROGRAM}_{re.sub('[^A-Za-z0-9_]', '_', placement.child)}")
    stamp = node.get_clock().now().to_msg()
    StaticTransformBroadcaster(node).sendTransform(message_of(placement, stamp))
    node.get_logger().info(
        "Spinning until stopped - publishing transform\n"
        f"translation: {placement.transform.translation}\n"
        f"rotation: {placement.transform.rotation}\n"
        f"from '{placement.frame}' to '{placement.child}'"
    )
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main()
