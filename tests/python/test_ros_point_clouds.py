"""Point clouds as arrays, under the names of `sensor_msgs_py`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from processes import Bench, finish

from hprm.ros import _messages, _tf2_ros, _tf2_sensor_msgs
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


def transform(frame: str, place: tuple[float, ...], turn: tuple[float, ...]) -> Any:
    made = class_of("geometry_msgs/msg/TransformStamped")()
    made.header.frame_id, made.child_frame_id = frame, "sensor"
    moved, turned = made.transform.translation, made.transform.rotation
    moved.x, moved.y, moved.z = place
    turned.x, turned.y, turned.z, turned.w = turn
    return made


def test_a_cloud_is_turned_and_moved_and_keeps_its_other_fields() -> None:
    kinds = [Field.FLOAT32, Field.FLOAT32, Field.FLOAT64, Field.UINT16]
    fields = [
        Field(name=name, offset=8 * at, datatype=kind, count=1)
        for at, (name, kind) in enumerate(zip("xyzi", kinds, strict=True))
    ]
    points = [(1.0, 2.0, 3.0, 7), (0.0, 0.0, 0.0, 8)]
    cloud = point_cloud2.create_cloud(Header(frame_id="sensor"), fields, points, 32)
    # A quarter turn about z, and a step.
    half = 0.5**0.5
    moved = _tf2_sensor_msgs.do_transform_cloud(
        cloud, transform("map", (10.0, 20.0, 30.0), (0.0, 0.0, half, half))
    )
    assert (moved.header.frame_id, moved.point_step, moved.fields) == ("map", 32, cloud.fields)
    found = point_cloud2.read_points(moved)
    assert [tuple(round(float(it), 4) for it in point) for point in found] == [
        (8.0, 21.0, 33.0, 7.0),
        (10.0, 20.0, 30.0, 8.0),
    ]
    assert point_cloud2.read_points(cloud).tolist() == points


def test_an_organized_cloud_stays_one_when_it_is_transformed() -> None:
    grid = np.zeros((2, 3, 3), np.float32)
    fields = point_cloud2.create_cloud_xyz32(Header(), [(0, 0, 0)]).fields
    cloud = point_cloud2.create_cloud(Header(), fields, grid)
    step = transform("map", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    moved = _tf2_sensor_msgs.do_transform_cloud(cloud, step.transform)
    shape = moved.height, moved.width
    assert (shape, moved.header.frame_id) == ((cloud.height, cloud.width), "")
    assert shape in ((2, 3), (3, 2))
    assert point_cloud2.read_points(moved)["x"].tolist() == [1.0] * 6
    with pytest.raises(AssertionError, match="the fields x, y and z"):
        _tf2_sensor_msgs.do_transform_cloud(class_of("sensor_msgs/msg/PointCloud2")(), step)


def test_a_buffer_transforms_clouds() -> None:
    buffer = _tf2_ros.Buffer()
    buffer.set_transform_static(transform("map", (0.0, 0.0, 5.0), (0.0, 0.0, 0.0, 1.0)), "test")
    cloud = point_cloud2.create_cloud_xyz32(Header(frame_id="sensor"), [(1.0, 2.0, 3.0)])
    moved = buffer.transform(cloud, "map")
    assert moved.header.frame_id == "map"
    assert point_cloud2.read_points_list(moved) == [(1.0, 2.0, 8.0)]


def test_the_modules_of_transforms_have_their_names(bench: Bench) -> None:
    (bench.folder / "one.py").write_text(
        "from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud, transform_points\n"
        "from tf2_geometry_msgs.tf2_geometry_msgs import do_transform_pose\n"
        "import tf2_geometry_msgs, tf2_sensor_msgs\n"
        "print(tf2_geometry_msgs.do_transform_pose is do_transform_pose)\n"
        "print(tf2_sensor_msgs.do_transform_cloud is do_transform_cloud)\n"
    )
    outcome = finish(bench.call("ros", "run", "one.py"))
    assert (outcome.code, outcome.out) == (0, "True\nTrue\n"), outcome.err
