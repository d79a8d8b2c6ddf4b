"""What a script shows of an error in its program that it does not handle.

A mistake in a program is shown with its line, as the command ``hprm`` does; the way there leads
through this library and helps no reader. All other exceptions are shown as Python shows them.
"""

import sys
from types import TracebackType


def show_mistakes() -> None:
    """Have mistakes shown so from now on, unless the process has a way of its own."""
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _show


def _show(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    from hprm import _errors
    from hprm._mistakes import ProgramError

    if not isinstance(error, ProgramError) or error.location is None or error.__cause__:
        sys.__excepthook__(kind, error, trace)
        return
    found = _errors.describe(error, "loading")
    code = f"[{found.diagnostic}]" if found.diagnostic else ""
    lines = [f"error{code}: {found.message}", found.excerpt]
    lines += [f"  hint: {found.hint}"] if found.hint else []
    lines += ["", f"`hprm explain {found.diagnostic}` says more"] if found.diagnostic else []
    print(*lines, sep="\n", file=sys.stderr)
