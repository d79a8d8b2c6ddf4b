"""Running a program of Python objects from a script, a notebook, or a test.

A program in one process runs in this one. The federates of a federation are processes, which load
the file again that defines it, as ``hprm run FILE`` has them do.
"""

from __future__ import annotations

import fcntl
import os
import pickle
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any

from hprm import _construction, _duration, _hprm, _loading, _nested, _structure
from hprm._declared import Declared
from hprm._duration import Time
from hprm._mistakes import INTERRUPTED, WARNED, ProgramError, failed, one
from hprm._places import here, shown
from hprm._reactor import Federation, Reactor


def run(
    program: Reactor | type[Reactor],
    *,
    timeout: Time | None = None,
    fast: bool | None = None,
    properties: Mapping[str, object] | None = None,
    processes: bool = True,
    logical_trace: str | os.PathLike[str] | None = None,
    trace: str | os.PathLike[str] | None = None,
) -> None:
    """Run a program to its end.

    Parameters
    ----------
    program : Reactor or type
        The main reactor, or its class if the constructor needs no arguments.
    timeout : Time, optional
        The last tag of the program, as a time after its start.
    fast : bool, optional
        Whether logical time runs ahead of the clock.
    properties : dict, optional
        Other target properties by their names, which override those of the class.
    processes : bool, default True
        Whether the federates of a federation are processes. Otherwise all reactors run here.
    logical_trace : str or path, optional
        The file that gets the logical trace.
    trace : str or path, optional
        The file that gets the trace of reactions, messages and grants in physical time, for
        Perfetto.

    Raises
    ------
    ProgramError
        If something is wrong with the program, or a reaction or a constructor of a reactor calls
        this; nothing has run then.
    ProgramFailed
        If the program fails; what has happened is told on the standard error. It is a
        ``SystemExit``: a script that does not handle it ends with the exit code. After Ctrl-C it is
        a ``KeyboardInterrupt``, too.

    """
    file = _loading.loading()
    if file is not None:
        raise ProgramError(
            f"hprm.run was called while {file} was loaded",
            here(),
            'put it below `if __name__ == "__main__":`, so that federates can import the file',
        )
    _nested.refuse("hprm.run")
    main = program() if isinstance(program, type) else program
    if not isinstance(main, Reactor):
        raise TypeError(f"a program is a hprm.Reactor, not {one(type(main).__name__)}")
    stated: dict[str, Any] = {"timeout": timeout, "fast": fast, **(properties or {})}
    options = [_property(name, value) for name, value in stated.items() if value is not None]
    try:
        declared = Declared(main)
        warnings = _refuse(declared, options)
    except ProgramError as error:
        # How it was found is of no help to the user.
        raise error.with_traceback(None) from error.__cause__
    except KeyboardInterrupt:
        raise failed(INTERRUPTED, []) from None
    traces = {"--logical-trace": logical_trace, "--trace": trace}
    files = {option: os.fspath(path) for option, path in traces.items() if path is not None}
    failures: list[str] = []
    if isinstance(main, Federation) and processes:
        # The command says what to beware of.
        try:
            code = _launch(main, options, files, failures)
        except KeyboardInterrupt:
            # It came before there was anything to stop.
            code = INTERRUPTED
    else:
        _tell(warnings)
        code = _hprm.run_declared(
            declared,
            options,
            logical_trace=files.get("--logical-trace"),
            trace=files.get("--trace"),
            failures=failures,
        )
    if code:
        raise failed(code, failures)


def check(program: Reactor | type[Reactor] | Declared, properties: list[str] | None = None) -> None:
    """Check a program by the rules of the language, without running it.

    Parameters
    ----------
    program : Reactor or type
        The main reactor, or its class if the constructor needs no arguments.
    properties : list of str, optional
        Target properties that override those of the class, each as ``KEY=VALUE``.

    Raises
    ------
    ProgramError
        If something is wrong with it. Warnings are printed on the standard error.

    """
    if isinstance(program, type):
        program = program()
    declared = program if isinstance(program, Declared) else Declared(program)
    _tell(_refuse(declared, properties or []))


def _refuse(declared: Declared, properties: list[str]) -> str:
    """Raise ``ProgramError`` if something is wrong with a program, or return its warnings."""
    is_right, text, more = _hprm.check_declared(declared, properties)
    if not is_right:
        error = ProgramError(text.strip(), code="")
        error.more = more
        raise error
    return text.rstrip()


def _tell(warnings: str) -> None:
    if warnings:
        print(warnings, file=sys.stderr)


