"""Exceptions as the end of a program: which end it is, and what is known of its cause.

How that is told is the extension module's business, which makes a failure of it.
"""

from __future__ import annotations

import linecache
import os
import select
import threading
import traceback

from hprm import _hidden
from hprm._findings import SYNTAX
from hprm._mistakes import ProgramError
from hprm._places import shown

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import TracebackType
    from typing import Any, NamedTuple
else:
    from hprm._records import NamedTuple

# Frames that do not help a reader: our own, those of a failed import, and how a thread starts.
_OWN = (os.path.dirname(__file__) + os.sep, "<frozen importlib.", threading.__file__)

# Where modules are that are not the program's.
_LIBRARIES = (
    f"{os.sep}site-packages{os.sep}",
    f"{os.sep}dist-packages{os.sep}",
    os.path.dirname(os.__file__) + os.sep,
)

# What helps where memory is short.
_MEMORY = (
    "drop values sooner, or let this process have more memory"
    " (ulimit -v, the limit of its container)"
)


class Description(NamedTuple):
    """What an exception means for the program."""

    #: ``left``, ``exited``, ``quit`` (with a text), ``interrupted``, ``unread`` (its output),
    #: ``mistake`` or ``raised``.
    end: str
    code: int = 1
    #: What has happened, in a sentence.
    message: str = ""
    file: str | None = None
    line: int | None = None
    column: int | None = None
    #: The lines around the place.
    excerpt: str | None = None
    #: The code of the diagnostic, if it is a mistake in the text of the program.
    diagnostic: str | None = None
    #: The way to the place.
    details: str | None = None
    #: What to do about it.
    hint: str | None = None


def describe(
    error: BaseException, what: str, place: str = "", is_bound: bool = False
) -> Description:
    """Return what an exception means that ends ``what``.

    It is about ``place`` if none of the program's lines is on the way to the error: lines of
    ``.lf`` files or, if the program ``is_bound``, of Python files that are not libraries.
    """
    match error:
        case SystemExit(code=None | 0):
            return Description("left", 0)
        case SystemExit(code=int(code)):
            return Description("exited", exit_code(code))
        case SystemExit(code=reason):
            return Description("quit", message=printable(_text(reason)))
        case KeyboardInterrupt():
            return Description("interrupted")
        case BrokenPipeError() if _is_unread():
            return Description("unread")
    return raised(error, what, place, is_bound)


def _is_unread() -> bool:
    """Whether the reader of the standard output has gone."""
    asked = select.poll()
    asked.register(1, 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in asked.poll(0))


def exit_code(code: int) -> int:
    """Return the last eight bits of an exit code, which the system keeps; of a failure no zero."""
    return code & 0xFF or int(code != 0)


def raised(error: BaseException, what: str, place: str = "", is_bound: bool = False) -> Description:
    """Return what is known of an exception by which ``what`` has failed, whatever it is."""
    try:
        found = _raised(error, what, place, is_bound)
    except Exception:
        # No memory or no descriptor is left, perhaps. What has happened must be told nevertheless.
        name = type(error).__name__
        found = Description("raised", message=f"{what} raised {name}: {_text(error)}")
    texts: dict[str, Any] = {}
    for name, it in found._asdict().items():
        if isinstance(it, str):
            texts[name] = printable(it)
    return found._replace(**texts)


def printable(text: str) -> str:
    """Return a text with escapes for what no encoding has: halves of characters."""
    return text.encode(errors="backslashreplace").decode()


def _raised(error: BaseException, what: str, place: str, is_bound: bool) -> Description:
    if isinstance(error, SyntaxError) and error.filename is not None:
        return _syntax_error(error)
    if isinstance(error, ProgramError):
        return _program_error(error)
    hiding = _hidden.found_in(error)
    if hiding is not None and (hiding is error or is_of_others(error.__traceback__)):
        return Description("mistake", message=hiding.message, file=hiding.file, hint=hiding.hint)
    trace = traceback.TracebackException.from_exception(error)
    _drop_own_frames(trace, set())
    name = type(error).__name__
    reason = _text(error).strip().partition("\n")[0].rstrip()
    file, line = _place(trace, place, is_bound)
    text = "".join(trace.format()).rstrip()
    short = text.removeprefix(f"{type(error).__module__}.")
    return Description(
        "raised",
        message=f"{what} raised {name}" + (f": {reason}" if reason else ""),
        file=file,
        line=line,
        # Without a frame, it is often only what the message has said.
        details=None if short in (name, f"{name}: {reason}") else text,
        hint=_hint(error, text),
    )


def _place(
    trace: traceback.TracebackException, place: str, is_bound: bool
) -> tuple[str | None, int | None]:
    """Where the program's own code is on the way to an error; or ``place``, if there is none."""
    frames = [frame for frame in trace.stack if frame.filename.endswith(".lf")]
    if not frames and (is_bound or not place):
        frames = _own(trace.stack)
    frames = frames or ([] if place else list(trace.stack))
    if frames:
        return _as_in_diagnostics(frames[-1].filename), frames[-1].lineno
    file, _, line = place.rpartition(":")
    return (file, int(line)) if file else (None, None)


