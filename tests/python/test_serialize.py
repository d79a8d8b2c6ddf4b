"""Adaptive serialization: everything comes back as it was, and large buffers are copied once."""

from __future__ import annotations

import copy
import datetime
import math
import pickle
import random
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from hprm._hprm import decode, encode, store_round_trip

LIMIT = 12 * 1024


def there_and_back(value: Any) -> Any:
    return decode(*encode(value))


def through_a_store(value: Any) -> Any:
    values, _ = store_round_trip(value, 1)
    return values[0]


@dataclass
class Frame:
    number: int
    pixels: np.ndarray


class Node:
    def __init__(self) -> None:
        self.others: list[Node] = []


SCALARS = [
    None,
    True,
    False,
    0,
    -1,
    2**62,
    2**63 - 1,
    -(2**63),
    2**63,
    -(2**63) - 1,
    10**100,
    -(10**100),
    0.0,
    -0.0,
    1.5,
    math.inf,
    -math.inf,
    5e-324,
    "",
    "zwölf € 𝄞",
    "\udc80 lone",
    b"",
    b"\x00\xff",
    bytearray(b"abc"),
    1j,
    datetime.timedelta(1),
    frozenset({1, 2}),
    range(3),
    Ellipsis,
]


@pytest.mark.parametrize("value", SCALARS, ids=repr)
def test_scalars(value: Any) -> None:
    back = there_and_back(value)
    assert type(back) is type(value)
    assert back == value
    assert math.copysign(1, back) == math.copysign(1, value) if value == 0.0 else True


def test_nan_stays_nan() -> None:
    assert math.isnan(there_and_back(math.nan))


def test_containers_keep_types_and_order() -> None:
    value = {"b": [1, (2.5, None)], "a": {3: b"x", (1, 2): ["y", {}]}, None: ()}
    back = there_and_back(value)
    assert back == value
    assert list(back) == ["b", "a", None]
    assert type(back["b"][1]) is tuple


def test_subclasses_keep_their_class() -> None:
    class_of = [np.float64(1.5), np.int32(3), np.str_("x")]
    back = there_and_back(class_of)
    assert [type(entry) for entry in back] == [np.float64, np.int32, np.str_]


def test_a_value_that_occurs_twice_is_one_value() -> None:
    shared = [1]
    array = np.arange(3)
    back = there_and_back([shared, shared, {"a": array, "b": array}])
    assert back[0] is back[1]
    assert back[2]["a"] is back[2]["b"]


def test_cycles() -> None:
    value: list[Any] = [{}]
    value[0]["self"] = value
    back = there_and_back(value)
    assert back[0]["self"] is back
    inside: list[Any] = []
    pair = (inside,)
    inside.append(pair)
    back = there_and_back(pair)
    assert back[0][0] is back


def test_cycles_through_objects() -> None:
    node = Node()
    node.others = [node]
    back = there_and_back([node, node.others])
    assert back[0].others is back[1]
    assert back[1][0] is back[0]


def test_deep_nesting() -> None:
    value: list[Any] = []
    for _ in range(400):
        value = [value]
    back = there_and_back(value)
    for _ in range(400):
        (back,) = back
    assert back == []


def arrays() -> dict[str, np.ndarray]:
    base = np.arange(24.0).reshape(2, 3, 4)
    record = np.dtype([("x", "<f4"), ("name", "S3"), ("sub", [("y", ">i2", (2,))])])
    records = np.zeros(5, record)
    records["x"] = range(5)
    records["sub"]["y"][:, 1] = 7
    return {
        "C": base,
        "Fortran": np.asfortranarray(base),
        "transposed": base.T,
        "slice": base[:, ::2, 1:],
        "negative strides": base[::-1, :, ::-1],
        "broadcast": np.broadcast_to(np.float32(3), (4, 5)),
        "0-d": np.array(3.5),
        "empty": np.zeros((0, 3), "i4"),
        "empty in the middle": np.zeros((2, 0, 3)),
        "bool": np.array([True, False]),
        "float16": np.array([1, 2.5], "f2"),
        "complex": np.array([1j, 2]),
        "big-endian": np.array([1, 2, 3], ">i4"),
        "dates": np.array(["2026-01-01", "NaT"], "M8[ns]"),
        "durations": np.array([1, 2], "m8[us]"),
        "bytes": np.array([b"ab", b"c"]),
        "unicode": np.array(["ab", "€"]),
        "records": records,
        "every other record": records[::2],
        "aligned records": np.zeros(3, np.dtype([("a", "i1"), ("b", "f8")], align=True)),
        "void": np.zeros(2, "V5"),
        "no bytes": np.zeros(2, "S"),
        "objects": np.array([1, "x", None], object),
        "large": np.random.default_rng(1).random((300, 200)),
        "large slice": np.random.default_rng(1).random((300, 400))[::-1, ::2],
        "large Fortran": np.asfortranarray(np.random.default_rng(1).random((300, 200))),
        "large objects": np.array([str(i) for i in range(20000)], object),
        "large records": np.resize(records, 9000)[::2],
    }


