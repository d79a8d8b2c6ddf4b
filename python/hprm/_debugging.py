"""Debuggers: ``breakpoint()`` in a federate that has no terminal says how to give it one."""

from __future__ import annotations

import os
import stat
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any


def explain_breakpoints(federate: str) -> None:
    """Have ``breakpoint()`` raise an error that helps, if nothing can be typed in this process."""
    if "PYTHONBREAKPOINT" in os.environ or not _is_without_input():
        return

    def hook(*_arguments: Any, **_options: Any) -> None:
        way = f"hprm run --debug {federate}" if federate else "hprm run --debug FEDERATE"
        raise RuntimeError(
            f"breakpoint() needs a terminal, and federates have none: run the program with `{way}`"
        )

    sys.breakpointhook = hook


def _is_without_input() -> bool:
    """Whether the standard input is the null device."""
    try:
        status = os.fstat(0)
        null = os.stat(os.devnull)
    except OSError:
        return True
    return stat.S_ISCHR(status.st_mode) and status.st_rdev == null.st_rdev
