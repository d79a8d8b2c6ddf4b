"""Ctrl-C and failures while the process of a program starts: it ends without a traceback.

The command ``hprm`` blocks the signal when it starts an interpreter, so that none comes too early.
The garbage collector has nothing to do until the program's own code runs, and rests.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from types import FrameType, TracebackType

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

#: The modules that the command runs.
_MODULES = {"hprm", "hprm.ros", "hprm.ros._bags"}

#: Files that were there before the program, so that the garbage collector does not list them.
standard_files: list[Any] = []


def quiet() -> None:
    """Have Ctrl-C end the process from now on, if ``python -m hprm`` or the like begins here."""
    # What `-m` is while it looks for its module.
    if sys.argv[:1] != ["-m"] or not _MODULES & set(sys.orig_argv):
        return
    sys.excepthook = _tell
    gc.disable()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])


def done() -> None:
    """Have Ctrl-C raise ``KeyboardInterrupt`` from now on, as bodies expect it."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    loaded()


def collect_garbage() -> None:
    """Collect what the program's own code leaves behind, from now on.

    What has been loaded until now stays to the end, so no collection looks at it.
    """
    for stream in (sys.stdout, sys.stderr):
        standard_files.extend((stream, getattr(stream, "buffer", None)))
    gc.freeze()
    gc.enable()


def loaded() -> None:
    """Have failures be shown as Python does from now on: they are none of the start."""
    if sys.excepthook is _tell:
        sys.excepthook = sys.__excepthook__


def _end(number: int, _frame: FrameType | None) -> None:
    os._exit(128 + number)


def _tell(kind: type[BaseException], error: BaseException, _trace: TracebackType | None) -> None:
    # Without the package, the error itself says so.
    if "hprm" in sys.modules:
        from hprm import _hidden

        error = _hidden.found_in(error) or error
    if isinstance(error, ImportError) and hasattr(error, "hint"):
        print(f"error: {error}", file=sys.stderr)
        return
    hint = "is memory left (ulimit -v, the limit of its container)? hprm doctor looks at the rest"
    print(
        f"error: HPRM cannot be loaded: {kind.__name__}: {error}\n  hint: {hint}", file=sys.stderr
    )
