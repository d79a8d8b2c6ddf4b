"""Connections, which the constructor of a reactor makes between ports of what it contains."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar, get_origin

from hprm import _construction, _duration, _places
from hprm._arguments import checked
from hprm._duration import Time
from hprm._handles import Handle, parts, ports_of
from hprm._mistakes import ProgramError, one
from hprm._parts import Mode, Part
from hprm._places import Place

if TYPE_CHECKING:
    from hprm._typed import InputOf, OutputOf

T = TypeVar("T")


class Connection(NamedTuple):
    """A connection between all channels of some ports; times are in nanoseconds."""

    sources: list[Handle]
    destinations: list[Handle]
    after: int | None
    physical: bool
    repeated: bool
    absent_after: int | None
    bound: tuple[int, str] | None
    serializer: str | None
    compress: bool
    mode: Mode | None
    place: Place


@checked("connect")
def connect(
    source: OutputOf[T] | InputOf[T] | Iterable[OutputOf[T]] | Iterable[InputOf[T]],
    destination: InputOf[T] | OutputOf[T] | Iterable[InputOf[T]] | Iterable[OutputOf[T]],
    *,
    after: Time | None = None,
    physical: bool = False,
    repeated: bool = False,
    absent_after: Time | None = None,
    bound: tuple[int, Literal["block", "drop", "replace"]] | None = None,
    serializer: str | None = None,
    compress: bool = False,
) -> None:
    """Connect ports, in the constructor of the reactor that contains them.

    Both sides may be several ports, of which all channels are joined in order.

    Parameters
    ----------
    source : port or list of ports
        An output of a contained reactor, or an own input.
    destination : port or list of ports
        An input of a contained reactor, or an own output.
    after : Time, optional
        The delay of the connection. Zero delays by a microstep.
    physical : bool, default False
        Whether messages get a tag from the receiver's clock.
    repeated : bool, default False
        Whether the source is repeated until all destinations have one: a broadcast.
    absent_after : Time, optional
        How long reactions of a decentralized federate wait for the input beyond its ``maxwait``.
    bound : tuple of int and {"drop", "replace", "block"}, optional
        How many messages of a physical connection may wait, and what happens when another one
        comes: it is dropped, it replaces the one that has waited longest, or the sender waits.
    serializer : str, optional
        The module that encodes the values, or ``"proto"``.
    compress : bool, default False
        Whether agents compress arrays of 256 KiB or more on their way to another machine.

    Raises
    ------
    ProgramError
        If a side is no port, the types of two ports differ, or this is not called in a
        constructor.

    Examples
    --------
    ``self.camera.image >> self.detector.image`` is short for
    ``hprm.connect(self.camera.image, self.detector.image)``.

    """
    place = _places.here()
    container = _construction.current()
    if container is None:
        raise ProgramError(
            "ports are connected in the constructor of the reactor that contains them",
            place,
            "move it into `__init__` of a hprm.Reactor or a hprm.Federation",
        )
    _check_keywords(bound, serializer, place)
    container.connections.append(
        Connection(
            _handles(source, "source", place),
            _handles(destination, "destination", place),
            _duration.stated("after", after, place),
            bool(physical),
            bool(repeated),
            _duration.stated("absent_after", absent_after, place),
            bound,
            serializer,
            bool(compress),
            container.mode,
            place,
        )
    )


def _handles(given: Any, side: str, place: Place) -> list[Handle]:
    if isinstance(given, Handle):
        return [given]
    found = list(given) if isinstance(given, Iterable) else [given]
    for handle in found:
        if not isinstance(handle, Handle):
            hint = "name a port of a contained reactor, such as self.camera.image, or an own one"
            if isinstance(handle, Part):
                hint = "make a reactor of that class, with parentheses: self.camera = Camera()"
            elif ports := _ports_of(handle):
                hint = f"name one of its ports: {ports}"
            raise ProgramError(
                f"the {side} of this connection is {_what(handle)}, not a port of a reactor",
                place,
                hint,
            )
    return found


def _ports_of(thing: object) -> str:
    """Return the ports of a reactor; nothing for other things."""
    # The classes of reactors import this module.
    from hprm._reactor import Reactor

    return ports_of(thing) if isinstance(thing, Reactor) else ""


def _what(thing: object) -> str:
    if isinstance(thing, Part):
        return f"the {thing.kind} `{thing.name}` of a class"
    if isinstance(thing, type):
        return f"the class {thing.__name__}"
    return one(type(thing).__name__)


def _check_keywords(bound: Any, serializer: Any, place: Place) -> None:
    match bound:
        case None | (int(), "block" | "drop" | "replace"):
            is_bound = True
        case _:
            is_bound = False
    if not is_bound:
        raise ProgramError(
            f"`bound` is how many messages may wait, and what happens to the next, not {bound!r}",
            place,
            'write bound=(3, "drop"), or "block" or "replace" instead of "drop"',
        )
    if serializer is not None and not isinstance(serializer, str):
        raise ProgramError(
            f"`serializer` is the name of a module, not {serializer!r}",
            place,
            'write serializer="MODULE": the module has a class `Serializer`',
        )


def check_types(connection: Connection, width: Callable[[Handle], int]) -> None:
    """Refuse to connect an output to an input of another type.

    Channels are joined in order, so each port meets those whose channels lie beside its own. The
    width of a port may depend on its reactor, so it is known when all constructors are done.
    """
    sources = ((handle, width(handle)) for handle in connection.sources)
    if connection.repeated:
        # Without a channel, they would be repeated for ever.
        several = [(handle, channels) for handle, channels in sources if channels > 0]
        sources = itertools.cycle(several)  # type: ignore[assignment]
    left, beside = None, 0
    for right in connection.destinations:
        channels = width(right)
        while channels > 0:
            while beside <= 0:
                left, beside = next(sources, (None, 1))
            if left is None:
                # The model says which channels are left over.
                return
            _check_pair(left, right, connection.place)
            joined = min(beside, channels)
            beside, channels = beside - joined, channels - joined


def _check_pair(left: Handle, right: Handle, place: Place) -> None:
    declared = [getattr(parts(handle)[1], "type", Any) for handle in (left, right)]
    # From Python 3.11 on, it is a class.
    if Any in declared:
        return
    from_, to = (get_origin(type_) or type_ for type_ in declared)
    if not (isinstance(from_, type) and isinstance(to, type)) or issubclass(from_, to):
        return
    if (from_, to) in ((int, float), (bool, float)):
        return
    names = [getattr(type_, "__name__", str(type_)) for type_ in declared]
    raise ProgramError(
        f"{left} has values of type {names[0]}, and {right} takes {names[1]}",
        place,
        "declare both with the same type, or one without a type",
    )
