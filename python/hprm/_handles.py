"""What constructors use of ports and other parts: handles, to connect ports by.

A handle is what an attribute such as ``self.camera.image`` is while reactors are made. Where the
reactor runs, the attribute is then the port itself; elsewhere it stays a handle, of which nothing
can be read.
"""

from __future__ import annotations

import linecache
from typing import TYPE_CHECKING, NoReturn

from hprm import _construction, _places
from hprm._mistakes import ProgramError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hprm._parts import Part
    from hprm._reactor import Reactor


class Handle:
    """A part of one reactor; of a multiport, perhaps one channel."""

    __slots__ = ("_channel", "_owner", "_part")

    def __init__(self, owner: Reactor, part: Part, channel: int | None = None) -> None:
        """Make the handle of a part of ``owner``."""
        self._owner = owner
        self._part = part
        self._channel = channel

    def __rshift__(self, other: object) -> object:
        """Connect this port to another one: ``camera.image >> detector.image``."""
        from hprm._connect import connect

        connect(self, other)  # type: ignore[arg-type]
        return other

    def __rrshift__(self, other: object) -> object:
        """Connect several ports to this one: ``[left.image, right.image] >> detector.image``."""
        from hprm._connect import connect

        connect(other, self)  # type: ignore[arg-type]
        return self

    if not TYPE_CHECKING:

        def __lshift__(self, _):
            """Refuse to connect a port to one that sends to it."""
            _refuse_left()

        def __rlshift__(self, _):
            """Refuse it for several ports, too."""
            _refuse_left()

    def __getitem__(self, index: int) -> Handle:
        """Return the handle of one channel of a multiport."""
        width = self._width()
        if not isinstance(index, int) or not -width <= index < width:
            raise IndexError(
                f"{self} has {width} channels, from 0 to {width - 1}; there is no channel {index!r}"
            )
        return Handle(self._owner, self._part, index % width)

    def __len__(self) -> int:
        """Return the number of channels of a multiport."""
        return self._width()

    def __iter__(self) -> Iterator[Handle]:
        """Return handles of all channels of a multiport."""
        return iter([self[index] for index in range(self._width())])

    def __bool__(self) -> bool:
        """Be true, as ports are."""
        return True

    def __enter__(self) -> None:
        """Begin what the constructor makes for this mode: ``with self.idle:``."""
        _construction.enter_mode(self._owner, self._part)

    def __exit__(self, *_: object) -> None:
        """End it."""
        _construction.leave_mode(self._owner)

    def __getattr__(self, name: str) -> NoReturn:
        """Refuse what only a port of a running reactor has."""
        if name.startswith("__"):
            raise AttributeError(name)
        raise AttributeError(
            f"{self} has no {name} here: ports, actions and modes can be used in the reactions of"
            " the reactor that has them, when it runs"
        )

    def __repr__(self) -> str:
        """Return the kind, and the name as a program writes it."""
        channel = "" if self._channel is None else f"[{self._channel}]"
        return f"{self._part.kind} {type(self._owner).__name__}.{self._part.name}{channel}"

    def _width(self) -> int:
        width = self._part.width_of(self._owner)
        if width is None or self._channel is not None:
            raise TypeError(f"{self} is not a multiport, so it has neither a length nor channels")
        return width


def _refuse_left() -> NoReturn:
    place = _places.here()
    hint = "write SOURCE >> DESTINATION: the port that sends comes first"
    if place.end >= 0:
        text = linecache.getline(place.path, place.line).encode()[place.column : place.end]
        left, _, right = text.decode(errors="replace").partition("<<")
        if right and "<<" not in right:
            hint = f"write {right.strip()} >> {left.strip()}: the port that sends comes first"
    raise ProgramError("`<<` connects no ports; `>>` does", place, hint)


def ports_of(reactor: Reactor) -> str:
    """Return the ports that a reactor has, as messages name them."""
    declared = type(reactor)._hprm_parts_.values()
    ports = (it for it in declared if it.kind in ("input", "output"))
    return ", ".join(f"{it.name} ({it.kind})" for it in ports)


def parts(handle: Handle) -> tuple[Reactor, Part, int | None]:
    """Return the reactor, the part and the channel of a handle."""
    return handle._owner, handle._part, handle._channel