@pytest.mark.parametrize("name", arrays())
@pytest.mark.parametrize("way", [there_and_back, through_a_store])
def test_arrays(name: str, way: Any) -> None:
    array = arrays()[name]
    before = array.copy()
    for value in (array, {"in": [array]}, Frame(3, array)):
        back = way(value)
        if isinstance(back, Frame):
            back = back.pixels
        elif isinstance(back, dict):
            back = back["in"][0]
        assert type(back) is np.ndarray
        assert back.dtype == array.dtype
        assert back.dtype.isalignedstruct == array.dtype.isalignedstruct
        assert back.shape == array.shape
        np.testing.assert_array_equal(back, array)
        if not array.dtype.hasobject and array.dtype.itemsize:
            assert not back.flags.writeable
    np.testing.assert_array_equal(array, before)


FORTRAN = ("Fortran", "transposed")


def huge_arrays() -> dict[str, np.ndarray]:
    """More than 8 MiB each: what lies in a row is copied past the caches of the processor."""
    base = np.arange(1_200_000.0).reshape(1000, 1200)
    return {
        "C": base,
        "Fortran": np.asfortranarray(base),
        "transposed": base.T,
        "three dimensions": base.reshape(100, 10, 1200).transpose(1, 0, 2),
        "from an odd address": np.arange(2_400_001, dtype="i4").view("u1")[1:-3],
        "every other row": np.concatenate([base, base])[::2],
        "backwards": base[::-1],
        "big-endian": base.astype(">f8"),
        "dates": base.astype("i8").view("M8[ns]"),
        "records": np.zeros(1_100_000, np.dtype([("a", "i1"), ("b", "f8")], align=True)),
        "not writeable": np.broadcast_to(base, base.shape),
    }


@pytest.mark.parametrize("name", huge_arrays())
def test_huge_arrays(name: str) -> None:
    array = huge_arrays()[name]
    assert array.nbytes > 8 << 20
    back = through_a_store(array)
    assert back.dtype == array.dtype
    assert (back.flags.c_contiguous, back.flags.writeable) == (name not in FORTRAN, False)
    np.testing.assert_array_equal(back, array)


def test_order_is_kept() -> None:
    array = np.asfortranarray(np.random.default_rng(1).random((300, 200)))
    assert through_a_store(array).flags.f_contiguous
    assert through_a_store(array[:, 3:].T).flags.c_contiguous


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_subclasses_of_arrays_are_kept() -> None:
    masked = np.ma.masked_array([1.0, 2.0, 3.0], mask=[0, 1, 0])
    back = there_and_back(masked)
    assert type(back) is np.ma.MaskedArray
    assert back.mask.tolist() == [False, True, False]
    assert type(there_and_back(np.matrix([[1, 2], [3, 4]]))) is np.matrix


