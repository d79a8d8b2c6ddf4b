"""What follows ``--ros-args`` on a command line, up to ``--`` or the end.

``-r RULE`` remaps, ``-p NAME:=VALUE`` and ``--params-file FILE`` set parameters, ``--log-level
LEVEL`` or ``--log-level LOGGER:=LEVEL`` sets levels. Enclaves, external log files and the outputs
of the log are read as in ROS 2, too. Nothing is done here: the caller gets what was asked for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from hprm.ros._names import topic_error
from hprm.ros._overrides import Overrides
from hprm.ros._remapping import RemapRule, parse_remap_rule
from hprm.ros.exceptions import RCLInvalidROSArgsError, UnknownROSArgsError
from hprm.ros.impl.logging_severity import LoggingSeverity

_BEGIN = "--ros-args"
_END = "--"
_OUTPUTS = {"stdout-logs": "log_to_console", "rosout-logs": "log_to_rosout"}
_NOTHING = ("external-lib-logs",)


@dataclass
class RosArguments:
    """What a command line asks for."""

    rules: list[RemapRule] = field(default_factory=list)
    overrides: Overrides = field(default_factory=Overrides)
    #: The level of all loggers without a level of their own.
    level: LoggingSeverity | None = None
    levels: dict[str, LoggingSeverity] = field(default_factory=dict)
    log_to_console: bool = True
    log_to_rosout: bool = True
    enclave: str | None = None
    #: Options that concern external log libraries, which are not there.
    ignored: list[str] = field(default_factory=list)
    #: The arguments that are not for ROS, in their order; the first one is the program.
    others: list[str] = field(default_factory=list)
    #: Rules that stand outside of ``--ros-args``, which ROS 2 accepts with a warning.
    deprecated: list[str] = field(default_factory=list)


def parse_ros_arguments(arguments: Sequence[str]) -> RosArguments:
    """Read a command line.

    Raises
    ------
    RCLInvalidROSArgsError
        If an argument cannot be read; the message names it, and what is wrong.
    UnknownROSArgsError
        If there are arguments in ``--ros-args`` that ROS does not know.

    """
    parsed = RosArguments()
    unknown: list[str] = []
    inside = False
    rest = list(arguments)
    while rest:
        argument = rest.pop(0)
        if argument == _BEGIN:
            inside = True
        elif not inside:
            _take_other(argument, parsed)
        elif argument == _END:
            inside = False
        elif (read := _OPTIONS.get(argument)) is not None:
            if not rest:
                raise _invalid(argument, "it needs a value behind it")
            _read(read, argument, rest.pop(0), parsed)
        elif not _switched(argument, parsed):
            unknown.append(argument)
    if unknown:
        raise UnknownROSArgsError(f"Found unknown ROS arguments: {unknown}")
    return parsed


def _invalid(argument: str, why: object) -> RCLInvalidROSArgsError:
    return RCLInvalidROSArgsError(f"Failed to parse ROS arguments: '{argument}': {why}")


def _read(
    read: Callable[[str, RosArguments], None], option: str, value: str, parsed: RosArguments
) -> None:
    try:
        read(value, parsed)
    except ValueError as error:
        raise _invalid(f"{option} {value}", error) from None


def _take_other(argument: str, parsed: RosArguments) -> None:
    if ":=" in argument:
        try:
            parsed.rules.append(parse_remap_rule(argument))
        except ValueError:
            pass
        else:
            parsed.deprecated.append(argument)
            return
    parsed.others.append(argument)


def _switched(argument: str, parsed: RosArguments) -> bool:
    for prefix, enabled in (("--enable-", True), ("--disable-", False)):
        output = argument.removeprefix(prefix)
        if output == argument:
            continue
        if output in _OUTPUTS:
            setattr(parsed, _OUTPUTS[output], enabled)
            return True
        if output in _NOTHING:
            parsed.ignored.append(argument)
            return True
    return False


def _remap(text: str, parsed: RosArguments) -> None:
    parsed.rules.append(parse_remap_rule(text))


def _parameter(text: str, parsed: RosArguments) -> None:
    from hprm.ros._parameter_yaml import parse_parameter_value

    name, separator, value = text.partition(":=")
    if not separator:
        raise ValueError("a parameter is written NAME:=VALUE")
    node, colon, parameter = name.partition(":")
    if not colon:
        node, parameter = "/**", name
    if not re.fullmatch(r"[A-Za-z_][\w/.]*", parameter, flags=re.ASCII):
        raise ValueError(f"'{parameter}' is no name of a parameter")
    parsed.overrides.add(node, parameter, parse_parameter_value(value))


def _parameter_file(path: str, parsed: RosArguments) -> None:
    from hprm.ros._parameter_yaml import read_parameter_file

    read_parameter_file(path, parsed.overrides)


def _level(text: str, parsed: RosArguments) -> None:
    logger, separator, level = text.rpartition(":=")
    try:
        severity = LoggingSeverity[level.upper()]
    except KeyError:
        names = ", ".join(name.lower() for name in LoggingSeverity.__members__)
        raise ValueError(f"'{level}' is no level: there are {names}") from None
    if not separator:
        parsed.level = severity
    elif logger:
        parsed.levels[logger] = severity
    else:
        raise ValueError("there is no name of a logger before :=")


def _enclave(text: str, parsed: RosArguments) -> None:
    wrong = None if text == "/" else topic_error(text)
    if wrong is not None:
        raise ValueError("an enclave is a path such as /robot/camera")
    parsed.enclave = text


def _external(text: str, parsed: RosArguments) -> None:
    parsed.ignored.append(text)


_OPTIONS: dict[str, Callable[[str, RosArguments], None]] = {
    "-r": _remap,
    "--remap": _remap,
    "-p": _parameter,
    "--param": _parameter,
    "--params-file": _parameter_file,
    "--log-level": _level,
    "-e": _enclave,
    "--enclave": _enclave,
    "--log-config-file": _external,
    "--log-file-name": _external,
}
