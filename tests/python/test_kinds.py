"""Values of known classes arrive as pickle would deliver them, but without pickle."""

from __future__ import annotations

import ctypes
import io
import os
import pickle
import random
import subprocess
import sys
import textwrap
from typing import Any

import kinds
import numpy as np
import pytest

from hprm import _hprm
from hprm._hprm import decode, encode, store_round_trip

EVERY = kinds.every()
# The same values again, which no other test has read.
UNREAD = kinds.every()

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


def far_and_back(value: Any) -> Any:
    """Through the codec as if to another machine, where pickle may not help."""
    return decode(*encode(value, local=False), local=False)


def through_a_store(value: Any) -> Any:
    values, _ = store_round_trip(value, 1)
    return values[0]


class Reference(pickle.Pickler):
    """Python's own, which takes buffers but not views of them, and only those in a row."""

    def reducer_override(self, obj: Any) -> Any:
        if type(obj) is not memoryview:
            return NotImplemented
        if obj.contiguous:
            return memoryview, (pickle.PickleBuffer(obj),)
        elements = np.asarray(obj)
        packed = np.zeros_like(elements, order="C")
        packed.view(f"V{obj.itemsize}")[...] = elements.view(f"V{obj.itemsize}")
        return memoryview, (pickle.PickleBuffer(packed),)


def pickled(value: Any) -> tuple[bytes, list[pickle.PickleBuffer]]:
    file, buffers = io.BytesIO(), []
    Reference(file, protocol=5, buffer_callback=buffers.append).dump(value)
    return file.getvalue(), buffers


def through_pickle(value: Any) -> Any:
    data, buffers = pickled(value)
    return pickle.loads(data, buffers=[memoryview(buffer).toreadonly() for buffer in buffers])


def test_what_is_not_tested_here_is_known() -> None:
    # `make test` needs these libraries; the optional ones are too large for that.
    absent = sorted(set(kinds.MISSING) - set(kinds.OPTIONAL))
    assert not absent, f"requirements-dev.txt installs these, but they are not there: {absent}"
    for name in kinds.MISSING:
        print(f"not installed, so its values are not tested: {name}")


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("way", [far_and_back, through_a_store])
def test_a_value_comes_back_as_from_pickle(name: str, way: Any) -> None:
    value = EVERY[name]
    assert kinds.same(way(value), through_pickle(value))
    inside = {"a": [value, (value,)]}
    back = way(inside)
    assert kinds.same(back, through_pickle(inside))
    assert back["a"][0] is back["a"][1][0]


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("way", [far_and_back, through_a_store])
def test_a_trace_sees_no_difference_between_a_value_and_what_arrives(name: str, way: Any) -> None:
    value = EVERY[name]
    digest, _, opaque = _hprm.digest(value)
    assert _hprm.digest(way(value))[::2] == (digest, opaque)


@pytest.mark.parametrize("name", EVERY)
def test_the_argument_is_not_changed(name: str) -> None:
    value = UNREAD[name]
    before = pickled(value)[0]
    digest = _hprm.digest(value)
    assert pickled(value)[0] == before
    through_a_store([value, value])
    assert (_hprm.digest(value), pickled(value)[0]) == (digest, before)


@pytest.mark.parametrize("name", EVERY)
def test_a_trace_sees_the_same_at_both_ends(name: str) -> None:
    value = EVERY[name]
    digest, _, opaque = _hprm.digest(value)
    assert not opaque
    for way in (far_and_back, through_a_store, through_pickle):
        assert _hprm.digest(way(value))[0] == digest


