"""What travels is every byte of an array as its sender has it, and no other byte.

Between the fields of an array may be gaps. NumPy copies the fields only, so what is in the gaps of
its copies is what was in the memory before.
"""

from __future__ import annotations

from typing import Any

import kinds
import numpy as np
import pytest
from conftest import Run

import hprm
from hprm import _handover, _ports
from hprm._hprm import decode, digest, encode, store_round_trip
from hprm._kinds import arrow


def every_byte(array: Any) -> bytes:
    """The elements in the order of C, with their gaps."""
    elements: bytes = array.view(f"V{array.dtype.itemsize}").tobytes()
    return elements


def far(value: Any) -> Any:
    return decode(*encode(value, local=False), local=False)


def through_a_store(value: Any) -> Any:
    return store_round_trip(value, 1)[0][0]


class Plain:
    """Something for pickle."""


WAYS = {
    "far": far,
    "store": through_a_store,
    "without room": lambda value: store_round_trip(value, 1, 4096)[0][0],
    "in a list": lambda value: through_a_store([value])[0],
    "in a pickle": lambda value: through_a_store([Plain(), value])[1],
    "in a far pickle": lambda value: decode(*encode([Plain(), value]))[1],
    "to a mutable input": lambda value: _ports._copied(far(value)),
    "to a thread": lambda value: _handover.opened(_handover.frozen(value, 1 << 60)),
}

LAYOUTS = {
    "C": lambda array: array,
    "every other": lambda array: array[::2],
    "reversed": lambda array: array[::-1],
    "Fortran": lambda array: array.reshape(2, -1).T,
    "neither": lambda array: array.reshape(2, 2, -1).transpose(1, 2, 0)[:, ::-1],
    "column": lambda array: array.reshape(4, -1)[:, 1:3],
    "repeated": lambda array: np.broadcast_to(array[:3], (5, 3)),
    "0-d": lambda array: array.reshape(-1)[7:8].reshape(()),
}


@pytest.mark.parametrize("count", [12, 20_000], ids=["small", "large"])
@pytest.mark.parametrize("dtype", [kinds.ALIGNED, kinds.SCATTERED], ids=["aligned", "scattered"])
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("way", WAYS)
def test_gaps_arrive_as_they_are(way: str, layout: str, dtype: Any, count: int) -> None:
    sent = LAYOUTS[layout](kinds.marked(dtype, count))
    before = every_byte(sent)
    came = WAYS[way](sent)
    assert came.dtype == sent.dtype and came.shape == sent.shape
    assert every_byte(came) == before == every_byte(sent)
    assert came.flags.writeable == (way == "to a mutable input")
    assert digest(came) == digest(sent)


@pytest.mark.parametrize("way", ["far", "store", "in a pickle"])
def test_a_record_arrives_with_its_gaps(way: str) -> None:
    records = kinds.marked(kinds.SCATTERED, 3)
    came = WAYS[way](records[1])
    assert type(came) is np.void
    assert every_byte(np.asarray(came)) == every_byte(records[1:2])


PROGRAM = """
target Python {{ timeout: 20 ms }}
preamble {{=
import numpy as np, zlib
dt = np.dtype([("a", "u1"), ("b", "f8")], align=True)
=}}
reactor A {{
  output out
  timer t(0, 10 ms)
  state keep = {{= [] =}}
  reaction(t) -> out {{=
    np.full(20_000 * 16, 0xab, np.uint8)  # what the next arrays would find in their memory
    x = {made}
    x["b"] = 1.5
    {kept}
    out.set(x)
  =}}
}}
reactor B {{
  input inp
  reaction(inp) {{= print(zlib.crc32(inp.value.tobytes()), inp.value.tobytes()[:16].hex()) =}}
}}
federated reactor {{ a = new A()  b = new B()  a.out -> b.inp }}
"""


@pytest.mark.parametrize("made", ["np.zeros(20_000, dt)", "hprm.empty(20_000, dt)"])
@pytest.mark.parametrize("kept", ["pass", "self.keep.append(x)"], ids=["given", "kept"])
@pytest.mark.parametrize("how", [[], ["--in-process"]], ids=["processes", "threads"])
def test_a_checksum_is_the_same_at_each_tag(
    launch: Run, made: str, kept: str, how: list[str]
) -> None:
    text = PROGRAM.format(made=made, kept=kept).replace("import numpy", "import hprm, numpy")
    if made.startswith("hprm"):
        text = text.replace('x["b"]', 'x["a"] = 0\n    x["b"]')
    outcome = launch(text, *how)
    assert (outcome.code, outcome.err) == (0, "")
    said = [line.partition("] ")[2] for line in outcome.out.splitlines()]
    assert len(said) == 3 and set(said) == {said[0]}
    assert said[0].endswith(" " + "00" * 8 + np.float64(1.5).tobytes().hex())


def test_a_loan_of_elements_with_fields_begins_with_zeros() -> None:
    model = kinds.marked(kinds.SCATTERED, 8).reshape(2, 4).T
    for make in (hprm.empty, hprm.empty_like):
        np.full(8 * 19, 0xAB, np.uint8)  # leaves its memory to the next one of that size
        given = (model.shape, model.dtype) if make is hprm.empty else (model,)
        assert not any(every_byte(make(*given)))
    assert hprm.empty_like(model).strides == model.strides
    assert hprm.empty(3, [("a", object)])["a"].tolist() == [None] * 3


def test_a_writer_that_writes_less_than_it_said_is_an_error() -> None:
    pa = pytest.importorskip("pyarrow")
    batch = pa.record_batch({"a": list(range(20_000))})
    batches = [batch, batch]
    written = arrow._stream(batch.schema, batches)
    batches.pop()
    with pytest.raises(RuntimeError, match="has changed while it was being sent"):
        through_a_store(written)


def test_renaming_fields_changes_no_other_array() -> None:
    dtype = [("a", "f8"), ("in", [("b", "f8")])]
    for count in (2, 20_000):
        for _ in range(2):
            came = far(np.zeros(count, dtype))
            assert (came.dtype.names, came.dtype["in"].names) == (("a", "in"), ("b",))
            came.dtype.names = ("p", "in")
            came.dtype["in"].names = ("q",)
