"""What a script shows of an error in its program that it does not handle.

A mistake in a program is shown with its line, as the command ``hprm`` does; the way there leads
through this library and helps no reader. So it is with a file that hides a module of Python's
library, which this library uses. A program that Ctrl-C has stopped ends its script with
the exit code of that. All other exceptions are shown as Python shows them.
"""

import sys
from types import TracebackType


def show_mistakes() -> None:
    """Have mistakes shown so from now on, unless the process has a way of its own."""
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _show


def _show(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    from hprm import _errors, _hidden, _hprm
    from hprm._mistakes import ProgramError, ProgramInterrupted

    if isinstance(error, ProgramError) and error.location is not None:
        _hprm.tell_mistake(error)
    elif isinstance(error, ProgramError) and error.more is not None:
        print(f"{error.message}\n\n{error.more}", file=sys.stderr)
    elif isinstance(error, ProgramInterrupted):
        # It is a `SystemExit`, too. Python 3.14 and newer would take it for a `KeyboardInterrupt`
        # alone, print it, and end the process by a signal.
        raise SystemExit(error.code)
    elif (hiding := _hidden.found_in(error)) is not None and _errors.is_of_others(trace):
        print(f"error: {hiding}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)
