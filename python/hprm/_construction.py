"""What a constructor of a reactor notes while it runs: connections, and the mode they are for."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from hprm._connect import Connection
    from hprm._parts import Mode, Part
    from hprm._places import Place
    from hprm._reactor import Reactor


class Construction:
    """The structure of one reactor: what its constructor has made, and where it was made."""

    def __init__(
        self,
        arguments: dict[str, Any],
        call: tuple[tuple[Any, ...], dict[str, Any]],
        place: Place,
    ) -> None:
        """Begin one, with the arguments of the constructor, by name and as the call has them."""
        self.arguments = arguments
        self.call = call
        self.place = place
        self.connections: list[Connection] = []
        self.mode: Mode | None = None
        #: The reactor that contains it, with its name and its place in a bank there.
        self.container: Reactor | None = None
        self.name = ""
        self.member: int | None = None
        #: The mode of the container in which it is active.
        self.mode_of_container: Mode | None = None
        #: What is stated about it as a federate.
        self.federate: dict[str, Any] = {}
        #: What its constructor has made, whether it contains it or not.
        self.made: list[Reactor] = []
        #: What it contains: by name, a reactor, or the members of a bank.
        self.children: dict[str, Reactor | list[Reactor]] = {}

    def leave_container(self) -> None:
        """Let the reactor be in no other one, as it was made."""
        self.container = None
        self.name, self.member = "", None


_local = threading.local()


def stack() -> list[Construction]:
    """Return the constructors that run in this thread, the innermost last."""
    found: list[Construction] | None = getattr(_local, "stack", None)
    if found is None:
        found = _local.stack = []
    return found


def current() -> Construction | None:
    """Return what the innermost constructor notes, if one runs."""
    running = stack()
    return running[-1] if running else None


def enter_mode(owner: Reactor, part: Part) -> None:
    """Let what the constructor of ``owner`` makes from now on be active in a mode only."""
    construction = current()
    if part.kind != "mode":
        raise TypeError(f"`with` needs a mode, and {part.name} is an {part.kind}")
    if construction is None or construction is not of(owner) or construction.mode is not None:
        raise TypeError(f"`with self.{part.name}:` belongs into the constructor of its reactor")
    construction.mode = cast("Mode", part)


def leave_mode(owner: Reactor) -> None:
    """End that."""
    of(owner).mode = None


def of(reactor: Reactor) -> Construction:
    """Return the structure of a reactor."""
    found: Construction = vars(reactor)["_hprm_"]
    return found
