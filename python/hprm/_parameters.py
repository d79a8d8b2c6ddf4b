"""Parameters of a program's constructor, which a command line states as text."""

from __future__ import annotations

import inspect
from types import FunctionType
from typing import Any

from hprm import _places
from hprm._mistakes import ProgramError, one
from hprm._places import Place

#: The options of ``hprm run``, one of which may be meant by a name that is none.
OPTIONS = (
    *("at", "cpus", "debug", "fast", "fleet-key", "hang-timeout", "help", "in-process"),
    *(
        "join-timeout",
        "json",
        "keepalive",
        "log-frames",
        "log-frames-to",
        "logical-trace",
        "property",
        "python",
        "realtime",
        "spin",
    ),
    *("start-time-multiple", "store-full", "store-limit", "timeout", "trace", "trace-buffer"),
    "workers",
)


def read(found: Any, stated: dict[str, str]) -> dict[str, Any]:
    """Read the parameters that the command line states, each by the type that it has."""
    known = inspect.signature(found).parameters
    values = {}
    for name, text in stated.items():
        option = f"--{name.replace('_', '-')} {text}"
        parameter = known.get(name)
        if parameter is None:
            raise _unknown(name, option, list(known))
        values[name] = _value(parameter, text, option)
    return values


def refuse_missing(found: Any, stated: dict[str, Any]) -> None:
    """Raise ``ProgramError`` if a parameter has neither a stated value nor a default one."""
    variable = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    missing = [
        it
        for name, it in inspect.signature(found).parameters.items()
        if it.default is inspect.Parameter.empty and it.kind not in variable and name not in stated
    ]
    if not missing:
        return
    names = [it.name for it in missing]
    some = f"parameter{'s' if len(names) > 1 else ''} {' and '.join(names)}"
    hint = "a command line states values by name: give it a default value"
    if all(it.kind is not inspect.Parameter.POSITIONAL_ONLY for it in missing):
        options = " ".join(f"--{name.replace('_', '-')} VALUE" for name in names)
        hint = f"state it on the command line, {options}, or give it a default value"
    if len(names) > 1:
        hint = hint.replace(" it ", " them ").replace("a default value", "default values")
    called = getattr(found, "__qualname__", repr(found))
    raise ProgramError(f"{called} needs a value for its {some}", _place(found), hint, "")


def _place(found: Any) -> Place | None:
    """Return where what makes the program is defined: its constructor, or else its class."""
    made: Any = found
    function = inspect.unwrap(made.__init__ if inspect.isclass(found) else found)
    if isinstance(function, FunctionType):
        return _places.of_function(function)
    place: Place | None = getattr(found, "_hprm_place_", None)
    return place


def _unknown(name: str, option: str, known: list[str]) -> ProgramError:
    """Say that a name is neither that of an option nor that of a parameter."""
    # Only a command line with this mistake needs the module.
    from difflib import get_close_matches

    parameters = [it.replace("_", "-") for it in known]
    names = ", ".join(f"--{it}" for it in parameters)
    hint = f"the program has {names}" if names else "the program has no parameters"
    hint += "; `hprm run --help` shows the options"
    for near in get_close_matches(name.replace("_", "-"), [*parameters, *OPTIONS], 1):
        hint = f"did you mean --{near}?"
    message = f"{option} is neither an option of `hprm run` nor a parameter of the program"
    return ProgramError(message, hint=hint, code="")


def _value(parameter: inspect.Parameter, text: str, option: str) -> Any:
    expected = parameter.annotation
    if expected is inspect.Parameter.empty and parameter.default is not inspect.Parameter.empty:
        expected = type(parameter.default)
    name = expected if isinstance(expected, str) else getattr(expected, "__name__", "")
    if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'":
        text = text[1:-1]
    try:
        match name:
            case "int":
                return int(text)
            case "float":
                return float(text)
            case "bool" if text.lower() in ("true", "false"):
                return text.lower() == "true"
            case "bool":
                raise ValueError("it is true or false")
    except ValueError:
        raise ProgramError(f"{option}: the parameter is {one(name)}", code="") from None
    return text
