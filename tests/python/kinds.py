"""Values of every kind that needs no pickle, for several test modules, and when two are the same.

Values of optional libraries are there if the library is installed; ``MISSING`` names the others.
"""

from __future__ import annotations

import array
import collections
import ctypes
import dataclasses
import datetime
import decimal
import enum
import fractions
import importlib.util
import pathlib
import pickle
import uuid
import zoneinfo
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

# What requirements-dev.txt installs, and what is too large for it.
INSTALLED = ("pandas", "pyarrow", "attrs", "pydantic")
OPTIONAL = ("torch",)

MISSING = [
    name
    for name in (*INSTALLED, *OPTIONAL)
    if importlib.util.find_spec({"attrs": "attr"}.get(name, name)) is None
]

# More than travels in a message.
LARGE = 20_000


@dataclasses.dataclass
class Pose:
    x: float
    scan: Any = None


@dataclasses.dataclass(frozen=True, slots=True)
class Packed:
    x: float
    scan: Any = None


@dataclasses.dataclass
class Derived(Pose):
    extra: Any = dataclasses.field(default=None, compare=False)

    def __post_init__(self) -> None:
        self.counted = getattr(self, "counted", 0) + 1


class Point(NamedTuple):
    x: float
    data: Any = ()


Old = collections.namedtuple("Old", "a b")


class Colour(enum.Enum):
    RED = 1
    CRIMSON = 1
    BLUE = "blue"


class Rights(enum.Flag):
    READ = 1
    WRITE = 2


class Level(enum.IntEnum):
    LOW = 1


class Outer:
    @dataclasses.dataclass
    class Inner:
        x: int


class Shares:
    """What a small library that knows DLPack has."""

    def __init__(self, elements: Any) -> None:
        self.elements = np.asarray(elements)

    def __dlpack__(self, **options: Any) -> Any:
        return self.elements.__dlpack__(**options)

    def __dlpack_device__(self) -> Any:
        return self.elements.__dlpack_device__()


def standard() -> dict[str, Any]:
    utc = datetime.timezone.utc
    return {
        "set": {1, "a", (2.5, None), b"x", frozenset({1, frozenset({"y"})})},
        "empty sets": [set(), frozenset()],
        "complex": [1j, complex("nan-infj").imag, -0.0 + 2j],
        "decimal": [decimal.Decimal("1.50"), decimal.Decimal("-Infinity"), decimal.Decimal("1E+9")],
        "fraction": fractions.Fraction(-1, 3),
        "datetime": [
            datetime.datetime(2026, 3, 1, 12, 30, 1, 999_999, fold=1),
            datetime.datetime(2026, 3, 1, tzinfo=utc),
            datetime.datetime(2026, 3, 1, tzinfo=zoneinfo.ZoneInfo("Europe/Vienna")),
            datetime.datetime.min,
        ],
        "date": datetime.date(1, 1, 1),
        "time": [datetime.time(23, 59, 59, 1, fold=1), datetime.time(1, tzinfo=utc)],
        "timedelta": [datetime.timedelta(-1, 5, 7), datetime.timedelta.max],
        "timezone": [
            datetime.timezone(datetime.timedelta(hours=-3), "here"),
            datetime.timezone(datetime.timedelta(minutes=30)),
        ],
        "uuid": [uuid.UUID(int=2**127 + 5), uuid.UUID(int=5, is_safe=uuid.SafeUUID.unsafe)],
        "path": [
            pathlib.Path("/a/../b c"),
            pathlib.PurePosixPath("x"),
            pathlib.PureWindowsPath("c:/x"),
        ],
        "range": [range(3), range(2**70, 0, -3)],
        "slice": [slice(1, None, -1), slice(None)],
        "constants": [..., NotImplemented],
        "lone surrogate": "\udc80 lone",
        "array": [array.array("d", [1.5, -2]), array.array("i"), array.array("q", range(LARGE))],
        "dataclass": [Pose(1.0, [1]), Derived(2.0, {"a": ()}, b"x"), Outer.Inner(3)],
        "slots": Packed(1.5, {"a": (1, 2)}),
        "named tuple": [Point(1.0, [2]), Old(1, {"b": ()})],
        "enum": [Colour.CRIMSON, Colour.BLUE, Level.LOW, {Colour.RED: Level.LOW}],
        "flags": [Rights.READ, Rights.READ | Rights.WRITE, Rights(0)],
    }


