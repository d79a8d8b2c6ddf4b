"""The stack of a thread that runs a reaction for long, from its body on."""

import contextlib
import faulthandler
import os
import re
import signal
import sys
import traceback

from hprm._errors import printable

# Frames that do not help a reader.
_OWN = os.path.dirname(__file__) + os.sep

# What runs bodies, and coroutines that are bodies; the same in stalls.rs.
_CALLERS = ("__main__.py", "_launching.py", "testing.py", "_coroutines.py")

# As deep as a reader looks.
_DEPTH = 20


def stack(thread: int) -> str | None:
    """Return the frames of a thread as a traceback shows them; None if it runs no Python."""
    frame = sys._current_frames().get(thread)
    if frame is None:
        return None
    return _shown(_of_body(list(traceback.extract_stack(frame))))


def with_code(lines: str) -> str:
    """Return frames that ``faulthandler`` has written as a traceback shows them."""
    found = re.findall(r'^  File "(.*)", line (\d+) in (.*)$', lines, re.MULTILINE)
    frames = [traceback.FrameSummary(path, int(line), name) for path, line, name in found]
    return _shown(frames)


def _shown(frames: list[traceback.FrameSummary]) -> str:
    return printable("".join(traceback.format_list(frames[-_DEPTH:])))


def _of_body(frames: list[traceback.FrameSummary]) -> list[traceback.FrameSummary]:
    """Leave out what has started the program, which is above the body, and frames of ours."""
    first = next((at for at, it in enumerate(frames) if it.filename.endswith(".lf")), None)
    if first is None:
        callers = [at for at, it in enumerate(frames) if it.filename.removeprefix(_OWN) in _CALLERS]
        first = callers[-1] + 1 if callers else 0
    return [it for it in frames[first:] if not it.filename.startswith(_OWN)]


def arm(number: int) -> int | None:
    """Have a signal write the stack of its thread. Return where to; None if it is in use."""
    with contextlib.suppress(OSError, ValueError, RuntimeError):
        if signal.getsignal(number) is signal.SIG_DFL:
            dump = os.memfd_create("stacks")
            faulthandler.register(number, dump, all_threads=False, chain=False)
            return dump
    return None
