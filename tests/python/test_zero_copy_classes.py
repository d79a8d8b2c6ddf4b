"""Arrays in objects travel without a copy if no code of their classes can notice."""

from __future__ import annotations

import pytest
from conftest import Run
from processes import COORDINATIONS
from scenarios import EXPECTED, program

SCENARIOS = """
import attrs, collections, contextlib, dataclasses, typing

@dataclasses.dataclass
class Image:
    pixels: typing.Any
    name: str = "image"

    def get(self):
        return self.pixels

@dataclasses.dataclass(frozen=True)
class Frozen:
    pixels: typing.Any

@dataclasses.dataclass(slots=True)
class Slotted:
    pixels: typing.Any
    more: typing.Any = None

@dataclasses.dataclass
class Labelled(Image):
    label: str = ""

@attrs.define
class Defined:
    pixels: typing.Any

Pair = collections.namedtuple("Pair", "left right")

class Scan(typing.NamedTuple):
    ranges: typing.Any
    angle: float = 0.0

@moved
def dataclass(number):
    return Image(full(number))

@moved
def dataclass_frozen(number):
    return Frozen(full(number))

@moved
def dataclass_with_slots(number):
    return Slotted(full(number), full(number))

@moved
def dataclass_that_inherits(number):
    return Labelled(full(number), label="x")

@moved
def class_of_attrs(number):
    return Defined(full(number))

@moved
def named_tuple(number):
    return Pair(full(number), full(number))

@moved
def named_tuple_with_types(number):
    return Scan(full(number))

@moved
def objects_in_objects(number):
    return {"a": [Image(Pair(full(number), [Slotted(Frozen(full(number)))]))]}

@moved
def attribute_that_is_no_field(number):
    image = Image(None)
    image.more = full(number)
    return image

@moved
def looked_at_before(number):
    image = Image(full(number))
    vars(image)["name"] = "x"
    weakref.ref(image)
    image.get()[0] = number
    return image

@copied
def kept_object(number):
    image = Image(full(number))
    keep.append(image)
    return image

@copied
def kept_object_with_slots(number):
    image = Slotted(full(number))
    keep.append(image)
    return image

@copied
def kept_named_tuple(number):
    scan = Scan(full(number))
    keep.append(scan)
    return scan

@copied
def kept_dict_of_an_object(number):
    image = Image(full(number))
    keep.append(lambda state=vars(image): state["pixels"])
    return image

@copied
def kept_iterator_of_the_dict(number):
    image = Image(full(number))
    values = iter(vars(image).values())
    keep.append(lambda: next(values))
    return image

@copied
def kept_view_of_the_dict(number):
    image = Image(full(number))
    values = vars(image).values()
    keep.append(lambda: [each for each in values if not isinstance(each, str)])
    return image

@copied
def kept_weakly(number):
    image = Image(full(number))
    keep.append(weakref.ref(image))
    return image

@copied
def kept_proxy(number):
    image = Image(full(number))
    proxy = weakref.proxy(image)
    def look():
        with contextlib.suppress(ReferenceError):
            return proxy.pixels
    keep.append(look)
    return image

@copied
def kept_method(number):
    image = Image(full(number))
    keep.append(image.get)
    return image

@copied
def kept_attribute(number):
    image = Image(full(number))
    keep.append(image.pixels)
    return image

@copied
def kept_by_another_attribute(number):
    image = Image(full(number))
    image.row = image.pixels[:10]
    return image

@copied
def kept_object_around(number):
    image = Image(Frozen(full(number)))
    keep.append(image)
    return image.pixels

@copied
def in_a_kept_named_tuple(number):
    pair = Pair([full(number)], None)
    keep.append(pair)
    return pair.left

@copied
def twice_in_a_list(number):
    image = Image(full(number))
    return [image, image]

# Classes that notice that they are looked at, and keep what they can.

@dataclasses.dataclass
class Jealous:
    pixels: typing.Any

    def __getattribute__(self, name):
        keep.append(self)
        return object.__getattribute__(self, name)

@copied
def noticed_by_getattribute(number):
    image = Jealous(full(number))
    keep.clear()
    return image

@dataclasses.dataclass
class Helpful:
    __slots__ = ("pixels", "missing")
    pixels: typing.Any
    missing: typing.Any

    def __getattr__(self, name):
        keep.append(self)
        raise AttributeError(name)

@copied
def noticed_by_getattr(number):
    image = object.__new__(Helpful)
    image.pixels = full(number)
    return image

@dataclasses.dataclass
class Disguised:
    __slots__ = ("pixels",)
    pixels: typing.Any

hidden = []
Disguised.pixels = property(lambda self: hidden[-1], lambda self, value: hidden.append(value))

@copied
def a_property_in_place_of_a_slot(number):
    image = Disguised(full(number))
    keep.append(lambda: hidden[-1])
    return image

shown = []

@dataclasses.dataclass
class Dictless:
    pixels: typing.Any
    __dict__ = property(lambda self: shown[-1] if shown else {})

@copied
def a_property_in_place_of_the_dict(number):
    shown.append({"pixels": full(number)})
    keep.append(lambda: shown[-1]["pixels"])
    return object.__new__(Dictless)

class Told(Pair):
    __slots__ = ()

    def __iter__(self):
        keep.append(self)
        return super().__iter__()

@copied
def noticed_by_iter(number):
    return Told(full(number), None)

@dataclasses.dataclass
class Last:
    pixels: typing.Any

    def __del__(self):
        # The program that has made the array must be able to write to it.
        if made_here:
            self.pixels[0] = -1

made_here = []

@copied
def written_when_it_ends(number):
    made_here.append(number)
    return Last(full(number))

@copied
def kept_by_a_thread(number):
    image = Image(full(number))
    go, done = threading.Event(), threading.Event()
    def work():
        go.wait()
        image.pixels[:] = -1
        done.set()
    threading.Thread(target=work, daemon=True).start()
    keep.append((go, done))
    return image
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_arrays_in_objects_never_change_for_a_peer_whatever_the_sender_keeps(
    launch: Run, coordination: str
) -> None:
    outcome = launch(program(SCENARIOS, coordination))
    assert outcome.code == 0, outcome.err
    assert outcome.err == ""
    assert sorted(outcome.out.splitlines()) == EXPECTED
