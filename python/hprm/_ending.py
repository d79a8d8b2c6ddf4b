"""The end of a process that has run a program: what Python does at its own.

Threads that are no daemons are waited for, exit handlers run, what the program's modules hold is
dropped, and what is still in the buffers of files is written. The interpreter itself is left as it
is, so whatever else runs in the process, such as a daemon's C code, does not delay the end.
"""

from __future__ import annotations

import _io
import atexit
import contextlib
import gc
import os
import signal
import sys
import threading
import time
import traceback
import weakref
from collections.abc import Iterator
from types import FrameType, ModuleType

from hprm import _errors, _hprm, _startup, _thread_failures, _threads

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any, NoReturn

#: How long a federation that has failed waits for the threads of a federate, in seconds.
AFTER_FAILURE = 2.0

# When a person is told what the process waits for, in seconds.
_TOLD_AFTER = 1.0
# How long after a signal another one is the same, in seconds; as in interrupt.rs.
_TOGETHER = 0.1
# How long files may take whose readers are slow, or which a daemon keeps, in seconds.
_WRITING = 5.0

# The exit code of a process that a signal has ended is higher than its number by this.
_SIGNALLED = 128

# Where modules are that are not the program's.
_LIBRARIES = (
    f"{os.sep}site-packages{os.sep}",
    f"{os.sep}dist-packages{os.sep}",
    os.path.dirname(os.__file__) + os.sep,
)

# The exit code that follows because the standard output cannot be written, or zero.
_unwritten = 0

# Taken by the thread that is first: the main thread, or the one that waits for the timeout.
_last = threading.Lock()


