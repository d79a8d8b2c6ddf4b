"""The functions of the package, under the name of its module."""

from __future__ import annotations

from typing import Any

import numpy as np

from hprm.ros._interfaces import interface
from hprm.ros._sensor_msgs_py.point_cloud2 import create_cloud, read_points
from hprm.ros._tf2_ros._geometry import normalized, rotate
from hprm.ros._tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration

_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def transform_points(point_cloud: np.ndarray[Any, Any], transform: Any) -> np.ndarray[Any, Any]:
    """Return points, each a row of an array, moved and turned by a ``Transform``."""
    moved, turned = transform.translation, transform.rotation
    rotation = normalized((turned.x, turned.y, turned.z, turned.w))
    turn = np.array([rotate(rotation, axis) for axis in _AXES])
    points: np.ndarray[Any, Any] = point_cloud @ turn + (moved.x, moved.y, moved.z)
    return points


def do_transform_cloud(cloud: Any, transform: Any) -> Any:
    """Return a cloud whose points are moved and turned; other fields stay as they are.

    Parameters
    ----------
    cloud
        A ``PointCloud2`` with the fields x, y and z, which is not changed.
    transform
        A ``Transform``, or a ``TransformStamped``, whose frame is that of the result.

    """
    header = interface("std_msgs.msg", "Header")(
        stamp=cloud.header.stamp, frame_id=cloud.header.frame_id
    )
    if isinstance(transform, interface("geometry_msgs.msg", "TransformStamped")):
        header.frame_id = transform.header.frame_id
        transform = transform.transform
    if not {"x", "y", "z"} <= {it.name for it in cloud.fields}:
        raise AssertionError("a cloud that is transformed needs the fields x, y and z")
    points = read_points(cloud, reshape_organized_cloud=True).copy()
    places = np.stack([points[name] for name in "xyz"], axis=-1)
    moved = transform_points(places, transform)
    for at, name in enumerate("xyz"):
        points[name] = moved[..., at]
    return create_cloud(header, cloud.fields, points, cloud.point_step)


def _register() -> None:
    kind = interface("sensor_msgs.msg", "PointCloud2")
    TransformRegistration().add(kind, do_transform_cloud)
    ConvertRegistration().add_to_msg(kind, lambda message: message)
    ConvertRegistration().add_from_msg(kind, lambda message: message)


_register()
