"""Digests of values: equal for equal values, and different for others."""

from __future__ import annotations

import collections
import copy
import dataclasses
import datetime
import decimal
import enum
import functools
import os
import pathlib
import pickle
import subprocess
import sys
import threading
import uuid
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

from hprm import _hprm


def digest(value: Any) -> str:
    return _hprm.digest(value)[0]


def text(value: Any) -> str:
    return _hprm.digest(value)[1]


def is_opaque(value: Any) -> bool:
    return _hprm.digest(value)[2]


class Colour(enum.Enum):
    RED = 1
    GREEN = 2


class Level(enum.IntEnum):
    LOW = 1


@dataclasses.dataclass
class Pose:
    x: float
    y: float = 0.0
    scan: Any = None


@dataclasses.dataclass(frozen=True)
class Frozen:
    x: int


class Point(NamedTuple):
    x: int
    y: int


class Slots:
    __slots__ = ("a", "b")

    def __init__(self, a: Any, b: Any) -> None:
        self.a = a
        self.b = b


class Plain:
    def __init__(self, **attributes: Any) -> None:
        vars(self).update(attributes)


class Tags(set):  # type: ignore[type-arg]
    pass


class Rude:
    def __reduce_ex__(self, protocol: Any) -> Any:
        raise RuntimeError("ask somebody else")


class Tensor:
    """The elements of an array, as another library would offer them."""

    def __init__(self, array: Any) -> None:
        self.array = array

    def __dlpack__(self, **options: Any) -> Any:
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self) -> Any:
        return self.array.__dlpack_device__()

    def __reduce_ex__(self, protocol: Any) -> Any:
        raise TypeError("a tensor is not for pickle")


# Each entry makes one value; no two make equal ones.
MAKERS: list[Callable[[], Any]] = [
    lambda: None,
    lambda: True,
    lambda: False,
    lambda: 0,
    lambda: 1,
    lambda: -1,
    lambda: 1 << 63,
    lambda: -(1 << 200),
    lambda: 0.0,
    lambda: -0.0,
    lambda: 1.0,
    lambda: float("nan"),
    lambda: float("inf"),
    lambda: 1j,
    lambda: "",
    lambda: "a",
    lambda: "\ud800",
    lambda: b"",
    lambda: b"a",
    lambda: bytearray(b"a"),
    lambda: [],
    lambda: [1, 2],
    lambda: [2, 1],
    lambda: [[1], 2],
    lambda: [1, [2]],
    lambda: (),
    lambda: (1, 2),
    lambda: {},
    lambda: {"a": 1, "b": 2},
    lambda: {"b": 2, "a": 1},
    lambda: {1, 2},
    lambda: frozenset({1, 2}),
    lambda: {"a", "b", "c", "d"},
    lambda: Tags({1, 2}),
    lambda: range(3),
    lambda: slice(1, 2),
    lambda: collections.OrderedDict(a=1),
    lambda: collections.defaultdict(list, a=[1]),
    lambda: collections.defaultdict(set, a=[1]),
    lambda: collections.Counter("abc"),
    lambda: collections.deque([1, 2]),
    lambda: collections.deque([1, 2], 5),
    lambda: Colour.RED,
    lambda: Colour.GREEN,
    lambda: Level.LOW,
    lambda: Pose(1.0),
    lambda: Pose(1.0, scan=np.arange(3)),
    lambda: Frozen(1),
    lambda: Point(1, 2),
    lambda: Slots(1, [2]),
    lambda: Plain(),
    lambda: Plain(a=1),
    lambda: decimal.Decimal("1.0"),
    lambda: decimal.Decimal("1.00"),
    lambda: datetime.datetime(2026, 1, 2),
    lambda: datetime.datetime(2026, 1, 2, tzinfo=datetime.timezone.utc),
    lambda: datetime.timedelta(1),
    lambda: uuid.UUID(int=1),
    lambda: pathlib.PurePosixPath("a"),
    lambda: functools.partial(len, [1]),
    lambda: len,
    lambda: digest,
    lambda: Pose,
    lambda: np,
    lambda: np.float64(1.0),
    lambda: np.float32(1.0),
    lambda: np.int64(1),
    lambda: np.datetime64("2026-01-02"),
    lambda: np.array([]),
    lambda: np.array(1.0),
    lambda: np.array([1.0]),
    lambda: np.array([1.0, 2.0]),
    lambda: np.array([1.0, 2.0], dtype=">f8"),
    lambda: np.array([[1.0, 2.0]]),
    lambda: np.array([1, 2]),
    lambda: np.array([1, 2], dtype=np.int32),
    lambda: np.array([1.0, np.nan]),
    lambda: np.array([1.0, np.nan], dtype=np.float16),
    lambda: np.array([1.0, np.nan], dtype=np.longdouble),
    lambda: np.array([complex(1.0, np.nan)]),
    lambda: np.array([b"ab", b"c"]),
    lambda: np.array(["ab", "c"]),
    lambda: np.array([[1], "a"], dtype=object),
    lambda: np.array([(1, 2.0)], dtype=[("a", "i1"), ("b", "f8")]),
    lambda: np.ma.array([1, 2], mask=[True, False]),
    lambda: Tensor(np.arange(3)),
    lambda: Tensor(np.arange(4)),
    lambda: pickle.PickleBuffer(b"ab"),
    lambda: pickle.PickleBuffer(b"abcd"),
    lambda: memoryview(b"abcd").cast("c"),
    lambda: memoryview(b"abcd").cast("B", (2, 2)),
    lambda: memoryview(b"abcd").cast("H"),
    lambda: memoryview(np.frombuffer(b"abcd", ">i2")),
]