def test_four_readers_cost_one_copy() -> None:
    array = np.random.default_rng(1).random((6_250_000 // 2, 2))
    assert array.nbytes == 50_000_000
    values, stats = store_round_trip(array, 4)
    assert stats["bytes_copied"] == array.nbytes
    assert stats["objects_sealed"] == 1
    for value in values:
        assert not value.flags.writeable
        assert not value.flags.owndata
        np.testing.assert_array_equal(value, array)


@pytest.mark.parametrize(
    "wrap",
    [
        lambda array: array,
        lambda array: [array, array],
        lambda array: {"deep": (1, [array])},
        lambda array: array[::-1, ::-1],
        lambda array: Frame(1, array),
        lambda array: array.tobytes(),
        lambda array: bytearray(array.tobytes()),
        lambda array: "x" * array.nbytes,
    ],
    ids=["array", "twice", "nested", "reversed", "object", "bytes", "bytearray", "text"],
)
def test_large_buffers_are_copied_once(wrap: Any) -> None:
    array = np.random.default_rng(1).random((500, 400))
    _, stats = store_round_trip(wrap(array), 3)
    assert stats["bytes_copied"] == array.nbytes
    assert stats["objects_sealed"] == 1


def test_what_is_small_travels_in_the_head() -> None:
    head, parts = encode([np.zeros(LIMIT // 8), b"x" * LIMIT])
    assert len(parts) == 1  # the head is more than the limit by now
    assert len(head) == 1
    head, parts = encode(np.zeros(LIMIT // 8 - 100))
    assert parts == []
    head, parts = encode(np.zeros(LIMIT // 8 + 1))
    assert [len(part) for part in parts] == [LIMIT + 8]
    assert len(head) < 100


def test_a_large_head_goes_to_the_store() -> None:
    value = list(range(100_000))
    values, stats = store_round_trip(value, 2)
    assert values == [value, value]
    assert stats["objects_sealed"] == 1


def test_a_view_outlives_everything_else() -> None:
    array = np.random.default_rng(1).random((500, 400))
    values, _ = store_round_trip(array, 1)
    view = values.pop()[10:20, ::2]
    del values
    garbage = [np.ones((500, 400)) for _ in range(10)]
    np.testing.assert_array_equal(view, array[10:20, ::2])
    del garbage


def test_a_full_store_falls_back_to_the_message() -> None:
    array = np.random.default_rng(1).random((500, 400))
    values, stats = store_round_trip(array, 2, capacity=1_000_000)
    assert stats["inline_fallbacks"] == 1
    assert stats["bytes_copied"] == 0
    for value in values:
        np.testing.assert_array_equal(value, array)
        assert not value.flags.writeable


def test_the_argument_is_not_changed() -> None:
    array = np.random.default_rng(1).random((500, 400))
    value = {"a": [array, array[::-1]], "b": bytearray(b"x" * 100_000)}
    before = copy.deepcopy(value)
    references = sys.getrefcount(array)
    through_a_store(value)
    assert sys.getrefcount(array) == references
    assert array.flags.writeable
    value["b"].append(1)  # nothing holds its buffer
    value["b"].pop()
    np.testing.assert_array_equal(value["a"][1], before["a"][1])
    assert value["b"] == before["b"]


def test_what_cannot_be_pickled_raises() -> None:
    with pytest.raises((pickle.PicklingError, AttributeError)):
        encode(lambda: 1)
    with open(__file__) as file, pytest.raises(TypeError):
        encode([np.zeros(3), file])


SAMPLES = [
    [1, -5, 10**40, 1.5, "text", b"bytes", None, True],
    {"k": (1, 2, [3, {"z": bytearray(b"xyz")}])},
    [np.arange(7), np.zeros((2, 3), "f4"), np.array(["a"])],
    np.zeros(LIMIT),
]


def attempts(head: bytes, parts: list[bytes], seed: int) -> Any:
    rng = random.Random(seed)
    for _ in range(3000):
        bad = bytearray(head)
        for _ in range(rng.randint(1, 3)):
            match rng.randrange(3):
                case 0 if bad:
                    bad[rng.randrange(len(bad))] = rng.randrange(256)
                case 1 if bad:
                    del bad[rng.randrange(len(bad)) :]
                case _:
                    bad.insert(rng.randint(0, len(bad)), rng.randrange(256))
        yield bytes(bad), parts[: rng.randint(0, 2)]


@pytest.mark.parametrize("number", range(len(SAMPLES)))
@pytest.mark.filterwarnings("ignore")
def test_malformed_bytes_raise(number: int) -> None:
    head, parts = encode(SAMPLES[number])
    survived = 0
    for bad, given in attempts(head, parts, number):
        try:
            decode(bad, given)
            survived += 1
        except Exception as error:  # noqa: BLE001
            assert "panic" not in type(error).__name__.lower()
    assert survived < 3000


@pytest.mark.filterwarnings("ignore")
def test_random_bytes_raise() -> None:
    rng = random.Random(7)
    for _ in range(20_000):
        head = bytes([1, rng.randrange(14)]) + rng.randbytes(rng.randrange(24))
        try:
            decode(head, [rng.randbytes(8)] * rng.randrange(2))
        except Exception as error:  # noqa: BLE001
            assert "panic" not in type(error).__name__.lower()


@pytest.mark.parametrize(
    ("head", "what"),
    [
        (b"", "format"),
        (b"\x09", "format"),
        (b"\x02", "format"),
        (b"\x01", "too early"),
        (b"\x01\xff", "unknown kind"),
        (b"\x01\x00\x00", "after its end"),
        (b"\x01\x09\xff\xff\xff\xff\x0f", "more entries than bytes"),
        (b"\x01\x07\x03", "buffer is missing"),
        (b"\x01\x0c\x00", "reference to nothing"),
        (b"\x01" + b"\x09\x01" * 200 + b"\x00", "too deeply"),
    ],
)
def test_what_is_wrong_is_said(head: bytes, what: str) -> None:
    with pytest.raises(ValueError, match=f"malformed payload: .*{what}"):
        decode(head, [])
