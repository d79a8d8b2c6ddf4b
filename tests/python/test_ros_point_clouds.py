"""Point clouds as arrays, under the names of `sensor_msgs_py`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from processes import Bench, finish

from hprm.ros import _messages
from hprm.ros._messages import class_of
from hprm.ros._sensor_msgs_py import point_cloud2

_messages.install()

Header = class_of("std_msgs/msg/Header")
Field = class_of("sensor_msgs/msg/PointField")

XYZ = [(1.0, 2.0, 3.0), (4.0, float("nan"), 6.0), (7.0, 8.0, 9.0)]
MIXED = [
    Field(name="x", offset=0, datatype=Field.FLOAT32, count=1),
    Field(name="", offset=4, datatype=Field.UINT8, count=1),
    Field(name="v", offset=8, datatype=Field.FLOAT64, count=2),
]


def test_points_become_a_cloud_and_points_again() -> None:
    cloud = point_cloud2.create_cloud_xyz32(Header(frame_id="map"), XYZ)
    assert (cloud.header.frame_id, cloud.width, cloud.height) == ("map", 3, 1)
    assert (cloud.point_step, cloud.row_step, len(cloud.data)) == (12, 36, 36)
    assert [it.name for it in cloud.fields] == ["x", "y", "z"]
    points = point_cloud2.read_points(cloud)
    assert points.dtype.names == ("x", "y", "z")
    assert points["x"].tolist() == [1.0, 4.0, 7.0]
    assert point_cloud2.read_points(cloud, ["z", "x"], skip_nans=True).tolist() == [
        (3.0, 1.0),
        (6.0, 4.0),
        (9.0, 7.0),
    ]
    kept = point_cloud2.read_points_numpy(cloud, skip_nans=True)
    assert (kept.shape, kept.dtype) == ((2, 3), np.float32)
    assert point_cloud2.read_points_numpy(cloud, uvs=[2, 0]).tolist() == [[7, 8, 9], [1, 2, 3]]
    [first, *_] = point_cloud2.read_points_list(cloud, ["x", "z"])
    assert (first.x, first.z) == (1.0, 3.0)


def test_points_are_read_and_arrays_written_without_a_copy() -> None:
    rows = np.arange(30, dtype="f4").reshape(10, 3)
    cloud = point_cloud2.create_cloud_xyz32(Header(), rows)
    assert isinstance(cloud.data, np.ndarray)
    assert np.shares_memory(point_cloud2.read_points(cloud), cloud.data)
    assert (point_cloud2.read_points_numpy(cloud) == rows).all()
    records = point_cloud2.read_points(cloud).copy()
    again = point_cloud2.create_cloud(Header(), cloud.fields, records)
    assert np.shares_memory(again.data, records) and again == cloud


def test_fields_have_any_type_number_and_place() -> None:
    points = [(1.5, 7, 2.0, 3.0), (2.5, 8, 4.0, 5.0)]
    cloud = point_cloud2.create_cloud(Header(), MIXED, points, point_step=32)
    assert cloud.point_step == 32
    read = point_cloud2.read_points(cloud)
    assert read.dtype.names == ("x", "unnamed_field_1", "v_0", "v_1")
    assert read.tolist() == points
    # The same bytes, as a machine of the other byte order writes them.
    swapped = read.astype(read.dtype.newbyteorder(">"))
    cloud.data, cloud.is_bigendian = swapped.view("u1"), True
    assert point_cloud2.read_points(cloud).tolist() == points


def test_an_organized_cloud_keeps_its_shape() -> None:
    grid = np.arange(24, dtype="f4").reshape(4, 2, 3)
    cloud = point_cloud2.create_cloud_xyz32(Header(), grid)
    assert (cloud.width, cloud.height) == (4, 2)
    read = point_cloud2.read_points_numpy(cloud, reshape_organized_cloud=True)
    assert (read == grid).all()


WRONG: list[tuple[Any, str]] = [
    (lambda: point_cloud2.read_points("cloud"), "not a sensor_msgs.msg.PointCloud2"),
    (
        lambda: point_cloud2.read_points(point_cloud2.create_cloud_xyz32(Header(), XYZ), ["i"]),
        "no field 'i'",
    ),
    (
        lambda: point_cloud2.read_points_numpy(
            point_cloud2.create_cloud(Header(), MIXED, [(1, 2, 3, 4)])
        ),
        "different types",
    ),
    (lambda: point_cloud2.create_cloud(Header(), MIXED, np.zeros((2, 4))), "different types"),
    (lambda: point_cloud2.create_cloud(Header(), MIXED, np.zeros(2, [("x", "f4")])), "the dtype"),
    (lambda: point_cloud2.dtype_from_fields([MIXED[0], MIXED[0]]), "two fields"),
    (lambda: point_cloud2.dtype_from_fields([Field(name="x", datatype=7)]), "count of 0"),
]


@pytest.mark.parametrize(("call", "words"), WRONG)
def test_mistakes_are_assertions(call: Any, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        call()


def test_programs_import_it_by_its_name(bench: Bench) -> None:
    (bench.folder / "cloud.py").write_text(
        "import rclpy\nfrom sensor_msgs_py import point_cloud2\nfrom std_msgs.msg import Header\n"
        "cloud = point_cloud2.create_cloud_xyz32(Header(), [(1, 2, 3)])\n"
        "print(point_cloud2.read_points_list(cloud))\n"
    )
    done = finish(bench.call("ros", "run", "cloud.py"))
    assert (done.code, done.out) == (0, "[Point(x=1.0, y=2.0, z=3.0)]\n"), done.err