class _Stopped(KeyboardInterrupt):
    """A signal has come that ends whatever is waited for."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = _SIGNALLED + number


def leave(code: int, patience: float | None = None) -> NoReturn:
    """End the process with an exit code, after ``patience`` seconds whatever its threads do.

    None is as long as they take.
    """
    code = _errors.exit_code(code)
    try:
        _listen(code)
        if patience != 0:
            _wait_for_threads(code, patience)
    except _Stopped as stopped:
        code = code or stopped.code
    _finish(code)


def leave_child(error: BaseException | None) -> NoReturn:
    """End a process that a body has forked, and that comes back from it: as Python ends one."""
    code = 0
    match error:
        case None | SystemExit(code=None):
            pass
        case SystemExit(code=int(number)):
            # Here a zero may come of it, as elsewhere: the program has asked for that.
            code = number & 0xFF
        case SystemExit(code=text):
            _say(str(text))
            code = 1
        case _:
            code = _SIGNALLED + signal.SIGINT if isinstance(error, KeyboardInterrupt) else 1
            with contextlib.suppress(Exception):
                sys.excepthook(type(error), error, error.__traceback__)
    _wait_for_threads(code, None)
    _finish(code)


def _listen(code: int) -> None:
    """Let signals end what follows, unless the program has handlers of its own."""
    if threading.current_thread() is not threading.main_thread():
        return
    # The one that has stopped the program may come by another way too.
    until = time.monotonic() + _TOGETHER if code > _SIGNALLED else 0.0

    def stop(number: int, _frame: FrameType | None) -> None:
        if time.monotonic() >= until:
            raise _Stopped(number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        current = signal.getsignal(number)
        if isinstance(current, _hprm.Interrupt) or current is signal.default_int_handler:
            signal.signal(number, stop)


def _wait_for_threads(code: int, patience: float | None) -> None:
    done = threading.Event()
    if _waited_for():
        arguments = (done, code, patience)
        threading.Thread(target=_watch, args=arguments, name="hprm", daemon=True).start()
    try:
        # What the interpreter calls: executors are told, and end what they have been given.
        with _stopped_while_joining():
            threading._shutdown()  # type: ignore[attr-defined]
    except AssertionError:
        # A forked copy of a thread that Python has not started; executors have been told.
        for thread in threading.enumerate():
            if not thread.daemon and thread is not threading.current_thread():
                thread.join()
    except Exception:
        traceback.print_exc()
    finally:
        done.set()


@contextlib.contextmanager
def _stopped_while_joining() -> Iterator[None]:
    """Raise what a signal raises while threads are joined: Python 3.13 and newer only report it."""
    reported = sys.unraisablehook
    stopped: list[_Stopped] = []

    def report(unraisable: sys.UnraisableHookArgs) -> None:
        if isinstance(unraisable.exc_value, _Stopped):
            stopped.append(unraisable.exc_value)
        else:
            reported(unraisable)

    sys.unraisablehook = report
    try:
        yield
    finally:
        sys.unraisablehook = reported
    if stopped:
        raise stopped[0]


def _waited_for() -> list[str]:
    """The threads that keep a process, apart from this one."""
    threads = threading.enumerate()
    kept = [it for it in threads if not it.daemon and it is not threading.main_thread()]
    return [it.name for it in kept if it is not threading.current_thread()]


def _watch(done: threading.Event, code: int, patience: float | None) -> None:
    """Tell what the process waits for, and end it once that has taken too long."""
    if done.wait(_TOLD_AFTER if patience is None else min(_TOLD_AFTER, patience)):
        return
    if names := ", ".join(_waited_for()):
        hint = "Ctrl-C ends it; daemon=True makes a thread that is not waited for"
        _say(f"warning: the program has ended, but not its threads: {names}\n  hint: {hint}")
    if patience is None or done.wait(max(patience - _TOLD_AFTER, 0.0)):
        return
    _say(f"warning: did not wait longer than {patience:g} s for threads: {names}")
    _finish(code)


def _say(message: str) -> None:
    with contextlib.suppress(OSError, ValueError):
        print(message, file=sys.stderr, flush=True)


def _finish(code: int) -> NoReturn:
    _last.acquire()
    steps = [
        atexit._run_exitfuncs,
        _flush_streams,
        # The garbage collector may close a file before it takes what is still in its buffer.
        _write_files,
        _drop_modules,
        _flush_streams,
        _write_files,
    ]
    out_of_memory = False
    for step in steps:
        try:
            step()
        except _Stopped:
            # A signal ends what takes too long, as it does with Python.
            continue
        except MemoryError:
            out_of_memory = True
    code = code or int(_thread_failures.failed_at_the_end() or out_of_memory) or _unwritten
    if _is_observed() and threading.current_thread() is threading.main_thread():
        # A profiler reports when the program returns to it.
        sys.exit(code)
    os._exit(code)


def _is_observed() -> bool:
    """Whether a profiler, debugger or coverage tool runs the interpreter."""
    if sys.getprofile() is not None or sys.gettrace() is not None:
        return True
    monitoring = getattr(sys, "monitoring", None)
    return monitoring is not None and any(map(monitoring.get_tool, range(6)))


def _flush_streams() -> None:
    for stream in (sys.stdout, sys.stderr):
        # Closed by the program or at the other end: then there is no reader.
        with contextlib.suppress(OSError, ValueError, AttributeError):
            if isinstance(stream, _threads.Lines):
                stream.end()
            _flush_stream(stream)


def _flush_stream(stream: Any) -> None:
    global _unwritten
    if getattr(stream, "_failed", False):
        # That has been told.
        return
    try:
        stream.flush()
    except OSError as error:
        if stream is sys.stdout and not _unwritten:
            _unwritten = _hprm.output_failed(error.errno or 0)


def _drop_modules() -> None:
    """Drop all that the program's modules refer to, so that it is closed and finalized.

    That is left out if others still run Python code, which may need it.
    """
    if len(sys._current_frames()) > 1:
        return
    # The collector finalizes objects in the order of its lists, and a full collection puts the
    # youngest generation before the middle one. An archive comes before the file that it has
    # opened only if both of these are empty.
    gc.collect(1)
    found = {id(module): weakref.ref(module) for module in _program_modules()}
    for name in [name for name, module in sys.modules.items() if _is_program(name, module)]:
        del sys.modules[name]
    # First with all names in place, for the sake of finalizers.
    gc.collect()
    left = [module for reference in found.values() if (module := reference()) is not None]
    for module in reversed(left):
        names = vars(module)
        # Those with an underscore first, as the interpreter does.
        for name in sorted(names, key=lambda name: not name.startswith("_")):
            if name != "__builtins__":
                names[name] = None
    if left:
        gc.collect()


def _program_modules() -> Iterator[ModuleType]:
    for name, module in list(sys.modules.items()):
        if _is_program(name, module):
            yield from _threads.versions(module)


def _is_program(name: str, module: Any) -> bool:
    """Whether a module is the program's own, rather than a library's."""
    if isinstance(module, _threads.PerFederate):
        return True
    if not isinstance(module, ModuleType) or vars(module).get("__package__") == "hprm":
        return False
    if name == "__main__":
        return True
    package = name.partition(".")[0]
    path = vars(module).get("__file__")
    if package == "hprm" or package in sys.stdlib_module_names or not isinstance(path, str):
        return False
    return not any(folder in path for folder in _LIBRARIES)


def _write_files() -> None:
    """Write the buffers of files to which there are still references."""
    # By their types: `isinstance` would run code of objects that stand for others.
    known = [*gc.get_objects(), *_startup.standard_files]
    files = [it for it in known if issubclass(type(it), _io._IOBase)]
    # Texts first: their bytes go to the buffers of others.
    files.sort(key=lambda it: not issubclass(type(it), _io._TextIOBase))
    # A thread that is writing to a file has its lock.
    work = threading.Thread(target=_flush, args=(files,), daemon=True)
    try:
        work.start()
    except RuntimeError:
        # There is no memory for a thread.
        _flush(files)
        return
    work.join(_WRITING)


def _flush(files: list[Any]) -> None:
    for file in files:
        # Closed, unreadable, or of a type that is not complete: it has nothing to write.
        with contextlib.suppress(Exception):
            if not file.closed and file.writable():
                file.flush()
