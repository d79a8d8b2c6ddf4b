"""Transforming messages of ``geometry_msgs``, as in the package ``tf2_geometry_msgs``.

Importing it registers the functions, so that ``Buffer.transform`` takes these messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hprm.ros._interfaces import interface
from hprm.ros._tf2_ros._geometry import Rigid, Vector, apply, compose, normalized, rotate
from hprm.ros._tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration

_MESSAGES = "geometry_msgs.msg"


def _rigid(transform: Any) -> Rigid:
    moved, turned = transform.transform.translation, transform.transform.rotation
    rotation = normalized((turned.x, turned.y, turned.z, turned.w))
    return Rigid((moved.x, moved.y, moved.z), rotation)


def _filled(message: Any, vector: Vector) -> Any:
    message.x, message.y, message.z = vector
    return message


def do_transform_point(point: Any, transform: Any) -> Any:
    """Return a ``PointStamped`` in the target frame of a ``TransformStamped``."""
    result = interface(_MESSAGES, "PointStamped")()
    _filled(result.point, apply(_rigid(transform), (point.point.x, point.point.y, point.point.z)))
    result.header = transform.header
    return result


def do_transform_vector3(vector3: Any, transform: Any) -> Any:
    """Return a ``Vector3Stamped`` in the target frame: it is turned, and not moved."""
    vector = vector3.vector
    result = interface(_MESSAGES, "Vector3Stamped")()
    _filled(result.vector, rotate(_rigid(transform).rotation, (vector.x, vector.y, vector.z)))
    result.header = transform.header
    return result


def do_transform_pose(pose: Any, transform: Any) -> Any:
    """Return a ``Pose`` in the target frame; the real part of its rotation is not negative."""
    at, turned = pose.position, pose.orientation
    rotation = normalized((turned.x, turned.y, turned.z, turned.w))
    moved = compose(_rigid(transform), Rigid((at.x, at.y, at.z), rotation))
    x, y, z, w = moved.rotation
    sign = -1.0 if w < 0.0 else 1.0
    result = interface(_MESSAGES, "Pose")()
    _filled(result.position, moved.translation)
    _filled(result.orientation, (sign * x, sign * y, sign * z))
    result.orientation.w = sign * w
    return result


def do_transform_pose_stamped(pose: Any, transform: Any) -> Any:
    """Return a ``PoseStamped`` in the target frame."""
    result = interface(_MESSAGES, "PoseStamped")()
    result.pose = do_transform_pose(pose.pose, transform)
    result.header = transform.header
    return result


def do_transform_pose_with_covariance_stamped(pose: Any, transform: Any) -> Any:
    """Return a ``PoseWithCovarianceStamped`` in the target frame."""
    result = interface(_MESSAGES, "PoseWithCovarianceStamped")()
    result.pose.pose = do_transform_pose(pose.pose.pose, transform)
    result.pose.covariance = transform_covariance(pose.pose.covariance, transform)
    result.header = transform.header
    return result


def do_transform_polygon_stamped(polygon: Any, transform: Any) -> Any:
    """Return a ``PolygonStamped`` in the target frame."""
    rigid = _rigid(transform)
    result = interface(_MESSAGES, "PolygonStamped")()
    point = interface(_MESSAGES, "Point32")
    result.polygon.points = [
        _filled(point(), apply(rigid, (corner.x, corner.y, corner.z)))
        for corner in polygon.polygon.points
    ]
    result.header = transform.header
    return result


def transform_covariance(cov_in: Sequence[float], transform: Any) -> Any:
    """Return a covariance of position and rotation (36 numbers, by rows) in the target frame."""
    rotation = _rigid(transform).rotation
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    turn = np.array([rotate(rotation, axis) for axis in axes]).T
    both = np.kron(np.eye(2), turn)
    return (both @ np.asarray(cov_in, dtype=np.float64).reshape(6, 6) @ both.T).reshape(36)


def _register() -> None:
    transforms, conversions = TransformRegistration(), ConvertRegistration()
    for name, function in (
        ("PointStamped", do_transform_point),
        ("Vector3Stamped", do_transform_vector3),
        ("PoseStamped", do_transform_pose_stamped),
        ("PoseWithCovarianceStamped", do_transform_pose_with_covariance_stamped),
        ("PolygonStamped", do_transform_polygon_stamped),
    ):
        kind = interface(_MESSAGES, name)
        transforms.add(kind, function)
        conversions.add_to_msg(kind, lambda message: message)
        conversions.add_from_msg(kind, lambda message: message)


_register()
