"""Connections, which the constructor of a reactor makes between ports of what it contains."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar, get_origin

from hprm import _construction, _places
from hprm._duration import Time, nanoseconds
from hprm._handles import Handle, parts
from hprm._mistakes import ProgramError
from hprm._parts import Mode
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
    mode: Mode | None
    place: Place


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
) -> None:
    """Connect ports, in the constructor of the reactor that contains them.

    Both sides may be several ports, of which all channels are joined in order.

    Parameters
    ----------
    source
        An output of a contained reactor, or an own input.
    destination
        An input of a contained reactor, or an own output.
    after
        The delay of the connection. ``"0 s"`` delays by a microstep.
    physical
        Whether the receiver gets a tag from its clock.
    repeated
        Whether the source is repeated until all destinations have one.
    absent_after
        How long a decentralized federate waits for the input beyond its ``maxwait``.
    bound
        How many messages of a physical connection may wait, and what happens to the next one.
    serializer
        The module that encodes the values.

    """
    place = _places.here()
    container = _construction.current()
    if container is None:
        raise ProgramError(
            "ports are connected in the constructor of the reactor that contains them",
            place,
            "move it into `__init__` of a hprm.Reactor or a hprm.Federation",
        )
    sources = _handles(source, "source", place)
    destinations = _handles(destination, "destination", place)
    for left in sources:
        for right in destinations:
            _check_types(left, right, place)
    container.connections.append(
        Connection(
            sources,
            destinations,
            _time("after", after, place),
            physical,
            repeated,
            _time("absent_after", absent_after, place),
            bound,
            serializer,
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
            what = f"a {type(handle).__name__}"
            raise ProgramError(
                f"the {side} of this connection is {what}, not a port",
                place,
                "name a port of a contained reactor, such as self.camera.image, or an own one",
            )
    return found


def _time(name: str, given: Time | None, place: Place) -> int | None:
    try:
        return None if given is None else nanoseconds(given)
    except (TypeError, ValueError) as error:
        raise ProgramError(f"`{name}`: {error}", place) from None


def _check_types(left: Handle, right: Handle, place: Place) -> None:
    """Refuse to connect an output to an input of another type."""
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