def arrays() -> dict[str, Any]:
    record = np.dtype([("x", "<f4"), ("name", "S3"), ("sub", [("y", ">i2", (2,))])])
    titled = np.dtype({"names": ["a"], "formats": ["<i4"], "offsets": [4], "titles": ["t"]})
    records = np.zeros(LARGE, record)
    records["x"] = range(LARGE)
    base = np.arange(24.0 * LARGE).reshape(4, LARGE, 6)
    return {
        "strided": [base[::-1, 3::7, ::2], base.T, base[:, 0]],
        "records": [records[::3], records[5], np.zeros(3, titled), np.zeros((), record)],
        "aligned": np.zeros(3, np.dtype([("a", "i1"), ("b", "f8")], align=True)),
        "dates": np.array(["2026-01-01", "NaT"], "M8[D]"),
        "durations": np.array([[1, 2], [3, 4]], "m8[25us]"),
        "numbers": [
            np.float32(1.5),
            np.int8(-1),
            np.bool_(True),
            np.complex64(1j),
            np.longdouble(2),
        ],
        "instants": [np.datetime64("2026-01-01"), np.timedelta64(5, "ms"), np.datetime64("NaT")],
        "numpy strings": [np.str_("€"), np.bytes_(b"x"), np.str_("")],
        "objects": [np.array([[1, "x"], [None, [2]]], object), np.array([[1], [2]], object)[:0]],
        "masked": np.ma.masked_array([1.0, 2.0, 3.0], mask=[0, 1, 0], fill_value=7.0),
        "unmasked": np.ma.masked_array([1, 2, 3]),
    }


# What a C program would send: with gaps between its fields.
class Reading(ctypes.Structure):
    _fields_ = [("state", ctypes.c_byte), ("value", ctypes.c_double), ("count", ctypes.c_long)]


# A dtype with gaps, as NumPy makes it, and one with gaps everywhere and a field in a field.
ALIGNED = np.dtype([("a", "u1"), ("b", "f8")], align=True)
SCATTERED = np.dtype(
    {
        "names": ["p", "q"],
        "formats": ["<u2", np.dtype({"names": ["r"], "formats": ["u1"], "offsets": [3]})],
        "offsets": [5, 9],
        "itemsize": 19,
    }
)


def marked(dtype: np.dtype[Any], count: int) -> Any:
    """Return an array that has numbers in its gaps, too."""
    numbers = np.arange(count * dtype.itemsize) % 251 + 1
    return np.frombuffer(bytearray(numbers.astype(np.uint8).tobytes()), dtype)


def buffers() -> dict[str, Any]:
    halves = np.arange(5, dtype="f2")
    steps = np.arange(24.0).reshape(2, 3, 4)
    readings = (Reading * 2)(Reading(1, 2.5, -3), Reading(4, 5.5, 6))
    numbers = [(ctypes.c_int * 3)(1, 2, 3), (ctypes.c_long * 2)(4, 5), ctypes.c_float(1.5)]
    return {
        "halves": [memoryview(halves), memoryview(np.arange(2 * LARGE, dtype="f2"))],
        "big-endian buffer": memoryview(np.arange(5, dtype=">f8")),
        "complex buffers": [memoryview(np.array([1j, 2])), memoryview(np.array(1j, "c8"))],
        "0-d buffers": [memoryview(np.array(3.5)), memoryview(np.array(7, ">i2"))],
        "structured buffers": [
            memoryview(marked(ALIGNED, 3)),
            memoryview(marked(ALIGNED, LARGE)),
            memoryview(marked(ALIGNED, 9).reshape(3, 3))[::2],
        ],
        "text buffers": [memoryview(np.array(["ab", "c"])), memoryview(np.array([b"ab", b"c"]))],
        "small buffers": [
            memoryview(b"abc").cast("c"),
            memoryview(b"\1\0").cast("?"),
            memoryview(b"ab").cast("b"),
            memoryview(np.zeros(2, "g")),
            memoryview(np.zeros(2, "V5")),
        ],
        "buffers in dimensions": [
            memoryview(steps),
            memoryview(np.asfortranarray(steps)),
            memoryview(np.asfortranarray(np.arange(2.0 * LARGE).reshape(2, LARGE))),
            memoryview(steps[::-1, :, ::2]),
            memoryview(np.zeros((0, 3))),
            memoryview(np.zeros((2, 0), ">i4")),
        ],
        "buffers of C": [memoryview(each) for each in (readings, readings[0], *numbers)],
        "PickleBuffer": [
            pickle.PickleBuffer(b"xyz"),
            pickle.PickleBuffer(np.arange(7.0)),
            pickle.PickleBuffer(np.arange(float(LARGE))),
            pickle.PickleBuffer(np.asfortranarray(steps + 1)),
            pickle.PickleBuffer(np.array(4.5, "f2")),
            pickle.PickleBuffer(marked(SCATTERED, 3)),
            pickle.PickleBuffer(readings[1]),
        ],
    }


