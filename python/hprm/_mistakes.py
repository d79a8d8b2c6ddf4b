"""What is wrong with a program in plain Python, found while its classes and objects are made."""

from __future__ import annotations

import warnings

from hprm import _hprm
from hprm._findings import DECLARED
from hprm._places import Place

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any


def one(name: str) -> str:
    """Return a name with its article: ``an Output``."""
    return f"{'an' if name[:1] in tuple('aeioAEIO') else 'a'} {name}"


class ProgramError(Exception):
    """Something is wrong with a program; the text says what, where, and what to do about it.

    Attributes
    ----------
    message
        What is wrong.
    place
        Where, as ``FILE:LINE``; empty if it is in the message.
    hint
        What to do about it, or None.
    code
        The code of the diagnostic; empty if the fault is not in the program itself.

    """

    def __init__(
        self,
        message: str,
        place: Place | None = None,
        hint: str | None = None,
        code: str = DECLARED,
    ) -> None:
        """Say what is wrong at a place."""
        self.message = message
        self.location = place
        #: If the message is all that the command shows of it: the line below, on how to read more.
        self.more: str | None = None
        self.place = "" if place is None else str(place)
        self.hint = hint
        self.code = code
        super().__init__(message)

    def __str__(self) -> str:
        """Return the place, the code, the message and the hint."""
        where = f"{self.place}: " if self.place else ""
        code = f"[{self.code}] " if self.code else ""
        hint = f"\n  hint: {self.hint}" if self.hint else ""
        return f"{where}{code}{self.message}{hint}"


class ProgramFailed(SystemExit):
    """A program has ended with a failure, which has been told on the standard error.

    It is a ``SystemExit``: a script that does not handle it ends with the exit code.

    Attributes
    ----------
    code
        The exit code.
    message
        What has happened, in a sentence; empty if only the exit code tells it, as after a signal.
    kind
        What kind of failure it is, as ``hprm run --json`` names it: ``"reaction"``, for example.
    place
        Where it has happened, as ``FILE:LINE``; empty if that is not known.
    hint
        What to do about it, or None.
    details
        More about it, such as the traceback, or None.
    federate
        The name of the federate that has failed, or None.
    reaction
        The full name of the reaction that has failed, or None.
    tag
        When it ran, in nanoseconds since the start and the microstep, or None.

    """

    code: int

    def __init__(self, code: int, report: str = "") -> None:
        """Take an exit code, and what ``hprm run --json`` tells, which may be missing."""
        super().__init__(code)
        told: dict[str, Any] = {}
        if report:
            import json

            told = json.loads(report)
        self.message: str = told.get("message") or ""
        self.kind: str = told.get("kind") or ""
        place = [str(it) for it in (told.get("file"), told.get("line")) if it is not None]
        self.place: str = ":".join(place)
        self.hint: str | None = told.get("hint")
        self.details: str | None = told.get("details")
        self.federate: str | None = told.get("federate")
        self.reaction: str | None = told.get("reaction")
        tag = told.get("tag")
        self.tag: tuple[int, int] | None = None if tag is None else (tag[0], tag[1])

    def __str__(self) -> str:
        """Return the message, or else the exit code."""
        return self.message or f"exit code {self.code}"


class ProgramInterrupted(ProgramFailed, KeyboardInterrupt):
    """A program has ended because of Ctrl-C: a ``KeyboardInterrupt``, with the exit code 130."""

    def __str__(self) -> str:
        """Say what has happened."""
        return self.message or f"the program was stopped by Ctrl-C (exit code {self.code})"


# The exit code of a program that SIGINT has stopped.
INTERRUPTED = 130


def failed(code: int, failures: list[str]) -> ProgramFailed:
    """Return the exception of a program that has ended with a code other than zero."""
    kind = ProgramInterrupted if code == INTERRUPTED else ProgramFailed
    return kind(code, *failures[:1])


class ProgramWarning(UserWarning):
    """Something in a program is probably not meant; Python's filters for warnings decide."""


#: The environment variable of a process whose program has been loaded before, with its warnings.
WARNED = "HPRM_WARNED"

#: Whether another process warns.
is_quiet = False

# What has been told.
_told: dict[str | tuple[str, type[Warning], int], int] = {}


def warn(message: str, place: Place, hint: str) -> None:
    """Warn about something in a program."""
    if not is_quiet and _hprm.current_federate() is None:
        text = f"{message}\n  hint: {hint}"
        warnings.warn_explicit(text, ProgramWarning, place.path, place.line, registry=_told)


for _public in (ProgramError, ProgramFailed, ProgramWarning):
    _public.__module__ = "hprm"
