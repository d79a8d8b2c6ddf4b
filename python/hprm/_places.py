"""Where the user's own code declares something: a file, a line, and columns if they are known."""

from __future__ import annotations

import linecache
import os
import sys
from collections.abc import Iterable
from itertools import islice
from types import FrameType, FunctionType

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any, NamedTuple
else:
    from hprm._records import NamedTuple

_OWN = os.path.dirname(__file__) + os.sep


class Place(NamedTuple):
    """A part of a line: columns in bytes of UTF-8 from 0; an end of -1 is the end of the line."""

    path: str
    line: int
    column: int = 0
    end: int = -1

    def __str__(self) -> str:
        """Return what messages show."""
        return f"{shown(self.path)}:{self.line}"


def shown(path: str) -> str:
    """Return a path as messages show it: relative to the current folder if it is in it."""
    folder = os.getcwd() + os.sep
    return path.removeprefix(folder) if os.path.isabs(path) else path


def here() -> Place:
    """Return the expression of the user that is being evaluated: the nearest frame of no ours."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and _is_between(frame):
        frame = frame.f_back
    if frame is None:
        return Place("<unknown>", 1)
    return _of_frame(frame)


def _is_between(frame: FrameType) -> bool:
    """Return whether a frame lies between the user's code and ours, which makes classes."""
    is_own = frame.f_code.co_filename.startswith(_OWN)
    return is_own or frame.f_globals.get("__name__") in ("abc", "typing")


def _of_frame(frame: FrameType) -> Place:
    path, line = frame.f_code.co_filename, frame.f_lineno
    positions = getattr(frame.f_code, "co_positions", None)
    if positions is None or frame.f_lasti < 0:
        return of_line(path, line)
    first, last, column, end = next(islice(positions(), frame.f_lasti // 2, None), (None,) * 4)
    if first is None or column is None:
        return of_line(path, line)
    return Place(path, first, column, end if first == last and end is not None else -1)


def of_function(function: FunctionType) -> Place:
    """Return the first line of a function: that of its first decorator, if it has one."""
    return of_line(function.__code__.co_filename, function.__code__.co_firstlineno)


def of_assignment(functions: Iterable[Any], name: str) -> Place | None:
    """Return the first line of some functions that assigns to the attribute ``name``."""
    # Only a program with a mistake needs the module.
    import dis

    for function in functions:
        code = getattr(function, "__code__", None)
        if code is None:
            continue
        for instruction in dis.get_instructions(code):
            if instruction.opname == "STORE_ATTR" and instruction.argval == name:
                lines = (
                    line
                    for first, end, line in code.co_lines()
                    if first <= instruction.offset < end
                )
                return of_line(code.co_filename, next(lines) or code.co_firstlineno)
    return None


def of_line(path: str, line: int) -> Place:
    """Return a line without the white space before it."""
    text = linecache.getline(path, line)
    return Place(path, line, len(text) - len(text.lstrip()))