def of_arrow() -> dict[str, Any]:
    import pyarrow as pa

    words = pa.array(["a", None, "ccc"])
    rest = words[1:]
    # Whatever reads a slice counts its nulls, and pyarrow pickles it differently then.
    assert rest.null_count == 1
    table = pa.table({"n": range(LARGE), "s": [str(i) for i in range(LARGE)]})
    return {
        "arrow array": [pa.array([1, None, 3]), words, rest, pa.array([], pa.float32())],
        "arrow nested": pa.array([{"a": [1, 2]}, None, {"a": []}]),
        "arrow dictionary": pa.array(["x", "y", "x"]).dictionary_encode(),
        "arrow batch": pa.record_batch({"a": [1, 2], "b": [None, "y"]}),
        "arrow table": [
            table,
            table[10:-10].select(["s"]),
            table.replace_schema_metadata({"k": "v"}),
        ],
        "arrow chunks": pa.chunked_array([[1], [2, 3]]),
        "arrow schema": pa.schema([("a", pa.int32()), pa.field("b", pa.string(), nullable=False)]),
        "arrow scalar": [pa.scalar(3), pa.scalar(None, pa.string())],
    }


def of_pandas() -> dict[str, Any]:
    import pandas as pd
    import pyarrow as pa

    days = pd.date_range("2026-01-01", periods=4, freq="D")
    mixed = pd.DataFrame(
        {
            "i": range(4),
            "f": [1.5, None, 2, 3],
            "s": ["a", None, "b", "c"],
            "t": days,
            "z": days.tz_localize("Europe/Vienna"),
            "c": pd.Categorical(list("abab"), ordered=True),
            "n": pd.array([1, None, 3, 4], "Int16"),
            "b": pd.array([True, None, False, True], "boolean"),
            "F": pd.array([1.5, None, 2, 3], "Float32"),
            "o": [object, 1, "x", None],
        }
    ).drop(columns="o")
    mixed.attrs["unit"] = "m"
    column = [pd.array([1, None], dtype="Int64"), pd.Categorical(["a", None])]
    # Whatever reads a column has pandas make its dtypes, which it then pickles with the column.
    for each in (*(mixed[name].array for name in mixed), *column):
        getattr(each.dtype, "numpy_dtype", None)
    return {
        "frame": mixed,
        "large frame": pd.DataFrame(np.arange(3.0 * LARGE).reshape(LARGE, 3), columns=list("xyz")),
        "frame by days": mixed.set_index("t").loc[:, ["i", "s"]],
        "frame with equal names": pd.DataFrame([[1, 2.5]], columns=["a", "a"]),
        "frame of objects": pd.DataFrame({"a": [[1], {"b": 2}]}, dtype=object),
        "empty frames": [pd.DataFrame(), pd.DataFrame(index=[1, 2]), pd.DataFrame(columns=["a"])],
        "series": pd.Series([1, 2, 3], index=["x", "y", "z"], name=("a", 1)),
        "strings of Python": pd.Series(["a", None], dtype="string[python]"),
        "strings of Arrow": pd.Series(["a", None], dtype="string[pyarrow]"),
        "series of Arrow": pd.Series([1, None], dtype=pd.ArrowDtype(pa.int64())),
        "index": [
            pd.Index(["a", "b"], name="n"),
            pd.Index([1.5, 2]),
            pd.RangeIndex(2, 9, 3, name="r"),
        ],
        "index of times": [days, days.tz_localize("UTC"), days - days[0], days[[0, 3, 1]]],
        "index of levels": pd.MultiIndex.from_product([[1, 2], ["a", "b"]], names=["x", None]),
        "index of periods": [pd.period_range("2026", periods=3, freq="M"), pd.interval_range(0, 3)],
        "index of categories": pd.CategoricalIndex(["a", "b", "a"]),
        "column": column,
        "pandas scalars": [
            pd.Timestamp("2026-01-01 12:00:00.000000001", tz="Asia/Tokyo"),
            pd.Timestamp("2026-01-01"),
            pd.Timedelta(5, "ns"),
        ],
        "missing": [pd.NA, pd.NaT],
    }


def of_attrs() -> dict[str, Any]:
    return {"attrs": [Record(1, [2]), Loose(3, {"a": 4})]}