def test_a_trace_tells_kinds_apart_in_every_process() -> None:
    digests = [_hprm.digest(value)[0] for value in EVERY.values()]
    assert len(set(digests)) == len(digests)
    program = """
        import sys
        sys.path.insert(0, sys.argv[1])
        import kinds
        from hprm._hprm import digest
        for value in kinds.every().values():
            print(digest(value)[0])
    """
    folder = str(kinds.pathlib.Path(kinds.__file__).parent)
    for seed in "12":
        done = subprocess.run(
            [sys.executable, "-c", textwrap.dedent(program), folder],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.split() == digests


def test_random_values() -> None:
    """Whatever is nested in whatever comes back as from pickle."""
    rng = random.Random(5)
    leaves = [value for name, value in EVERY.items() if "large" not in name and name != "strided"]

    def draw(depth: int) -> Any:
        if depth == 0 or rng.random() < 0.3:
            return rng.choice([*leaves, 1, 2.5, "text", None, True])
        members = [draw(depth - 1) for _ in range(rng.randrange(4))]
        match rng.randrange(6):
            case 0:
                return members
            case 1:
                return tuple(members)
            case 2:
                return {f"k{i}": member for i, member in enumerate(members)}
            case 3:
                return kinds.Pose(rng.random(), members)
            case 4:
                return kinds.Packed(rng.random(), members)
            case _:
                return kinds.Point(rng.random(), members)

    for _ in range(150):
        value = draw(3)
        assert kinds.same(far_and_back(value), through_pickle(value))


def test_sets_are_written_in_one_order() -> None:
    words = [f"word {i}" for i in range(50)]
    shuffled = words.copy()
    random.Random(1).shuffle(shuffled)
    assert encode(set(words)) == encode(set(shuffled))
    nested = [frozenset({frozenset(some[:9]), frozenset(some[9:])}) for some in (words, shuffled)]
    assert encode(nested[0])[0][:2] == b"\x01\x11"
    program = f"from hprm._hprm import encode; print(encode(set({words!r}), False)[0].hex())"
    for seed in "123":
        done = subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.strip() == encode(set(words))[0].hex()


def test_deep_sets_take_no_time() -> None:
    value: Any = frozenset({1})
    for _ in range(90):
        value = frozenset({value, "x"})
    assert far_and_back(value) == value


LARGE_ONES = {
    "memoryview": lambda: memoryview(np.zeros((kinds.LARGE, 2))),
    "array.array": lambda: EVERY["array"][2],
    "strided": lambda: EVERY["strided"][0],
    "tensor": lambda: EVERY["tensor with strides"][0],
    "bfloat16": lambda: EVERY["tensor of bfloat16"][0],
    "arrow": lambda: EVERY["arrow table"][0],
    "frame": lambda: EVERY["large frame"],
    "shared": lambda: kinds.Shares(np.zeros(kinds.LARGE)),
    "dataclass": lambda: kinds.Pose(1.0, np.zeros(kinds.LARGE)),
}


@pytest.mark.parametrize("name", LARGE_ONES)
def test_large_buffers_are_out_of_band(name: str) -> None:
    if name in ("tensor", "bfloat16"):
        pytest.importorskip("torch")
    value = LARGE_ONES[name]()
    head, parts = encode(value, local=False)
    assert len(head) < 2_000
    assert sum(map(len, parts)) > 65_536
    _, stats = store_round_trip(value, 3)
    assert stats["bytes_copied"] == sum(map(len, parts))


class Plain:
    """Something for pickle."""


@pytest.mark.parametrize("name", EVERY)
def test_a_value_inside_of_a_pickle_comes_back_too(name: str) -> None:
    back = through_a_store([Plain(), EVERY[name]])
    assert type(back[0]) is Plain
    assert kinds.same(back[1], through_pickle(EVERY[name]))


# An object that shares its memory is pickled as its class says.
@pytest.mark.parametrize("name", [name for name in LARGE_ONES if name != "shared"])
def test_large_buffers_inside_of_a_pickle_are_out_of_band(name: str) -> None:
    if name in ("tensor", "bfloat16"):
        pytest.importorskip("torch")
    _, parts = encode(LARGE_ONES[name](), local=False)
    head, others = encode([Plain(), LARGE_ONES[name]()])
    assert len(head) < 2_000
    assert [len(part) for part in others] == [len(part) for part in parts]


def test_memoryviews_come_back_read_only() -> None:
    for elements in (np.arange(12).reshape(3, 4), np.arange(6.0)[::2], np.arange(kinds.LARGE)):
        view = memoryview(elements)
        back = through_a_store(view)
        assert type(back) is memoryview
        assert back.readonly
        assert (back.format, back.shape, back.tolist()) == (view.format, view.shape, view.tolist())


@pytest.mark.parametrize("name", kinds.buffers())
@pytest.mark.parametrize("way", [far_and_back, through_a_store])
def test_buffers_arrive_as_read_only_views(name: str, way: Any) -> None:
    value = EVERY[name]
    for sent in value if isinstance(value, list) else [value]:
        for back in (way(sent), through_a_store([Plain(), sent])[1]):
            assert type(back) is memoryview and back.readonly
            assert kinds.same(back, sent)
            assert kinds.same(way(back), sent)
            if "C" not in name and "PickleBuffer" not in name:
                np.testing.assert_array_equal(np.asarray(back), np.asarray(memoryview(sent)))


def test_a_buffer_with_gaps_between_its_elements_is_packed() -> None:
    for elements in (np.arange(12.0).reshape(3, 4)[:, ::2], kinds.marked(kinds.ALIGNED, 9)[::-2]):
        view = memoryview(elements)
        ways = [(way, sent) for way in (far_and_back, through_a_store) for sent in (view, elements)]
        for way, sent in ways:
            back = way(pickle.PickleBuffer(sent))
            assert back.c_contiguous and (back.format, back.shape) == (view.format, view.shape)
            assert back.tobytes() == view.tobytes()
        assert through_a_store([Plain(), view])[1].tobytes() == view.tobytes()
        # What is pickled obeys the rules of pickle.
        with pytest.raises(pickle.PicklingError, match="non-contiguous"):
            encode([Plain(), pickle.PickleBuffer(elements)])


class Address(ctypes.Structure):
    _fields_ = [("x", ctypes.c_int), ("to", ctypes.POINTER(ctypes.c_int)), ("O", ctypes.c_int)]


@pytest.mark.parametrize(
    "value",
    [
        memoryview(np.array([object()], object)),
        memoryview(np.zeros(2, [("name", "O"), ("x", "f8")])),
        pickle.PickleBuffer(Address()),
        memoryview((ctypes.c_char_p * 2)()),
        memoryview((ctypes.c_wchar_p * 2)()),
        memoryview(bytes(16)).cast("P"),
        memoryview((ctypes.CFUNCTYPE(None) * 1)()),
    ],
    ids=["object", "field", "pointer", "string", "wide", "number", "function"],
)
def test_a_buffer_of_addresses_is_refused_where_it_is_sent(value: Any) -> None:
    for local in (True, False):
        for sent in (value, [Plain(), value] if local else value):
            with pytest.raises(TypeError, match="holds addresses, which lead nowhere in another"):
                encode(sent, local=local)
    # A name is none, and neither is a complex number.
    for fine in (np.zeros(2, [("OPX", "c16")]), np.zeros(2, "c8")):
        assert kinds.same(far_and_back(memoryview(fine)), memoryview(fine))


@pytest.mark.parametrize("layout", [b"O", b"d", b"P", b"&", b"q", b"\0"])
def test_what_claims_to_be_of_another_format_is_refused(layout: bytes) -> None:
    sent = rewritten(memoryview(np.arange(4, dtype="i1")), b"\x06\x02b", b"\x06\x02" + layout)
    with pytest.raises(ValueError, match="malformed payload"):
        decode(sent, [], local=False)


def test_what_shares_memory_by_dlpack_arrives_as_an_array() -> None:
    back = far_and_back(kinds.Shares([1.5, 2.5]))
    assert type(back) is np.ndarray
    assert back.tolist() == [1.5, 2.5]


def test_what_knows_its_namespace_arrives_as_what_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    import types

    class Kind(kinds.Shares):
        def __array_namespace__(self) -> Any:
            return library

    library: Any = types.ModuleType("somelib")
    library.from_dlpack = library.asarray = Kind
    monkeypatch.setitem(sys.modules, "somelib", library)
    sent = encode(Kind([1, 2]), local=False)
    assert type(decode(*sent, local=False)) is Kind
    monkeypatch.delitem(sys.modules, "somelib")
    with pytest.raises(LookupError, match="somelib"):
        decode(*sent, local=False)


def test_a_tensor_may_be_written_to() -> None:
    pytest.importorskip("torch")
    import torch

    for tensor in (torch.zeros(kinds.LARGE), torch.zeros(3)):
        back = through_a_store(tensor)
        back += 1
        assert back.sum() == tensor.numel()
        assert tensor.sum() == 0


def test_tensors_of_types_that_pickle_does_not_know() -> None:
    torch = pytest.importorskip("torch")
    tensor = torch.tensor([1.0, -2.0]).to(torch.float8_e4m3fn)
    back = far_and_back(tensor)
    assert back.dtype == tensor.dtype
    assert back.float().tolist() == [1.0, -2.0]


def test_cycles_through_objects_are_for_pickle() -> None:
    pose = kinds.Pose(1.0)
    pose.scan = [pose]
    back = decode(*encode(pose))
    assert back.scan[0] is back
    with pytest.raises(TypeError, match=r"`value\.scan\[0\]` is a .*Pose that is around it"):
        encode(pose, local=False)


class Secretive(kinds.Pose):
    def __reduce__(self) -> Any:
        return Secretive, (self.x + 1,)


class Ends(kinds.Pose):
    def __del__(self) -> None:
        self.x = None


def test_a_class_with_its_own_way_is_for_pickle() -> None:
    assert decode(*encode(Secretive(1.0))).x == 2.0
    for value in (Secretive(1.0), Ends(1.0)):
        with pytest.raises(TypeError, match=type(value).__name__):
            encode(value, local=False)


def test_attributes_that_are_no_fields_are_kept() -> None:
    pose = kinds.Derived(1.0)
    pose.note = "late"  # type: ignore[attr-defined]
    back = far_and_back(pose)
    assert back.__dict__ == pose.__dict__
    assert back.counted == 1  # no initializer has run


def rewritten(value: Any, old: bytes, new: bytes) -> bytes:
    head, parts = encode(value, local=False)
    assert parts == [] and old in head and len(old) == len(new)
    return head.replace(old, new)


@pytest.mark.parametrize(
    ("value", "old", "new", "error"),
    [
        (kinds.Pose(1.0), b"Pose", b"Old\x06", "no attribute|attr"),
        (kinds.Pose(1.0), b"kinds\x0a\x01\x08Pose"[:5], b"_nope", "has not imported"),
        (kinds.Pose(1.0), b"Pose", b"same", "no class"),
        (kinds.Pose(1.0), b"Pose", b"Flag", "."),
        (kinds.Colour.RED, b"Colour", b"Rights", "."),
        (kinds.Point(1.0), b"Point", b"Outer", "no named tuple"),
        (kinds.Old(1, 2), b"a", b"z", "."),
    ],
)
def test_only_classes_of_the_right_kind_are_made(
    value: Any, old: bytes, new: bytes, error: str
) -> None:
    with pytest.raises((TypeError, LookupError, AttributeError, ValueError), match=error):
        decode(rewritten(value, old, new), [], local=False)


def test_modules_are_imported_for_neighbours_only() -> None:
    program = """
        import sys
        from hprm._hprm import decode
        head = bytes.fromhex(sys.argv[1])
        sys.path.insert(0, sys.argv[2])
        try:
            decode(head, [], local=False)
        except LookupError as error:
            assert "import it in a preamble" in str(error), error
        else:
            raise AssertionError
        assert "kinds" not in sys.modules
        assert decode(head, []).x == 1.0
    """
    head = encode(kinds.Outer.Inner(1.0))[0].hex()
    folder = str(kinds.pathlib.Path(kinds.__file__).parent)
    command = [sys.executable, "-c", textwrap.dedent(program), head, folder]
    subprocess.run(command, check=True)


def test_nothing_is_imported_because_it_is_installed() -> None:
    program = """
        import datetime, decimal, sys
        from hprm._hprm import decode, digest, encode
        class Shares:
            def __dlpack__(self): raise BufferError
        value = [1, "x", {2}, decimal.Decimal(1), datetime.date(2026, 1, 1), memoryview(b"x")]
        assert decode(*encode(value, False), False) == value
        digest(value)
        for value in (object, Shares()):
            try:
                encode([value], False)
            except TypeError as error:
                assert "only pickle" in str(error), error
        for name in ("numpy", "pandas", "pyarrow", "torch", "attr", "pydantic", "pickle5"):
            assert name not in sys.modules, name
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(program)], check=True)


def test_values_go_without_libraries_that_are_not_installed() -> None:
    program = """
        import sys
        for name in ("pandas", "pyarrow", "torch", "attr", "attrs", "pydantic"):
            sys.modules[name] = None
        sys.path.insert(0, sys.argv[1])
        import importlib.util
        found = importlib.util.find_spec
        def find(name, *rest):
            return None if sys.modules.get(name, 0) is None else found(name, *rest)
        importlib.util.find_spec = find
        import kinds
        assert len(kinds.MISSING) == 5, kinds.MISSING
        from hprm._hprm import decode, encode
        for value in kinds.every().values():
            assert kinds.same(decode(*encode(value, False), False), value)
    """
    folder = str(kinds.pathlib.Path(kinds.__file__).parent)
    command = [sys.executable, "-c", textwrap.dedent(program), folder]
    subprocess.run(command, check=True)


def test_a_frequency_that_its_name_does_not_tell_is_left_to_pickle() -> None:
    pd = pytest.importorskip("pandas")
    offsets = pd.offsets
    frequencies = [
        pd.DateOffset(days=1),
        pd.DateOffset(months=1, days=2),
        offsets.CustomBusinessDay(weekmask="Mon Wed Fri"),
        offsets.CustomBusinessDay(holidays=["2026-01-20"]),
        offsets.BusinessHour(start="08:00", end="12:00"),
    ]
    for frequency in frequencies:
        days = pd.date_range("2026-01-05 09:00", periods=4, freq=frequency)
        for value in (days, pd.Series(range(4), index=days), pd.DataFrame(index=days)):
            back = decode(*encode(value))
            assert kinds.same(back, value)
            index = back if value is days else back.index
            assert index.freq == frequency
            assert index.shift(9).equals(days.shift(9))
