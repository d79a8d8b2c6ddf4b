"""Points of a ``PointCloud2`` as a NumPy array over its bytes, and clouds made of points."""

from __future__ import annotations

import sys
from collections import namedtuple
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.lib import recfunctions

from hprm.ros import _messages

# The codes of numbers in ``PointField.datatype``, from INT8 on.
_FORMATS = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")

_FLOAT32 = 7

_Array = Any


def read_points(
    cloud: Any,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[int] | None = None,
    reshape_organized_cloud: bool = False,
) -> _Array:
    """Return the points of a cloud, each a record with fields.

    Parameters
    ----------
    cloud
        A ``sensor_msgs.msg.PointCloud2``.
    field_names
        Which fields; all without it.
    skip_nans
        Leave out points of which a field is not a number.
    uvs
        The indices of the points that are wanted.
    reshape_organized_cloud
        Make an array of width by height of a cloud that has more than one row.

    """
    if not isinstance(cloud, _class("PointCloud2")):
        raise AssertionError("Cloud is not a sensor_msgs.msg.PointCloud2")
    kind = dtype_from_fields(cloud.fields, cloud.point_step)
    kind = kind.newbyteorder(">" if cloud.is_bigendian else "<")
    points: _Array = np.frombuffer(cloud.data, kind, count=cloud.width * cloud.height)
    names = list(kind.names or ())
    if field_names is not None:
        missing = [it for it in field_names if it not in names]
        if missing:
            raise AssertionError(f"the cloud has no field {missing[0]!r}; it has {names}")
        names = list(field_names)
        points = points[names]
    if skip_nans and not cloud.is_dense:
        points = points[~np.any([np.isnan(points[it]) for it in names], axis=0)]
    if uvs is not None:
        points = points[np.fromiter(uvs, np.intp)]
    if reshape_organized_cloud and cloud.height > 1:
        points = points.reshape(cloud.width, cloud.height)
    return points


def read_points_numpy(
    cloud: Any,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[int] | None = None,
    reshape_organized_cloud: bool = False,
) -> _Array:
    """Return the points of a cloud, whose fields have one type, each as a row of numbers."""
    points = read_points(cloud, field_names, skip_nans, uvs, reshape_organized_cloud)
    kinds = {points.dtype[name] for name in points.dtype.names}
    if len(kinds) > 1:
        raise AssertionError("the fields have different types; choose some by field_names")
    return recfunctions.structured_to_unstructured(points)


def read_points_list(
    cloud: Any,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[int] | None = None,
) -> list[Any]:
    """Return the points of a cloud as named tuples."""
    points = read_points(cloud, field_names, skip_nans, uvs)
    kind = namedtuple("Point", points.dtype.names)  # type: ignore[misc]
    return [kind._make(it) for it in points.tolist()]


def dtype_from_fields(fields: Iterable[Any], point_step: int | None = None) -> np.dtype[Any]:
    """Return the dtype of a point. A field of several numbers is ``name_0``, ``name_1``, ..."""
    members: dict[str, tuple[str, int]] = {}
    for number, it in enumerate(fields):
        if it.count < 1:
            raise AssertionError(f"the field {it.name!r} has a count of 0")
        name = it.name or f"unnamed_field_{number}"
        kind = np.dtype(_FORMATS[it.datatype - 1])
        for at in range(it.count):
            full = f"{name}_{at}" if it.count > 1 else name
            if full in members:
                raise AssertionError(f"two fields have the name {full!r}")
            members[full] = kind.str, it.offset + at * kind.itemsize
    described: dict[str, Any] = {
        "names": list(members),
        "formats": [kind for kind, _ in members.values()],
        "offsets": [offset for _, offset in members.values()],
    }
    if point_step is not None:
        described["itemsize"] = point_step
    return np.dtype(described)  # type: ignore[call-overload,no-any-return]


def create_cloud(
    header: Any, fields: Iterable[Any], points: Iterable[Any], point_step: int | None = None
) -> Any:
    """Make a cloud of points: tuples, rows of an array, or an array of records.

    An array of two dimensions of records, or of three of numbers, is an organized cloud.
    """
    fields = list(fields)
    kind = dtype_from_fields(fields, point_step)
    records = _records(points, kind)
    if records.ndim > 2:
        raise AssertionError("points are organized in two dimensions at most")
    cloud = _class("PointCloud2")(
        header=header,
        height=records.shape[1] if records.ndim == 2 else 1,
        width=records.shape[0],
        is_bigendian=sys.byteorder == "big",
        fields=fields,
        point_step=kind.itemsize,
        row_step=kind.itemsize * records.shape[0],
    )
    cloud.data = np.ascontiguousarray(records).reshape(-1).view(np.uint8)
    return cloud


def create_cloud_xyz32(header: Any, points: Iterable[Any]) -> Any:
    """Make a cloud of points with x, y and z as numbers of 32 bits."""
    field = _class("PointField")
    fields = [
        field(name=name, offset=4 * at, datatype=_FLOAT32, count=1) for at, name in enumerate("xyz")
    ]
    return create_cloud(header, fields, points)


def _records(points: Iterable[Any], kind: np.dtype[Any]) -> _Array:
    if not isinstance(points, np.ndarray):
        return np.array([tuple(it) for it in points], kind)
    if points.dtype.names is None:
        if len({kind[name] for name in kind.names or ()}) > 1:
            raise AssertionError("the fields have different types; pass an array of records")
        return recfunctions.unstructured_to_structured(points, kind)
    if points.dtype != kind:
        raise AssertionError(f"the points have the dtype {points.dtype}, and the fields {kind}")
    return points


def _class(name: str) -> Any:
    return _messages.class_of(f"sensor_msgs/msg/{name}")