def of_pydantic() -> dict[str, Any]:
    return {"pydantic": Message(x=1, inside={"a": [Message(x=2)]})}


def of_torch() -> dict[str, Any]:
    import torch

    base = torch.arange(6.0 * LARGE).reshape(3, 2, LARGE)
    return {
        "tensor": [base, torch.tensor(3), torch.zeros(0, 2), torch.tensor([True, False])],
        "tensor with strides": [base.permute(2, 0, 1), base[:, 1, ::3], base[0, 0].expand(4, -1)],
        "tensor of bfloat16": [base.to(torch.bfloat16), torch.tensor(1.5, dtype=torch.bfloat16)],
        "tensor of complex": torch.tensor([1j, 2]).conj(),
        "tensor with gradient": torch.ones(2, requires_grad=True),
        "parameter": torch.nn.Parameter(torch.ones(2)),
    }


if "attrs" not in MISSING:
    import attrs

    @attrs.define
    class Record:
        x: int
        y: Any = None

    @attrs.define(slots=False, frozen=True)
    class Loose:
        x: int
        y: Any = None


if "pydantic" not in MISSING:
    import pydantic

    class Message(pydantic.BaseModel):
        x: int
        inside: dict[str, Any] = {}
        _hidden: int = 5


def every() -> dict[str, Any]:
    """A value of every kind of which the library is there."""
    of: dict[str, Callable[[], dict[str, Any]]] = {
        "pyarrow": of_arrow,
        "pandas": of_pandas,
        "attrs": of_attrs,
        "pydantic": of_pydantic,
        "torch": of_torch,
    }
    values = standard() | arrays() | buffers()
    for library, some in of.items():
        if library not in MISSING:
            values |= some()
    return values


def same(one: Any, other: Any) -> bool:
    """Tell whether two values are equal, of one type, and so is what they hold.

    A ``PickleBuffer`` counts as the view that arrives for it.
    """
    if isinstance(one, pickle.PickleBuffer) or isinstance(other, pickle.PickleBuffer):
        return same(memoryview(one), memoryview(other))
    if type(one) is not type(other):
        return False
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, (np.ndarray, np.generic)):
        return _same_arrays(one, other)
    if isinstance(one, memoryview):
        return all(
            getattr(one, name) == getattr(other, name)
            for name in ("format", "shape", "itemsize", "f_contiguous")
        ) and (one.tobytes() == other.tobytes())
    library = type(one).__module__.partition(".")[0]
    if library == "pandas":
        return _same_in_pandas(one, other)
    if library == "torch":
        return _same_tensors(one, other)
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        same_rest = getattr(one, "__dict__", {}).keys() == getattr(other, "__dict__", {}).keys()
        return same_rest and all(same(getattr(one, n), getattr(other, n)) for n in names)
    if library == "pyarrow" and hasattr(one, "schema"):
        return bool(one.equals(other) and one.schema.equals(other.schema, check_metadata=True))
    return bool(one == other) or (one != one and other != other)


def _same_arrays(one: Any, other: Any) -> bool:
    if one.dtype != other.dtype or one.shape != other.shape:
        return False
    if isinstance(one, np.ma.MaskedArray):
        same_masks = np.array_equal(np.ma.getmaskarray(one), np.ma.getmaskarray(other))
        return same_masks and one.fill_value == other.fill_value and same(one.data, other.data)
    if one.dtype == object:
        return same(one.tolist(), other.tolist())
    np.testing.assert_array_equal(one, other)
    return True


def _same_in_pandas(one: Any, other: Any) -> bool:
    import pandas as pd
    import pandas.testing as check

    if one is pd.NA or one is pd.NaT:
        return one is other
    if isinstance(one, (pd.Timestamp, pd.Timedelta)):
        return bool(one == other) and one.unit == other.unit
    if isinstance(one, pd.DataFrame):
        check.assert_frame_equal(one, other, check_exact=True)
        return one.attrs == other.attrs
    if isinstance(one, pd.Series):
        check.assert_series_equal(one, other, check_exact=True)
    elif isinstance(one, pd.Index):
        check.assert_index_equal(one, other)
        return getattr(one, "freq", None) == getattr(other, "freq", None)
    else:
        check.assert_extension_array_equal(one, other)
    return True


def _same_tensors(one: Any, other: Any) -> bool:
    import torch

    alike = one.dtype == other.dtype and one.requires_grad == other.requires_grad
    return alike and torch.equal(one.resolve_conj().view_as(one), other.resolve_conj())
