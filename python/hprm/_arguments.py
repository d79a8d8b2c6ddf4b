"""Calls that declare something, with arguments that the called function does not have.

Python's ``TypeError`` says what it cannot do with them; here is where, and what can be stated.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

from hprm import _places
from hprm._mistakes import ProgramError

F = TypeVar("F", bound=Callable[..., Any])

# What is stated elsewhere, by the names of the function and of the argument.
_ELSEWHERE = {
    ("Timer", "deadline"): "a deadline is one of a reaction:"
    ' @hprm.reaction(tick, deadline="10 ms", late="NAME")',
    ("Timer", "after"): 'the first event is at `offset`: hprm.Timer("1 s", offset="10 ms")',
    ("Timer", "delay"): 'the first event is at `offset`: hprm.Timer("1 s", offset="10 ms")',
    ("Action", "delay"): 'write min_delay="10 ms", or state the delay in `schedule`',
    ("connect", "delay"): 'write after="10 ms"',
    ("reaction", "timeout"): 'write deadline="10 ms", late="NAME"; the program has a `timeout`',
}

# How a call is written that is often written in another way.
_EXAMPLE = {"connect": 'write hprm.connect(source, destination, after="10 ms")'}


def checked(name: str) -> Callable[[F], F]:
    """Refuse a call that does not fit the parameters of a function, which users know as ``name``.

    The error is a ``ProgramError`` at the place of the call. A call that fits costs nothing more.
    """

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def call(*arguments: Any, **keywords: Any) -> Any:
            try:
                return function(*arguments, **keywords)
            except TypeError:
                refused = _refused(name, function, arguments, keywords)
                if refused is None:
                    raise
            raise refused

        return cast(F, call)

    return decorate


def _refused(
    name: str, function: Callable[..., Any], arguments: tuple[Any, ...], keywords: dict[str, Any]
) -> ProgramError | None:
    """Return what is wrong with the arguments of a call, if they do not fit."""
    signature = inspect.signature(function)
    try:
        signature.bind(*arguments, **keywords)
    except TypeError as error:
        problem = str(error)
    else:
        return None
    if "self" in signature.parameters:
        # Of a class that inherits the constructor.
        name = type(arguments[0]).__name__
    parameters = [it for it in signature.parameters.values() if it.name != "self"]
    ordered = [it.name for it in parameters if it.kind is it.POSITIONAL_OR_KEYWORD]
    named = [it.name for it in parameters if it.kind is it.KEYWORD_ONLY]
    unknown = [it for it in keywords if it not in signature.parameters]
    given = len(arguments) - ("self" in signature.parameters)
    takes_any = any(it.kind is it.VAR_POSITIONAL for it in parameters)
    if unknown:
        message = f"hprm.{name} has no argument `{unknown[0]}`"
        hint = _ELSEWHERE.get((name, unknown[0])) or _near(unknown[0], ordered + named)
    elif given > len(ordered) and not takes_any:
        least = f"{len(ordered)} argument{'s' * (len(ordered) != 1)}"
        message = f"hprm.{name} takes at most {least} without a name, and this call has {given}"
        hint = _EXAMPLE.get(name) or f"write `NAME=` before the others: {', '.join(named)}"
    else:
        message = f"hprm.{name}: {problem}"
        hint = f"its arguments are {', '.join(ordered + named)}"
    return ProgramError(message, _places.here(), hint)


def _near(name: str, known: list[str]) -> str:
    # Only a program with this mistake needs the module.
    from difflib import get_close_matches

    near = get_close_matches(name, known, 1)
    return f"did you mean `{near[0]}`?" if near else f"its arguments are {', '.join(known)}"
