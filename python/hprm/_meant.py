"""What an attribute or a name was meant to be, in a program whose reactors are classes of Python.

Only programs with a mistake need it. For bodies of ``.lf`` files, see ``_names``.
"""

from __future__ import annotations

import inspect
import traceback
from types import FrameType, FunctionType
from typing import Any

from hprm import _places
from hprm._handles import ports_of
from hprm._mistakes import ProgramError
from hprm._reactor import Reactor


def by_name(name: str, frames: list[FrameType]) -> str | None:
    """Return a hint for a name without a meaning that the reactor of a body has as an attribute."""
    here = frames[-1].f_code.co_filename
    for frame in reversed(frames):
        reactor = frame.f_locals.get("self")
        if isinstance(reactor, Reactor) and frame.f_code.co_filename == here:
            return f"did you mean `self.{name}`?" if _has(reactor, name) else None
    return None


def _has(reactor: Reactor, name: str) -> bool:
    """Whether a reactor has something of this name, of the program or of every reactor."""
    return name in vars(reactor) or (not name.startswith("_") and hasattr(type(reactor), name))


def by_attribute(thing: object, name: str) -> str | None:
    """Return a hint for an attribute that a reactor, or a list of reactors, does not have."""
    if is_bank(thing):
        return of_bank(thing, name)
    if not isinstance(thing, Reactor):
        return None
    left_out = _left_out(type(thing), name)
    if left_out is not None:
        return left_out
    ports = ports_of(thing)
    return f"its ports: {ports}" if ports else "it has no ports"


def _left_out(cls: type[Reactor], name: str) -> str | None:
    """Say which constructor leaves out the one that would have assigned an attribute."""
    made = [base for base in cls.__mro__ if isinstance(vars(base).get("__init__"), FunctionType)]
    constructors = [inspect.unwrap(vars(base)["__init__"]) for base in made]
    for position, constructor in enumerate(constructors):
        # It is called by this name, through `super()` or through the class.
        if "__init__" not in constructor.__code__.co_names:
            if _places.of_assignment(constructors[position + 1 :], name) is None:
                return None
            return f"{made[position].__name__}.__init__ does not call super().__init__()"
    return None


def is_bank(thing: object) -> bool:
    """Whether something is a list of reactors."""
    is_list = isinstance(thing, list | tuple) and len(thing) > 0
    return is_list and all(isinstance(it, Reactor) for it in thing)  # type: ignore[attr-defined]


def of_bank(bank: Any, name: str) -> str:
    """Return how to name the port of all reactors of a list."""
    return (
        f"it is a list of {len(bank)} reactors: name the ports of all of them,"
        f" [it.{name} for it in BANK], or one port at a time in a loop"
    )


def refuse(error: AttributeError, reactor: Reactor) -> None:
    """Raise ``ProgramError`` if it is known what is wrong in the constructor of a reactor."""
    *_, (frame, line) = traceback.walk_tb(error.__traceback__)
    place = _places.of_line(frame.f_code.co_filename, line)
    thing: Any = error.obj
    name = error.name
    if is_bank(thing):
        called = next((it for it, value in vars(reactor).items() if value is thing), None)
        bank = f"self.{called}" if called else "BANK"
        what = bank if called else "this"
        raise ProgramError(
            f"{what} is a list of {len(thing)} reactors, which has no `{name}`",
            place,
            f"connect all of them, hprm.connect([it.{name} for it in {bank}], ...), or one at a"
            " time in a loop",
        ) from None
    left_out = _left_out(type(reactor), name) if thing is reactor and name else None
    if left_out is not None:
        raise ProgramError(
            f"this {type(reactor).__name__} has no attribute `{name}`: {left_out}",
            place,
            "write super().__init__(...) at the beginning of `__init__`",
        ) from None
