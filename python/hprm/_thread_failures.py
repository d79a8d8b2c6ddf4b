"""Threads of a program that die: the program fails with them.

A robot whose camera thread has died would run on blind. So an exception that a thread does not
handle ends the program, as one in a reaction does. A program that sets ``threading.excepthook``
decides itself what such an exception means.
"""

import os
import threading

from hprm import _errors, _hprm

# By federate, or None where the process has one program: what ends it.
_programs: dict[int | None, "_hprm.Api"] = {}
_owner = os.getpid()
_failed_at_the_end = False


def watch(api: _hprm.Api) -> None:
    """End the program behind ``api`` when one of its threads dies."""
    global _owner
    _owner = os.getpid()
    _programs[_hprm.current_federate()] = api
    if threading.excepthook is threading.__excepthook__:
        threading.excepthook = _end_program


def failed_at_the_end() -> bool:
    """Whether a thread has died for which no program was left to end."""
    return _failed_at_the_end


def _end_program(args: threading.ExceptHookArgs) -> None:
    error = args.exc_value
    # `sys.exit` ends its thread, in Python too.
    if error is None or isinstance(error, SystemExit):
        return
    federate = _hprm.current_federate()
    api = _programs.get(federate, _programs.get(min(_programs, key=lambda it: it or 0)))
    if os.getpid() != _owner or api is None:
        threading.__excepthook__(args)
        return
    name = args.thread.name if args.thread is not None else "of native code"
    if not api.fail(_errors.printable(name), _errors.raised(error, f"thread {name}")):
        global _failed_at_the_end
        _failed_at_the_end = True
