"""How viewers show values: `hprm._views`, which knows no viewer."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hprm._views import LONGEST_LIST, Cloud, Fields, Image, Nothing, Text, View, views


@dataclass
class Pose:
    x: float
    name: str
    scan: Any


Point = namedtuple("Point", "x y")


def only(value: Any) -> View:
    [(path, view)] = views(value)
    assert path == ""
    return view


@pytest.mark.parametrize(
    ("shape", "dtype", "encoding"),
    [
        ((4, 6, 3), "uint8", "rgb8"),
        ((4, 6, 4), "uint8", "rgba8"),
        ((4, 6, 1), "uint8", "mono8"),
        ((4, 6), "uint8", "mono8"),
        ((4, 3), "uint8", "mono8"),
        ((4, 6), "uint16", "mono16"),
        ((4, 6), "float32", "32FC1"),
        ((4, 6), "float64", "32FC1"),
    ],
)
def test_arrays_of_pixels_are_images(shape: tuple[int, ...], dtype: str, encoding: str) -> None:
    array = np.zeros(shape, dtype)
    view = only(array)
    assert isinstance(view, Image)
    assert view.encoding == encoding
    assert view.pixels is array


@pytest.mark.parametrize("width", [3, 4])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_rows_of_coordinates_are_clouds(width: int, dtype: str) -> None:
    array = np.ones((100, width), dtype)
    view = only(array)
    assert isinstance(view, Cloud)
    assert view.points is array


@pytest.mark.parametrize(
    ("value", "field"),
    [
        (5, 5),
        (True, True),
        (2.5, 2.5),
        (float("nan"), None),
        (float("inf"), None),
        (None, None),
        (np.float32(0.5), 0.5),
        (np.int64(7), 7),
        (np.array(3), 3),
        (np.array([1.0, np.nan]), [1.0, None]),
        ([1, [2, "three"]], [1, [2, "three"]]),
        ((True, 2), [True, 2]),
        (np.array([True, False]), [True, False]),
    ],
)
def test_numbers_and_lists_of_them_are_fields(value: object, field: object) -> None:
    assert only(value) == Fields({"value": field})  # type: ignore[arg-type]


def test_a_text_is_a_message() -> None:
    assert only("careful") == Text("careful")


@pytest.mark.parametrize(
    ("value", "why"),
    [
        (b"raw", "a bytes"),
        (1 + 2j, "a complex"),
        (object(), "an object"),
        ([1, b"raw"], "a list of 2 members"),
        ([0] * (LONGEST_LIST + 1), f"a list of {LONGEST_LIST + 1} members"),
        (np.zeros(LONGEST_LIST + 1), f"an array(float64 {LONGEST_LIST + 1})"),
        (np.zeros((2, 2, 2)), "an array(float64 2x2x2)"),
        (np.zeros((2, 2, 5), "uint8"), "an array(uint8 2x2x5)"),
        (np.zeros((0, 4), "uint8"), "an array(uint8 0x4)"),
        (np.zeros((2, 3), "complex64"), "an array(complex64 2x3)"),
        (np.array(["a"]), "an array(<U1 1)"),
        (np.array(["2026-01-01"], "M8[D]"), "an array(datetime64[D] 1)"),
    ],
)
def test_what_cannot_be_shown_says_what_it_is(value: object, why: str) -> None:
    assert only(value) == Nothing(why)


def test_parts_of_dicts_and_objects_are_fields_or_have_paths() -> None:
    image, points = np.zeros((2, 2), "uint8"), np.zeros((5, 3))
    pose = Pose(0.5, "base", points)
    value = {"n": 1, "image": image, "pose": pose, "raw": b"x", 7: Point(1, 2)}
    shown = dict(views(value))
    assert shown.pop("") == Fields(
        {"n": 1, "pose": {"x": 0.5, "name": "base"}, "7": {"x": 1, "y": 2}}
    )
    assert shown.pop("/raw") == Nothing("a bytes")
    seen = shown.pop("/image"), shown.pop("/pose/scan")
    assert isinstance(seen[0], Image)
    assert isinstance(seen[1], Cloud)
    assert shown == {}
    stand_in = SimpleNamespace(x=0.5, name="base", scan=[1])
    assert only(stand_in) == Fields({"x": 0.5, "name": "base", "scan": [1]})
    assert list(views({})) == []
    assert list(views({"image": image}))[0][0] == "/image"


def test_what_contains_itself_has_an_end() -> None:
    loop: dict[str, Any] = {"n": 1}
    loop["again"] = loop
    shown = dict(views(loop))
    assert isinstance(shown[""], Fields)
    assert list(shown)[1].count("/again") == 9