def test_equal_values_have_equal_digests_and_others_do_not() -> None:
    first = [digest(make()) for make in MAKERS]
    assert first == [digest(make()) for make in MAKERS]
    same = [(a, b) for a in range(len(first)) for b in range(a) if first[a] == first[b]]
    assert [(text(MAKERS[a]()), text(MAKERS[b]())) for a, b in same] == []
    opaque = [text(make()) for make in MAKERS if is_opaque(make())]
    assert opaque == []


def test_the_seed_of_hashes_does_not_matter() -> None:
    program = (
        "from hprm import _hprm\n"
        "words = {w: {w + x for x in 'abcdefgh'} for w in ('one', 'two')}\n"
        "print(_hprm.digest([words, frozenset(words), set('xyzuvw'), {(1, 'a'), (2, 'b')}])[0])"
    )
    digests = set()
    for seed in ["0", "1", "2", "3"]:
        environment = os.environ | {"PYTHONHASHSEED": seed}
        run = [sys.executable, "-c", program]
        done = subprocess.run(run, env=environment, capture_output=True, text=True, check=True)
        digests.add(done.stdout)
    assert len(digests) == 1


def test_what_is_shared_and_what_is_interned_does_not_matter() -> None:
    shared = [1, {"a": 2}]
    assert digest([shared, shared]) == digest([[1, {"a": 2}], [1, {"a": 2}]])
    interned = ["abc", "abc"]
    assert digest(interned) == digest(["abc", "".join(["a", "b", "c"])])
    pose = Pose(1.0, scan=[shared])
    assert digest([pose, pose]) == digest([pose, copy.deepcopy(pose)])
    assert digest(pose) == digest(pickle.loads(pickle.dumps(pose)))


def test_the_order_of_attributes_does_not_matter_but_that_of_keys_does() -> None:
    assert digest(Plain(a=1, b=2)) == digest(Plain(b=2, a=1))
    assert digest({"a": 1, "b": 2}) != digest({"b": 2, "a": 1})


def test_the_layout_of_an_array_does_not_matter() -> None:
    array = np.arange(24.0).reshape(4, 6)
    expected = digest(array)
    readonly = array.copy()
    readonly.flags.writeable = False
    for same in [np.asfortranarray(array), np.repeat(array, 2, axis=1)[:, ::2], readonly]:
        assert digest(same) == expected
    assert digest(array.T) != expected