def _as_in_diagnostics(path: str) -> str:
    """Return a path as diagnostics show it; Python has whole paths of the modules it imports."""
    try:
        return path if path.endswith(".lf") else shown(path)
    except OSError:
        # The current folder is gone.
        return path


def is_of_library(file: str) -> bool:
    """Tell whether a file is not the program's own."""
    return any(folder in file for folder in _LIBRARIES)


def is_of_others(trace: TracebackType | None) -> bool:
    """Tell whether an error was raised by this library, or by another one."""
    last = ""
    while trace is not None:
        last, trace = trace.tb_frame.f_code.co_filename, trace.tb_next
    return last.startswith(_OWN) or is_of_library(last)


def _own(stack: traceback.StackSummary) -> list[traceback.FrameSummary]:
    """Return the frames that are neither of libraries nor, if there are others, of made code."""
    frames = [it for it in stack if not is_of_library(it.filename)]
    frames = [it for it in frames if not it.filename.startswith("<frozen ")]
    frames = [it for it in frames if _is_here(it)] or frames
    return [it for it in frames if it.filename != "<string>"] or frames


def _is_here(frame: traceback.FrameSummary) -> bool:
    """Tell whether a frame names no file, or one that can be shown.

    What Cython has compiled names the file from which it was made, on the machine where that was
    done: ``numpy/random/_generator.pyx``. Python also looks for such a path where libraries are.
    """
    path = frame.filename
    is_found = os.path.isabs(path) or os.path.exists(path)
    return path.startswith("<") or (is_found and bool(frame.line))


def _hint(error: BaseException, text: str) -> str | None:
    if isinstance(error, MemoryError):
        return _MEMORY
    hiding = _hidden.found_in(error)
    if hiding is not None:
        return f"{hiding.message}: {hiding.hint}"
    try:
        # Only programs that fail pay for it.
        from hprm import _hints
    except Exception:
        # No descriptor is left to read it, perhaps.
        return None
    hint = _hints.of(error)
    # Python's own is in the text, from version 3.12 on.
    if hint is not None and hint.startswith("did you mean") and "Did you mean" in text:
        return None
    return hint


def _text(thing: object) -> str:
    try:
        return str(thing)
    except Exception as second:
        return f"(no text, because __str__ raised {type(second).__name__})"


def _drop_own_frames(trace: traceback.TracebackException, seen: set[int]) -> None:
    """Leave only frames of the program and of what it calls, in all exceptions of a chain."""
    if id(trace) in seen:
        return
    seen.add(id(trace))
    user = [frame for frame in trace.stack if not frame.filename.startswith(_OWN)]
    trace.stack = traceback.StackSummary.from_list(user)
    group = getattr(trace, "exceptions", None) or []
    for other in (trace.__cause__, trace.__context__, *group):
        if other is not None:
            _drop_own_frames(other, seen)


def _syntax_error(error: SyntaxError) -> Description:
    line = error.lineno or 1
    column = error.offset or 1
    place = f"{error.filename}:{line}:{column}"
    # The text of a program is compiled before it runs; any other text is compiled by the program.
    mistake = (error.filename or "").endswith(".lf")
    return Description(
        "mistake" if mistake else "raised",
        message=error.msg,
        diagnostic=getattr(error, "diagnostic", SYNTAX) if mistake else None,
        file=error.filename,
        line=line,
        column=column,
        excerpt=_excerpt(place, error.text or "", (line, column)),
        hint=getattr(error, "hint", None),
    )


def _excerpt(place: str, text: str, at: tuple[int, int]) -> str:
    """Show a line, with a marker below a column of it, which counts from one."""
    line, column = at
    text = text.rstrip("\n")
    margin = " " * len(str(line))
    marker = "".join("\t" if c == "\t" else " " for c in text[: column - 1]) + "^"
    lines = [f"{margin}--> {place}", f"{margin} |", f"{line} | {text}", f"{margin} | {marker}"]
    return "\n".join(lines)


def _program_error(error: ProgramError) -> Description:
    """Describe what is wrong with a program of Python objects."""
    place = error.location
    if place is None:
        found = Description("mistake", message=error.message, hint=error.hint)
        return found._replace(diagnostic=error.code or None)
    text = linecache.getline(place.path, place.line)
    column = len(text.encode()[: place.column].decode(errors="replace")) + 1
    file = shown(place.path)
    return Description(
        "mistake",
        message=error.message,
        diagnostic=error.code or None,
        file=file,
        line=place.line,
        column=column,
        excerpt=_excerpt(f"{file}:{place.line}:{column}", text, (place.line, column)),
        hint=error.hint,
    )
