"""Exceptions as the end of a program: an exit code, and what to tell the person who ran it."""

import os
import sys
import threading
import traceback

# Frames that do not help a reader: our own, those of a failed import, and how a thread starts.
_OWN = (os.path.dirname(__file__) + os.sep, "<frozen importlib.", threading.__file__)

# What helps where memory is short.
_MEMORY = (
    "drop values sooner, or let this process have more memory"
    " (ulimit -v, the limit of its container)"
)


def describe(error: BaseException, what: str, place: str = "") -> tuple[int, str]:
    """Return the exit code and the message, which is empty if there is nothing to say.

    It is about ``place`` if none of the program's lines is on the way to the error.
    """
    match error:
        case SystemExit(code=None):
            return 0, ""
        case SystemExit(code=int(code)):
            # As the process ends, which keeps eight bits: a failure must not become a zero.
            return code if 0 <= code <= 255 else 1, ""
        case SystemExit(code=reason):
            return 1, _text(reason)
        case KeyboardInterrupt():
            return 130, ""
        case SyntaxError(filename=str()):
            return 1, _syntax_error(error)
    trace = traceback.TracebackException.from_exception(error)
    _drop_own_frames(trace, set())
    name = type(error).__name__
    reason = _text(error).partition("\n")[0]
    title = f"error: {what} raised {name}" + (f": {reason}" if reason else "")
    frames = [frame for frame in trace.stack if frame.filename.endswith(".lf")]
    frames = frames or ([] if place else list(trace.stack))
    if frames:
        place = f"{frames[-1].filename}:{frames[-1].lineno}"
    lines = [title] + ([f"  --> {place}"] if place else [])
    if isinstance(error, ModuleNotFoundError) and error.name:
        package = error.name.partition(".")[0]
        lines.append(
            f"  hint: the program runs with {sys.executable}; install {package} there, or name "
            "another interpreter with --python"
        )
    if isinstance(error, MemoryError):
        lines.append(f"  hint: {_MEMORY}")
    text = "".join(trace.format()).rstrip()
    # Without a frame, it is often only what the title has said.
    if text not in (name, f"{name}: {reason}"):
        lines.append(text)
    # Only programs that fail pay for it.
    from hprm import _hints

    hint = _hints.of(error)
    # Python's own is in the text, from version 3.12 on.
    if hint is not None and not (hint.startswith("did you mean") and "Did you mean" in text):
        lines.append(f"  hint: {hint}")
    return 1, "\n".join(lines)


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


def _syntax_error(error: SyntaxError) -> str:
    line = error.lineno or 1
    column = error.offset or 1
    place = f"{error.filename}:{line}:{column}"
    text = (error.text or "").rstrip("\n")
    margin = " " * len(str(line))
    marker = "".join("\t" if c == "\t" else " " for c in text[: column - 1]) + "^"
    lines = [
        f"error: {error.msg}",
        f"{margin}--> {place}",
        f"{margin} |",
        f"{line} | {text}",
        f"{margin} | {marker}",
    ]
    hint = getattr(error, "hint", None)
    return "\n".join(lines if hint is None else [*lines, f"  hint: {hint}"])
