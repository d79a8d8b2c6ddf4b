"""Values between Python and Rust: what Rust makes of what Python sends, and the other way round.

Rust's side is the example `convert` of `hprm-codec`, which decodes a value as one of a type, and
encodes it again.
"""

from __future__ import annotations

import dataclasses
import datetime
import decimal
import enum
import json
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import kinds
import numpy as np
import pytest
from processes import rust_examples

from hprm import _kinds
from hprm._hprm import decode, encode

ROOT = Path(__file__).resolve().parents[2]
LARGE = 20_000

Rust = Callable[[str, Any], Any]


@dataclasses.dataclass
class Pose:
    x: float
    label: str


class Place(NamedTuple):
    x: float
    label: str


class Command(enum.Enum):
    Stop = 1
    Other = 2


class Unnamed:
    pass


class RefusedError(Exception):
    """What Rust says of a value that does not fit the type."""


@pytest.fixture(scope="module")
def rust() -> Iterator[Rust]:
    """Sends a value to Rust, as one of a type; returns what comes back, and what Rust has seen."""
    run = [rust_examples() / "convert"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(run, cwd=ROOT, **pipes) as process:  # type: ignore[call-overload]

        def ask(kind: str, encoded: tuple[bytes, list[Any]]) -> tuple[Any, str]:
            head, parts = encoded
            buffers = [bytes(part).hex() for part in parts]
            question = {"type": kind, "head": bytes(head).hex(), "parts": buffers}
            process.stdin.write(json.dumps(question) + "\n")
            process.stdin.flush()
            answer = json.loads(process.stdout.readline())
            if "error" in answer:
                raise RefusedError(answer["error"])
            buffers = [bytes.fromhex(part) for part in answer["parts"]]
            return decode(bytes.fromhex(answer["head"]), buffers), answer["value"]

        yield ask


def same(one: Any, other: Any) -> bool:
    """Tell whether two values are equal and of the same types, NaN and arrays included."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and bool((one == other).all())
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return same(list(one.items()), list(other.items()))
    return repr(one) == repr(other)


# A type of Rust, and a value of Python that becomes one of it and comes back the same.
RETURNING = [
    ("()", None),
    ("bool", True),
    ("i8", -128),
    ("i64", -(2**63)),
    ("i128", -(2**127)),
    ("i128", 2**63),
    ("u8", 255),
    ("u64", 2**64 - 1),
    ("u128", 2**128 - 1),
    ("f32", 1.5),
    ("f64", 1e300),
    ("f64", float("nan")),
    ("f64", -0.0),
    ("char", "ß"),
    ("String", ""),
    ("String", "z\x00ß€😀"),
    ("String", "long " * LARGE),
    ("Bytes", b""),
    ("Bytes", b"\x00\xff" * LARGE),
    ("Option<f64>", None),
    ("Option<f64>", 0.5),
    ("Vec<i64>", []),
    ("Vec<i64>", list(range(-LARGE, LARGE))),
    ("Vec<Vec<f64>>", [[1.0], [], [2.0, 3.0]]),
    ("(i64, String)", (1, "a")),
    ("[f64; 3]", (1.0, 2.0, 3.0)),
    ("BTreeMap<String, i64>", {"a": 1, "b": 2}),
    ("BTreeMap<i64, bool>", {-1: True, 5: False}),
    ("Pose", {"x": 1.0, "label": "here"}),
    ("Command", "Stop"),
    ("Command", {"Drive": 0.5}),
    ("Command", {"Turn": (0.5, -3)}),
    ("Command", {"Goto": {"x": 1.0, "y": 2.0}}),
    ("Scene", {"boxes": [{"x": 0.5, "label": "a"}], "image": None}),
    ("Scene", {"boxes": [], "image": np.arange(6, dtype="u1").reshape(2, 3)}),
    ("Array<bool>", np.array([[True], [False]])),
    ("Array<i16>", np.arange(4, dtype="i2")),
    ("Array<u32>", np.zeros((2, 0, 3), "u4")),
    ("Array<i64>", np.array(5)),
    ("Array<f32>", np.ones(3, "f4")),
    ("Array<f64>", np.arange(LARGE * 2.0).reshape(2, LARGE)),
    ("Array<[f64; 2]>", np.array([1j, 2 - 3j])),
    ("Dynamic", [None, True, 2**100, 1.5, "a", b"b", (1, [2]), {"k": (), 3: {}}]),
    ("Dynamic", {"a": np.arange(3), "b": [np.zeros(LARGE, "f4")]}),
]


@pytest.mark.parametrize(("kind", "value"), RETURNING)
def test_a_value_returns(rust: Rust, kind: str, value: Any) -> None:
    returned, shown = rust(kind, encode(value))
    assert same(returned, value), shown


TWICE = np.arange(LARGE * 1.0)
SHARED = [1.0, 2.0]

# What Rust takes as well, and what it is there.
BECOMING = [
    ("f64", 7, 7.0),
    ("f64", 2**70, float(2**70)),
    ("f64", np.float32(0.5), 0.5),
    ("i64", np.int8(-3), -3),
    ("u64", np.uint64(2**64 - 1), 2**64 - 1),
    ("bool", np.bool_(True), True),
    ("String", np.str_("text"), "text"),
    ("Bytes", bytearray(b"ab"), b"ab"),
    ("Bytes", memoryview(b"ab"), b"ab"),
    ("Vec<u8>", b"ab", [97, 98]),
    ("Vec<i64>", (1, 2), [1, 2]),
    ("Vec<i64>", {1, 2}, [1, 2]),
    ("Vec<i64>", frozenset({3}), [3]),
    ("Vec<i64>", np.array([1, 2], "i4"), [1, 2]),
    ("Vec<f64>", np.array([1, 2], "i4"), [1.0, 2.0]),
    ("Vec<f64>", [np.float64(1), 2], [1.0, 2.0]),
    ("Vec<bool>", np.array([True]), [True]),
    ("Vec<Vec<f64>>", np.array([[1, 2], [3, 4]], order="F"), [[1.0, 2.0], [3.0, 4.0]]),
    ("Vec<Vec<f64>>", [SHARED, SHARED], [SHARED, SHARED]),
    ("Vec<(u8, u8)>", [[1, 2], (3, 4)], [(1, 2), (3, 4)]),
    ("(f64, f64)", 1 - 2j, (1.0, -2.0)),
    ("(i64, String)", [1, "a"], (1, "a")),
    ("(i64, String)", kinds.Old(1, "a"), (1, "a")),
    ("Pose", Pose(1.5, "a"), {"x": 1.5, "label": "a"}),
    ("Pose", Place(1.5, "a"), {"x": 1.5, "label": "a"}),
    ("Pose", {"label": "a", "x": 2, "more": [1, {2}]}, {"x": 2.0, "label": "a"}),
    (
        "Vec<Pose>",
        [Place(1.0, "a"), Place(2.0, "b")],
        [{"x": 1.0, "label": "a"}, {"x": 2.0, "label": "b"}],
    ),
    ("Command", Command.Stop, "Stop"),
    ("Vec<Command>", [Command.Stop, Command.Stop], ["Stop", "Stop"]),
    ("Array<f64>", [1, 2.5], np.array([1, 2.5])),
    ("Array<f64>", TWICE.reshape(2, -1).T, TWICE.reshape(2, -1).T),
    ("Array<f64>", TWICE[::2], TWICE[::2]),
    ("Dynamic", [TWICE, TWICE], [TWICE, TWICE]),
    ("Dynamic", Pose(1.5, "a"), {"x": 1.5, "label": "a"}),
    ("Dynamic", [np.float32(0.5), Command.Stop, {1}, 1j], [0.5, "Stop", [1], [0.0, 1.0]]),
]


@pytest.mark.parametrize(("kind", "value", "becomes"), BECOMING)
def test_a_value_becomes_another(rust: Rust, kind: str, value: Any, becomes: Any) -> None:
    returned, shown = rust(kind, encode(value))
    assert same(returned, becomes), shown


def cycle() -> Any:
    members: list[Any] = []
    members.append(members)
    return members


ONLY_PYTHON = (
    ", which only Python reads (hint: send numbers, strings, lists, dicts, dataclasses or NumPy "
    "arrays)"
)

# A type of Rust, a value that is none of it, and what the error says.
REFUSED = [
    ("u8", 256, "`value`: expected u8, found the int 256"),
    ("u8", 2.0, "`value`: expected u8, found the float 2.0"),
    ("u8", None, "`value`: expected u8, found None"),
    ("u128", 2**130, "`value`: expected u128, found an int of about 136 bits"),
    ("char", "ab", "`value`: expected a character, found the str 'ab'"),
    ("bool", 1, "`value`: expected a boolean, found the int 1"),
    ("String", b"ab", "`value`: expected a string, found bytes"),
    ("Strict", {"x": 1, "y": 2}, "`value{key 'y'}`: the receiver knows no field 'y'; it knows 'x'"),
    ("Pose", (1, "a"), "`value`: expected struct Pose, found a tuple"),
    ("Pose", {"x": 1}, "`value`: the field 'label' is missing"),
    ("Pose", Place(1, 2), "`value.label`: expected a string, found the int 2"),  # type: ignore
    (
        "Command",
        Command.Other,
        "knows no variant 'Other'; it knows 'Stop', 'Drive', 'Turn', 'Goto'",
    ),
    (
        "Command",
        {"Turn": (1,)},
        "`value['Turn']`: expected tuple variant Command::Turn, found a tuple of 1 members",
    ),
    (
        "Scene",
        {"boxes": [{"x": 1, "label": "a"}, {"x": "b"}]},
        "`value['boxes'][1]['x']`: expected f64, found the str 'b'",
    ),
    (
        "Array<f32>",
        np.zeros(1),
        "expected an array of the dtype <f4, found one of the dtype <f8 "
        "(hint: send array.astype('<f4'), or receive an Array<f64>)",
    ),
    ("Array<f64>", np.zeros(1, ">f8"), "the dtype is >f8 (hint: send array.astype('<f8'))"),
    ("Array<f64>", np.zeros(1, "f2"), "array's dtype <f2 (hint: send array.astype('f4'))"),
    ("Array<i64>", np.zeros(1, "M8[ns]"), "dtype <M8[ns] (hint: send array.view('i8'))"),
    ("Array<i64>", np.zeros(1, [("a", "i8")]), "elements have fields, which only Python reads"),
    ("Array<i64>", np.ma.masked_array([1]), "found a masked NumPy array" + ONLY_PYTHON),
    ("String", decimal.Decimal(1), "expected a string, found a decimal.Decimal" + ONLY_PYTHON),
    ("Dynamic", [datetime.date.min], "both know, found a datetime.date" + ONLY_PYTHON),
    ("Dynamic", cycle(), "`value[0]`: the value contains itself, which only Python can receive"),
    (
        "Dynamic",
        Unnamed(),
        "a pickle of test_codec.Unnamed, which only Python can read (hint: send a dataclass",
    ),
]


@pytest.mark.parametrize(("kind", "value", "message"), REFUSED)
def test_errors_say_where_and_what(rust: Rust, kind: str, value: Any, message: str) -> None:
    with pytest.raises(RefusedError) as refused:
        rust(kind, encode(value))
    assert message in str(refused.value)


OTHERS = {
    **kinds.standard(),
    **kinds.arrays(),
    **kinds.buffers(),
}


@pytest.mark.parametrize("name", OTHERS)
def test_values_of_all_kinds_arrive_or_are_refused_by_name(rust: Rust, name: str) -> None:
    values = OTHERS[name] if isinstance(OTHERS[name], list) else [OTHERS[name]]
    for value in values:
        try:
            rust("Dynamic", encode(value))
        except RefusedError as refused:
            text = str(refused)
            assert text.startswith("`value"), text
            assert "does not know" not in text, text


def test_rust_has_a_name_for_every_class_of_python(rust: Rust) -> None:
    for code in (*_kinds._MAKERS, 99):
        with pytest.raises(RefusedError) as refused:
            rust("Dynamic", (bytes([1, 19, code, 0]), []))
        assert ("does not know" in str(refused.value)) == (code == 99)


@pytest.mark.skipif("pydantic" in kinds.MISSING, reason="pydantic is not installed")
def test_a_model_of_pydantic_is_a_struct(rust: Rust) -> None:
    import pydantic

    model = pydantic.create_model("Model", x=(float, ...), label=(str, ...))
    globals()["Model"] = model
    model.__module__ = __name__
    returned, _ = rust("Pose", encode(model(x=1.5, label="a")))
    assert returned == {"x": 1.5, "label": "a"}


def test_the_example_of_the_document_is_what_python_sends() -> None:
    text = (ROOT / "docs" / "reference" / "codec.md").read_text()
    section = text.partition("## An example")[2].partition("\n## ")[0]
    documented = "".join(re.findall(r"^\| `([0-9a-f ]+)` \|", section, flags=re.MULTILINE))
    size = [3, -1]
    scan = np.array([[1.0, 2.5]], "f4")
    value = {"size": size, "ok": (True, None), "same": size, "scan": scan}
    assert encode(value) == (bytes.fromhex(documented), [])
