"""Programs that are started inside another program, which are refused.

A reaction that ran a program would do so again in that program, and each of them may have processes
of its own, without an end.
"""

from __future__ import annotations

from hprm import _construction, _hprm
from hprm._mistakes import ProgramError
from hprm._places import here


def refuse(called: str) -> None:
    """Raise ``ProgramError`` where a reaction, or a constructor of a reactor, makes this call."""
    if _hprm.runs_bodies():
        raise ProgramError(
            f"{called} was called in a reaction, and a reaction cannot run a program",
            here(),
            "put the reactor into this program, or start another process with `subprocess`",
        )
    if _construction.current() is not None:
        raise ProgramError(
            f"{called} was called in the constructor of a reactor, which cannot run a program",
            here(),
            "assign the reactor to an attribute, so that it runs in this program, or call"
            f" {called} in the script",
        )