def test_a_buffer_is_what_it_shows_however_it_lies() -> None:
    elements = np.arange(12.0).reshape(3, 4)
    expected = digest(memoryview(elements))
    for array in (np.asfortranarray(elements), np.repeat(elements, 2, axis=1)[:, ::2]):
        assert digest(memoryview(array)) == digest(pickle.PickleBuffer(array)) == expected
    assert text(pickle.PickleBuffer(elements)) == text(memoryview(elements))
    assert text(memoryview(elements)) == "memoryview d (3, 4)"


def test_bytes_between_fields_do_not_matter() -> None:
    dtype = np.dtype({"names": ["a", "b"], "formats": ["i1", "f8"], "offsets": [0, 8]})
    arrays = [np.frombuffer(bytearray([fill] * 32), dtype=dtype) for fill in (0, 255)]
    for array in arrays:
        array["a"], array["b"] = 1, 2.0
    assert arrays[0].tobytes() != arrays[1].tobytes()
    assert digest(arrays[0]) == digest(arrays[1])


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8", "c8", "c16"])
def test_all_nans_are_one(dtype: str) -> None:
    first, second = (np.ones(3, dtype) for _ in range(2))
    first[1], second[1] = np.nan, -np.nan
    second.view(np.uint8)[first.itemsize] ^= 1  # another payload
    assert first.tobytes() != second.tobytes()
    assert digest(first) == digest(second)
    assert digest(float("nan")) == digest(-float("nan"))


def test_cycles_end() -> None:
    def ring(length: int, last: int) -> Any:
        first = current = [0]
        for number in range(1, length):
            current.append([number if number < length - 1 else last])  # type: ignore[arg-type]
            current = current[1]  # type: ignore[assignment]
        current.append(first)  # type: ignore[arg-type]
        return first

    assert digest(ring(5, 4)) == digest(ring(5, 4))
    assert digest(ring(5, 4)) != digest(ring(5, 7)) != digest(ring(6, 4))
    me: dict[str, Any] = {"name": "me"}
    me["self"] = me
    other: dict[str, Any] = {"name": "me"}
    other["self"] = {"name": "me", "self": other}
    assert digest(me) == digest(copy.deepcopy(me)) != digest(other)


def test_what_is_shared_many_times_over_takes_no_time() -> None:
    def tower(height: int) -> Any:
        value: Any = ()
        for _ in range(height):
            value = (value, value)
        return value

    assert digest(tower(150)) == digest(tower(150)) != digest(tower(149))


def test_a_tangle_of_references_takes_no_time() -> None:
    def grid(size: int, odd: int) -> Any:
        cells = [[Plain(at=(x, y)) for x in range(size)] for y in range(size)]
        cells[-1][-1].at = odd
        for y in range(size):
            for x in range(size):
                cells[y][x].around = [cells[y - 1][x], cells[y][x - 1], {"left": cells[y][x - 2]}]
        return cells

    assert digest(grid(12, 1)) == digest(grid(12, 1))
    assert digest(grid(12, 1)) != digest(grid(12, 2))


def nested(depth: int) -> Any:
    value: Any = 1
    for _ in range(depth):
        value = [value]
    return value


def a_generator() -> Iterator[int]:
    yield 1


@pytest.mark.parametrize(
    ("value", "name"),
    [
        (threading.Lock(), "_thread.lock"),
        (lambda: 1, "builtins.function"),
        (a_generator(), "builtins.generator"),
        (Rude(), f"{__name__}.Rude"),
        ([1, Rude()], "list of 2"),
        (nested(1_000), "list of 1"),
    ],
)
def test_what_cannot_be_seen_is_marked(value: Any, name: str) -> None:
    assert _hprm.digest(value)[1:] == (name, True)
    assert digest(value) == digest(value)


def test_texts_are_short() -> None:
    for value, expected in [
        (None, "None"),
        (1.5, "1.5"),
        (1 << 5_000, "int of 5001 bits"),
        ("a" * 100, f"'{'a' * 60}'... (100)"),
        ({"a": 1}, "dict of 1"),
        (Colour.RED, "Colour.RED"),
        (np.zeros((2, 3)), "ndarray float64 (2, 3)"),
        (np.float32(1.5), "np.float32(1.5)"),
        (Pose(1.0), f"{__name__}.Pose"),
    ]:
        assert text(value) == expected
