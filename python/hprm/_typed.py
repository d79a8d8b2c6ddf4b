"""What ports, actions and modes of a reactor can do, for editors and type checkers.

At run time they are handles while reactors are made, and objects of the extension module in
reactions; nothing is an instance of the classes here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Generic, TypeVar, overload

from hprm._duration import Time
from hprm._hprm import Tag

T = TypeVar("T")
D = TypeVar("D")
P = TypeVar("P", bound="_PortOf[Any]")


class _PortOf(Generic[T]):
    @property
    def value(self) -> T:
        """The value at this tag; ``ValueError`` if the port is absent."""
        raise NotImplementedError

    @property
    def is_present(self) -> bool:
        """Whether the port has a value at this tag; of a multiport, whether any channel has."""
        raise NotImplementedError

    @overload
    def get(self) -> T | None: ...
    @overload
    def get(self, default: D) -> T | D: ...
    def get(self, default: Any = None) -> Any:
        """Return the value, or ``default`` if the port is absent."""
        raise NotImplementedError

    @property
    def intended_tag(self) -> Tag:
        """The tag that the value was meant for: an earlier one if it is tardy."""
        raise NotImplementedError

    @property
    def physical_time_of_arrival(self) -> int:
        """When the value came from another federate, in nanoseconds since the Unix epoch."""
        raise NotImplementedError

    def __len__(self) -> int:
        """Return the number of channels of a multiport."""
        raise NotImplementedError

    def __getitem__(self: P, index: int) -> P:
        """Return a channel of a multiport."""
        raise NotImplementedError

    def __iter__(self: P) -> Iterator[P]:
        """Return the channels of a multiport."""
        raise NotImplementedError

    def __rshift__(self, other: InputOf[T] | OutputOf[T]) -> object:
        """Connect this port to another one."""
        raise NotImplementedError


class InputOf(_PortOf[T]):
    """An input of a reactor."""

    def set(self, value: T, /) -> None:
        """Set it: a reaction of the container can, or give a source a value to remember."""
        raise NotImplementedError


class OutputOf(_PortOf[T]):
    """An output of a reactor."""

    def set(self, value: T, /) -> None:
        """Set it at this tag; the last value that is set wins."""
        raise NotImplementedError


class ActionOf(Generic[T]):
    """An action of a reactor."""

    @property
    def value(self) -> T:
        """The value of its event at this tag; ``ValueError`` if it has none."""
        raise NotImplementedError

    @property
    def is_present(self) -> bool:
        """Whether it has an event at this tag."""
        raise NotImplementedError

    @overload
    def get(self) -> T | None: ...
    @overload
    def get(self, default: D) -> T | D: ...
    def get(self, default: Any = None) -> Any:
        """Return the value of its event, or ``default`` if there is none."""
        raise NotImplementedError

    def schedule(self, offset: Time = 0, value: T | None = None) -> None:
        """Schedule an event after ``offset`` and the minimum delay."""
        raise NotImplementedError


class ModeOf:
    """A mode of a reactor."""

    def enter(self) -> None:
        """Enter the mode when this tag is done; the last call at a tag counts."""
        raise NotImplementedError

    def __enter__(self) -> None:
        """Begin what the constructor makes for this mode."""
        raise NotImplementedError

    def __exit__(self, *_: object) -> None:
        """End it."""
        raise NotImplementedError
