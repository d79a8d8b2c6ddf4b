"""Ctrl-C while the process of a program starts: it ends without a traceback.

The command ``hprm`` blocks the signal when it starts an interpreter, so that none comes too early.
"""

import os
import signal
import sys
from types import FrameType


def quiet() -> None:
    """Have Ctrl-C end the process from now on, if ``python -m hprm`` begins here."""
    # What `-m` is while it looks for its module.
    if sys.argv[:1] != ["-m"] or "hprm" not in sys.orig_argv:
        return
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])


def done() -> None:
    """Have Ctrl-C raise ``KeyboardInterrupt`` from now on, as bodies expect it."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(number: int, _frame: FrameType | None) -> None:
    os._exit(128 + number)