def _property(name: str, value: Any) -> str:
    """Return a target property as the command line states it."""
    name = name.replace("_", "-")
    if name in _structure.TIMES and value not in ("auto", "off"):
        return f"{name}={_duration.stated(name, value, here())} ns"
    if isinstance(value, bool):
        return f"{name}={str(value).lower()}"
    if isinstance(value, list | tuple):
        return f"{name}=[{', '.join(map(str, value))}]"
    plain = isinstance(value, int) or str(value).replace("-", "").isalnum()
    return f"{name}={value}" if plain else f'{name}="{value}"'


def _launch(
    main: Federation, properties: list[str], traces: dict[str, str], failures: list[str]
) -> int:
    """Run a federation as processes, by the command ``hprm``. Return its exit code.

    What has failed is added to ``failures``, as JSON.
    """
    command = _command()
    program = _importable(main)
    options = [option for it in properties for option in ("--property", it)]
    options += [word for option in traces.items() for word in option]
    # A file without a name, of which nothing is left however the processes end.
    with (
        os.fdopen(_memory("hprm-call"), "wb") as file,
        os.fdopen(_memory("hprm-failures"), "r+", encoding="utf-8") as told,
    ):
        try:
            pickle.dump(_construction.of(main).call, file)
            file.flush()
        except Exception as error:
            raise ProgramError(
                f"the arguments of {type(main).__name__} cannot be passed to federates: {error}",
                _construction.of(main).place,
                "federates are processes: pass what can be pickled",
            ) from None
        options.append(f"--failures-to=/proc/self/fd/{told.fileno()}")
        descriptors = (file.fileno(), told.fileno())
        code = launch(command, [*options, program], descriptors)
        failures += told.read().splitlines()
        return code


def _memory(name: str) -> int:
    """Make a file in memory, and return its descriptor.

    It takes the place of no standard stream that is closed: other processes would write to it.
    """
    made = os.memfd_create(name)
    if made > 2:
        return made
    try:
        return fcntl.fcntl(made, fcntl.F_DUPFD_CLOEXEC, 3)
    finally:
        os.close(made)


def launch(command: str, words: list[str], descriptors: tuple[int, ...] = ()) -> int:
    """Have the command run a federation. Return its exit code.

    It gets these descriptors, of which the first one has the arguments of the federation.
    """
    environment = os.environ | {WARNED: "1"}
    if descriptors:
        environment[_loading.CALL] = f"/proc/self/fd/{descriptors[0]}"
    parent = os.getpid()
    return _wait(
        lambda: subprocess.Popen(
            [command, "run", "--python", sys.executable, "--federation-known", *words],
            env=environment,
            pass_fds=descriptors,
            # However this process ends, none is left behind.
            preexec_fn=lambda: _hprm.die_with_parent(parent),
        )
    )


def _wait(start: Callable[[], subprocess.Popen[bytes]]) -> int:
    """Start the command, which gets the signals of this process, and wait until it has stopped."""
    process: subprocess.Popen[bytes] | None = None
    early: list[int] = []

    def forward(number: int, _: object) -> None:
        # Ctrl-C in a terminal is for all processes there; of two at a time, the command takes one.
        if process is None:
            early.append(number)
        else:
            process.send_signal(number)

    try:
        numbers = [signal.SIGINT, signal.SIGTERM]
        # Of the terminal that closes, unless the script is to outlive it (nohup).
        if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
            numbers.append(signal.SIGHUP)
        before = {it: signal.signal(it, forward) for it in numbers}
    except ValueError:
        # Only the main thread can; in another one, no signal comes.
        return _ended(start())
    try:
        process = start()
        for number in early:
            process.send_signal(number)
        return _ended(process)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _ended(process: subprocess.Popen[bytes]) -> int:
    """Wait for a process, and return its exit code; that of a signal is as in a shell."""
    code = process.wait()
    return code if code >= 0 else 128 - code


def _command() -> str:
    beside = os.path.join(os.path.dirname(sys.executable), "hprm")
    found = beside if os.access(beside, os.X_OK) else shutil.which("hprm")
    if found is None:
        raise ProgramError(
            "there is no command `hprm` to start the federates with",
            hint="it is installed with the package; or run all in this process: processes=False",
            code="",
        )
    return found


def _importable(main: Federation) -> str:
    """Return the program as the command line names it: its file, and its class in that."""
    cls = type(main)
    path = getattr(sys.modules.get(cls.__module__), "__file__", None)
    hint = (
        "define it at the top level of a file, or run all in this process:"
        " hprm.run(..., processes=False)"
    )
    if not isinstance(path, str) or not path.endswith(".py"):
        raise ProgramError(
            f"the federates of {cls.__name__} are processes that import it, and it is in no file",
            cls._hprm_place_,
            hint,
        )
    if "<locals>" in cls.__qualname__:
        raise ProgramError(
            f"the federates of {cls.__name__} are processes that import it, and it is defined in a"
            " function",
            cls._hprm_place_,
            hint,
        )
    return f"{shown(path)}:{cls.__qualname__}"
