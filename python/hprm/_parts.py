"""The parts that a reactor class declares: ports, timers, actions and modes.

Each is a descriptor: in the class body it stands for itself, in reactions and connections; of a
reactor it is a handle first and then, where the reactor runs, the port itself, which the reactor's
dictionary has. The descriptors define no ``__set__``, so that the dictionary comes first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar, overload

from hprm import _duration, _findings, _places
from hprm._arguments import checked
from hprm._duration import Time
from hprm._handles import Handle
from hprm._mistakes import ProgramError
from hprm._places import Place

if TYPE_CHECKING:
    from hprm._reactor import Reactor
    from hprm._typed import ActionOf, InputOf, ModeOf, OutputOf

T = TypeVar("T")
P = TypeVar("P", bound="Part")

#: A value, or a function of the reactor that gives it when its constructor is done.
Late: TypeAlias = T | Callable[[Any], T]

Policy: TypeAlias = Literal["defer", "drop", "replace", "update"]


class Part:
    """What a reactor class declares under a name."""

    kind = "part"

    def __init__(self) -> None:
        """Note where the part is declared."""
        self.name = ""
        self.place = _places.here()

    def __set_name__(self, owner: type, name: str) -> None:
        """Take the name of the attribute."""
        # A second name is refused where the class is checked: errors of this method are wrapped.
        self.name = self.name or name

    def __get__(self, reactor: Any, owner: type) -> Any:
        """Return the part itself for a class, and for a reactor the handle of it."""
        return self if reactor is None else Handle(reactor, self)

    def __rshift__(self, other: object) -> object:
        """Refuse to connect what a class declares: only reactors have ports to connect."""
        from hprm._connect import connect

        connect(self, other)  # type: ignore[arg-type]
        return other

    def width_of(self, reactor: Reactor) -> int | None:
        """Return the number of channels; none if the part is not a multiport."""
        return None

    def _time(self, name: str, stated: Late[Time] | None) -> Callable[[Any], Time] | int | None:
        """Return a time in nanoseconds, or the function of the reactor that gives it."""
        return stated if callable(stated) else _duration.stated(name, stated, self.place)

    def __repr__(self) -> str:
        """Return the kind and the name."""
        return f"<{self.kind} {self.name}>"


class _Port(Part):
    def __init__(self, type_: Any, width: Late[int] | None) -> None:
        super().__init__()
        self.type = _type(type_, self)
        self._width = width

    def width_of(self, reactor: Reactor) -> int | None:
        """Return the number of channels of this multiport in ``reactor``."""
        width: object = self._width(reactor) if callable(self._width) else self._width
        if width is None:
            return None
        if isinstance(width, bool) or not isinstance(width, int):
            raise ProgramError(
                f"the width of {self.name} is {width!r}, not an integer",
                self.place,
                code=_findings.NO_WIDTH,
            )
        return width


def _type(stated: Any, part: Part) -> Any:
    """Return the type of a part, unless it is a value."""
    if isinstance(stated, int | float | list | dict | Part):
        raise ProgramError(
            f"the type of this {part.kind} is {stated!r}, which is a value",
            part.place,
            "name a type, such as int or np.ndarray; a multiport has a width: width=4",
        )
    return stated


class Input(_Port, Generic[T]):
    """An input port: ``image = hprm.Input(np.ndarray)``.

    Parameters
    ----------
    type_ : type, optional
        The type of its values, such as ``int`` or ``np.ndarray``; any, if it is left out.
        Connections and type checkers compare it.
    width : int or callable, optional
        The number of channels, from 1 to 100,000, which makes it a multiport; or a function of the
        reactor that gives it: ``lambda self: self.width``.
    mutable : bool, default False
        Whether reactions may change the value in place: each gets a copy of its own.

    Raises
    ------
    ProgramError
        If the type is a value, such as ``0`` for ``int``.

    See Also
    --------
    port_capsule : What ``self.image`` offers in a body.

    """

    kind = "input"

    @overload
    def __init__(
        self: Input[Any], *, width: Late[int] | None = None, mutable: bool = False
    ) -> None: ...
    @overload
    def __init__(
        self, type_: type[T], *, width: Late[int] | None = None, mutable: bool = False
    ) -> None: ...
    @checked("Input")
    def __init__(
        self, type_: Any = Any, *, width: Late[int] | None = None, mutable: bool = False
    ) -> None:
        """Declare an input."""
        super().__init__(type_, width)
        self.mutable = mutable

    if TYPE_CHECKING:

        @overload
        def __get__(self, reactor: None, owner: type) -> Input[T]: ...
        @overload
        def __get__(self, reactor: Reactor, owner: type) -> InputOf[T]: ...
        def __get__(self, reactor: Any, owner: type) -> Any: ...


class Output(_Port, Generic[T]):
    """An output port: ``boxes = hprm.Output(list)``.

    Parameters
    ----------
    type_ : type, optional
        The type of its values, such as ``int`` or ``np.ndarray``; any, if it is left out.
        To set a value of another type is a ``TypeError``.
    width : int or callable, optional
        The number of channels, from 1 to 100,000, which makes it a multiport; or a function of the
        reactor that gives it: ``lambda self: self.width``.

    Raises
    ------
    ProgramError
        If the type is a value, such as ``0`` for ``int``.

    See Also
    --------
    port_capsule : What ``self.boxes`` offers in a body.

    """

    kind = "output"

    @overload
    def __init__(self: Output[Any], *, width: Late[int] | None = None) -> None: ...
    @overload
    def __init__(self, type_: type[T], *, width: Late[int] | None = None) -> None: ...
    @checked("Output")
    def __init__(self, type_: Any = Any, *, width: Late[int] | None = None) -> None:
        """Declare an output."""
        super().__init__(type_, width)

    if TYPE_CHECKING:

        @overload
        def __get__(self, reactor: None, owner: type) -> Output[T]: ...
        @overload
        def __get__(self, reactor: Reactor, owner: type) -> OutputOf[T]: ...
        def __get__(self, reactor: Any, owner: type) -> Any: ...


class Mode(Part):
    """A mode: ``idle = hprm.Mode(initial=True)``.

    Reactions, timers and actions with ``mode=idle`` are active in it only, and so are reactors that
    the constructor makes below ``with self.idle:``. A reaction that may enter it has it among its
    effects, or ``idle.history``, and calls ``self.idle.enter()``.

    Parameters
    ----------
    initial : bool, default False
        Whether the reactor starts in this mode. One of its modes is the initial one.

    Examples
    --------
    >>> import hprm
    >>> class Lamp(hprm.Reactor, fast=True):
    ...     off = hprm.Mode(initial=True)
    ...     on = hprm.Mode()
    ...     begin = hprm.Timer(offset="1 s", mode=off)
    ...
    ...     @hprm.reaction(begin, effects=[on], mode=off)
    ...     def switch(self):
    ...         self.on.enter()
    ...
    ...     @hprm.reaction(hprm.reset, mode=on)
    ...     def shine(self):
    ...         print("on at", self.elapsed())
    >>> hprm.run(Lamp())
    on at 1000000000

    """

    kind = "mode"

    @checked("Mode")
    def __init__(self, *, initial: bool = False) -> None:
        """Declare a mode; a reactor starts in the initial one."""
        super().__init__()
        self.initial = initial

    @property
    def history(self) -> History:
        """The mode as an effect that enters it as it was left, instead of resetting it."""
        return History(self)

    if TYPE_CHECKING:

        @overload
        def __get__(self, reactor: Reactor, owner: type) -> ModeOf: ...
        @overload
        def __get__(self, reactor: object, owner: type) -> Mode: ...
        def __get__(self, reactor: Any, owner: type) -> Any: ...


def mode_of(stated: Any, place: Place) -> Mode | None:
    """Return the mode that a keyword ``mode`` states."""
    if stated is None or isinstance(stated, Mode):
        return stated
    raise ProgramError(
        f"`mode` is a mode of the class, not {stated!r}",
        place,
        "declare idle = hprm.Mode(initial=True), and write mode=idle",
    )


class History:
    """A mode that a reaction enters as it was left."""

    def __init__(self, mode: Mode) -> None:
        """Enter ``mode`` with its history."""
        self.mode = mode


class Timer(Part):
    """A timer: ``tick = hprm.Timer("10 ms")``.

    Parameters
    ----------
    period : Time or callable, optional
        The time between two events; without it, the timer is due once.
    offset : Time or callable, default 0
        The time from the start to the first event.
    mode : Mode, optional
        The mode in which its time passes; always, if it is left out.

    Raises
    ------
    ProgramError
        If a time is none, or negative.

    Notes
    -----
    A time that depends on the reactor's parameters is a function of the reactor:
    ``hprm.Timer(lambda self: self.period)``.

    """

    kind = "timer"

    @checked("Timer")
    def __init__(
        self,
        period: Late[Time] | None = None,
        *,
        offset: Late[Time] = 0,
        mode: Mode | None = None,
    ) -> None:
        """Declare a timer."""
        super().__init__()
        self.period = self._time("period", period)
        self.offset = self._time("offset", offset)
        self.mode = mode_of(mode, self.place)

    if TYPE_CHECKING:

        @overload
        def __get__(self, reactor: None, owner: type) -> Timer: ...
        @overload
        def __get__(self, reactor: Reactor, owner: type) -> object: ...
        def __get__(self, reactor: Any, owner: type) -> Any: ...


class _Action(Part):
    physical = False

    def __init__(
        self,
        type_: Any,
        timing: tuple[Late[Time], Late[Time] | None, Policy | None],
        mode: Mode | None,
    ) -> None:
        super().__init__()
        self.type = _type(type_, self)
        min_delay, spacing, self.policy = timing
        self.min_delay = self._time("min_delay", min_delay)
        self.spacing = self._time("spacing", spacing)
        self.mode = mode_of(mode, self.place)


class Action(_Action, Generic[T]):
    """A logical action: ``again = hprm.Action(int, min_delay="10 ms")``.

    A reaction that has it among its effects calls ``self.again.schedule("5 ms", value)``; the event
    comes at the tag of the reaction, and the delay, and the minimum delay.

    Parameters
    ----------
    type_ : type, optional
        The type of its values, such as ``int`` or ``np.ndarray``; any, if it is left out.
    min_delay : Time or callable, default 0
        What is added to the delay of each event.
    spacing : Time or callable, optional
        The least time between two events.
    policy : {"defer", "drop", "replace", "update"}, default "defer"
        What happens to an event that is too close to the one before: it is delayed; it is dropped;
        it gives its value to the one before, if that is still to come; or it takes its place, at
        its own tag.
    mode : Mode, optional
        The mode in which its time passes; always, if it is left out.

    See Also
    --------
    action_capsule_t : What ``self.again`` offers in a body.

    """

    kind = "action"

    @overload
    def __init__(
        self: Action[Any],
        *,
        min_delay: Late[Time] = 0,
        spacing: Late[Time] | None = None,
        policy: Policy | None = None,
        mode: Mode | None = None,
    ) -> None: ...
    @overload
    def __init__(
        self,
        type_: type[T],
        *,
        min_delay: Late[Time] = 0,
        spacing: Late[Time] | None = None,
        policy: Policy | None = None,
        mode: Mode | None = None,
    ) -> None: ...
    @checked("Action")
    def __init__(
        self,
        type_: Any = Any,
        *,
        min_delay: Late[Time] = 0,
        spacing: Late[Time] | None = None,
        policy: Policy | None = None,
        mode: Mode | None = None,
    ) -> None:
        """Declare an action."""
        super().__init__(type_, (min_delay, spacing, policy), mode)

    if TYPE_CHECKING:

        @overload
        def __get__(self, reactor: None, owner: type) -> Action[T]: ...
        @overload
        def __get__(self, reactor: Reactor, owner: type) -> ActionOf[T]: ...
        def __get__(self, reactor: Any, owner: type) -> Any: ...


class PhysicalAction(Action[T]):
    """A physical action: events from outside, such as those of a sensor's thread.

    Any thread may schedule it at any time; the tag of the event is taken from the clock then. A
    program with a physical action does not end because nothing is left to do. Parameters are those
    of ``Action``.

    Raises
    ------
    queue.Full
        By ``schedule``, if as many events wait as the environment variable ``HPRM_EVENT_LIMIT``
        allows.

    """

    physical = True
