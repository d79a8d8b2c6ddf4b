"""Reactions of a reactor class: the decorator, and what it notes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from types import FunctionType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

from hprm import _places
from hprm._arguments import checked
from hprm._duration import Time
from hprm._handles import Handle
from hprm._mistakes import ProgramError, one
from hprm._parts import Action, History, Input, Mode, Output, Part, Timer, mode_of
from hprm._places import Place

if TYPE_CHECKING:
    from hprm._typed import ActionOf, InputOf, ModeOf, OutputOf


class Event:
    """An event that is no part of a reactor: the start, the end, or the reset of a mode."""

    def __init__(self, name: str) -> None:
        """Make the event of this name."""
        self.name = name

    def __repr__(self) -> str:
        """Return its name."""
        return f"hprm.{self.name}"


#: Triggers a reaction when the program starts.
startup = Event("startup")
#: Triggers a reaction at the last tag of the program.
shutdown = Event("shutdown")
#: Triggers a reaction of a mode when the mode is entered by a reset.
reset = Event("reset")

if TYPE_CHECKING:
    _Port: TypeAlias = InputOf[Any] | OutputOf[Any] | ActionOf[Any]
    _Chosen: TypeAlias = _Port | Sequence[InputOf[Any]] | Sequence[OutputOf[Any]] | ModeOf | object
#: A part of the class, or a function of the reactor that gives a port of what it contains.
Trigger: TypeAlias = "Event | Input[Any] | Action[Any] | Timer | Callable[[Any], _Chosen]"
Source: TypeAlias = "Input[Any] | Action[Any] | Callable[[Any], _Chosen]"
Effect: TypeAlias = "Output[Any] | Action[Any] | Mode | History | Callable[[Any], _Chosen]"

Body = TypeVar("Body", bound=Callable[..., Any])

#: The attribute by which a function is a reaction.
MARK = "__hprm_reaction__"


class Reaction(NamedTuple):
    """What a class declares of a reaction; what it names is resolved for each reactor."""

    name: str
    function: FunctionType
    triggers: tuple[Any, ...]
    sources: tuple[Any, ...]
    effects: tuple[Any, ...]
    deadline: Any
    #: The name of a method, or a function, which runs when the deadline is missed.
    late: str | FunctionType | None
    #: Likewise when an input is tardy; true if the body itself handles that.
    tardy: str | FunctionType | bool | None
    mode: Mode | None
    place: Place


@checked("reaction")
def reaction(
    *triggers: Trigger,
    sources: Iterable[Source] = (),
    effects: Iterable[Effect] = (),
    deadline: Time | Callable[[Any], Time] | None = None,
    late: str | Callable[..., Any] | None = None,
    tardy: str | Callable[..., Any] | bool | None = None,
    mode: Mode | None = None,
) -> Callable[[Body], Body]:
    """Make a method a reaction: it runs whenever one of its triggers is present.

    Reactions of one reactor run in the order in which the class declares them.

    Parameters
    ----------
    *triggers
        Inputs, actions, timers, ``hprm.startup``, ``hprm.shutdown``, ``hprm.reset``. Ports of what
        the reactor contains are functions of it: ``lambda self: self.detector.boxes``.
    sources : list, optional
        What it reads beside its triggers, without being triggered by it.
    effects : list, optional
        Outputs that it may set, actions that it may schedule, modes that it may enter.
    deadline : Time or callable, optional
        How long after its tag the reaction may begin; ``late`` is needed, too.
    late : str or function, optional
        The method that runs instead if the reaction would begin later: its name, or the function.
    tardy : str, function or bool, optional
        The method that runs instead if an input is tardy, under decentralized coordination;
        ``True`` if the body itself handles that.
    mode : Mode, optional
        The mode in which it is active; always, if it is left out.

    Returns
    -------
    callable
        The decorator, which returns the method as it is.

    Raises
    ------
    ProgramError
        If what is decorated is no method, or ``deadline`` is stated without ``late``; when the
        class is made, if the body uses a part of the reactor that the reaction does not declare.

    """
    place = _places.here()

    def mark(body: Body) -> Body:
        if isinstance(body, FunctionType) and not hasattr(body, MARK):
            made = Reaction(
                body.__name__,
                body,
                triggers,
                _several("sources", sources, place),
                _several("effects", effects, place),
                deadline,
                _handler("late", late, place),
                _handler("tardy", tardy, place),
                mode_of(mode, place),
                _places.of_function(inspect.unwrap(body)),
            )
            if (deadline is None) != (late is None):
                given, missing = ("late", "deadline") if deadline is None else ("deadline", "late")
                raise ProgramError(
                    f"reaction {body.__name__} has a `{given}` and no `{missing}`",
                    made.place,
                    'write deadline="20 ms", late="NAME": the method NAME runs if it is missed',
                )
            setattr(body, MARK, made)
            return body
        if hasattr(body, MARK):
            raise ProgramError(
                "this method is a reaction already",
                place,
                "name all triggers in one @hprm.reaction(...)",
            )
        raise ProgramError(
            f"@hprm.reaction(...) is above {one(type(body).__name__)}, not above a method",
            place,
            "write `def NAME(self) -> None:` below it",
        )

    if len(triggers) == 1 and isinstance(triggers[0], FunctionType):
        _require_call(triggers[0], place)
    return mark


def _require_call(function: FunctionType, place: Place) -> None:
    """Refuse ``@hprm.reaction`` without parentheses, which would take the body for a trigger."""
    if function.__name__ != "<lambda>" and function.__qualname__.count(".") >= 1:
        code = function.__code__
        if code.co_argcount == 1 and code.co_firstlineno >= place.line:
            raise ProgramError(
                f"reaction {function.__name__} has no triggers",
                _places.of_function(function),
                "write @hprm.reaction(TRIGGER, ...) above it",
            )


def _several(what: str, given: Any, place: Place) -> tuple[Any, ...]:
    if isinstance(given, (Part, History, Event, Handle)) or callable(given):
        raise ProgramError(f"`{what}` is a list", place, f"write {what}=[...]")
    return tuple(given)


def _handler(what: str, given: Any, place: Place) -> Any:
    allowed = given is None or isinstance(given, str | FunctionType)
    if not allowed and not (what == "tardy" and isinstance(given, bool)):
        raise ProgramError(f"`{what}` is the name of a method, or a function", place)
    return given or None
