"""The stack of a thread that runs a reaction for long, with the lines of the ``.lf`` file."""

import contextlib
import faulthandler
import os
import signal
import sys
import traceback

from hprm._errors import printable

# Frames that do not help a reader.
_OWN = os.path.dirname(__file__) + os.sep

# As deep as a reader looks.
_DEPTH = 20


def stack(thread: int) -> str | None:
    """Return the frames of a thread as a traceback shows them; None if it runs no Python."""
    frame = sys._current_frames().get(thread)
    if frame is None:
        return None
    frames = [it for it in traceback.extract_stack(frame) if not it.filename.startswith(_OWN)]
    # What the program was started by is above the body.
    first = next((at for at, it in enumerate(frames) if it.filename.endswith(".lf")), 0)
    return printable("".join(traceback.format_list(frames[first:][-_DEPTH:])))


def arm(number: int) -> int | None:
    """Have a signal write the stack of its thread. Return where to; None if it is in use."""
    with contextlib.suppress(OSError, ValueError, RuntimeError):
        if signal.getsignal(number) is signal.SIG_DFL:
            dump = os.memfd_create("stacks")
            faulthandler.register(number, dump, all_threads=False, chain=False)
            return dump
    return None
