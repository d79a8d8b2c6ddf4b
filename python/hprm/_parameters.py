"""Parameters of a program's constructor, which a command line states as text."""

from __future__ import annotations

import inspect
from typing import Any

from hprm._mistakes import ProgramError, one

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
