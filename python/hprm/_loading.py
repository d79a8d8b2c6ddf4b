"""Loading a program of Python objects from its file, in the processes that run it.

The file is imported as a module under a name that ``hprm._module_names`` gives it, so what is below
``if __name__ == "__main__":`` does not run. The program is the class, the object or the function
that the caller names, or the one federation or reactor class that the file defines.
"""

from __future__ import annotations

import importlib
import importlib.util
import io
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import FrameType, ModuleType
from typing import Any, BinaryIO

from hprm import _errors, _findings, _hprm, _module_names, _parameters, _places, _threads
from hprm._declared import Declared
from hprm._mistakes import ProgramError
from hprm._reactor import Federation, Reactor
from hprm._uncached import UncachedLoader

#: The environment variable with the file that has the arguments of the program's constructor.
CALL = "HPRM_PROGRAM_CALL"
#: The prefix of a property that is a parameter of the program's constructor.
_PARAMETER = "main."

# The file that is being loaded.
_loading: list[str] = []


def load(path: str, properties: list[str]) -> Declared:
    """Load the program at ``path``, which is ``FILE.py`` or ``FILE.py:NAME``.

    Parameters
    ----------
    path
        The file, and the class, object or function in it.
    properties
        ``KEY=VALUE``; those that begin with ``main.`` are arguments of the constructor.

    """
    try:
        return _load(path, properties)
    except SystemExit as error:
        if _is_of_library(path, error):
            # A parser of the command line has told the user what is wrong, or shown its help.
            raise
        raise _ended(path, error) from None


def _load(path: str, properties: list[str]) -> Declared:
    named = _hprm.named_program(path)
    if named is None:
        raise ProgramError(f"{path} is no program in Python", code="")
    file, name = named
    if name == "":
        raise ProgramError(
            f"{path} ends with a colon, and names no reactor",
            hint=f"write {file}:NAME, or {file} alone",
            code="",
        )
    module = _import(file)
    found = _only(module, file) if name is None else _named(module, file, name)
    stated = [it.removeprefix(_PARAMETER) for it in properties if it.startswith(_PARAMETER)]
    return Declared(_made(found, file, dict(it.split("=", 1) for it in stated)))


def _is_of_library(path: str, error: SystemExit) -> bool:
    """Tell whether a library has ended the interpreter, other than by a call of ``exit()``."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    file = os.path.abspath(frame.f_code.co_filename)
    if file == _file_of(path) or "_sitebuiltins" in file:
        return False
    return _errors.is_of_library(file)


def _file_of(path: str) -> str:
    return os.path.abspath((_hprm.named_program(path) or (path,))[0])


def _ended(path: str, error: SystemExit) -> ProgramError:
    """Say where the program has ended the interpreter, instead of declaring itself."""
    place, code = None, "" if error.code is None else repr(error.code)
    file = _file_of(path)
    for frame, line in traceback.walk_tb(error.__traceback__):
        if os.path.abspath(frame.f_code.co_filename) == file:
            place = _places.of_line(frame.f_code.co_filename, line)
    return ProgramError(
        f"{path} ends the interpreter while it is loaded: sys.exit({code})",
        place,
        'put what only a script does below `if __name__ == "__main__":`; a reaction may end the'
        " program",
        _findings.LOADING,
    )


def loading() -> str | None:
    """Return the file that is being loaded, if one is."""
    return _loading[-1] if _loading else None


def _import(file: str) -> ModuleType:
    folder, name = _module_names.of_file(file)
    if sys.path[:1] != [folder]:
        sys.path.insert(0, folder)
    _module_names.tell_processes(file)
    package = name.rpartition(".")[0]
    if package:
        # For imports that are relative to it.
        importlib.import_module(package)
    # Federates that share a process have each a module of their own, as processes have.
    shared = _hprm.current_federate() is not None
    known = None if shared else sys.modules.get(name)
    if known is not None and getattr(known, "__file__", None) == os.path.abspath(file):
        return known
    spec = importlib.util.spec_from_file_location(name, os.path.abspath(file))
    if spec is None or spec.loader is None:
        raise ProgramError(f"{file} is no Python program")
    spec.loader = UncachedLoader(name, os.path.abspath(file))
    module = importlib.util.module_from_spec(spec)
    if shared:
        _threads.publish(name, module)
    else:
        sys.modules[name] = module
    _loading.append(file)
    try:
        with _noticed_interrupts():
            spec.loader.exec_module(module)
    except BaseException:
        if not shared:
            del sys.modules[name]
        raise
    finally:
        _loading.pop()
    return module


@contextmanager
def _noticed_interrupts() -> Iterator[None]:
    """Let no error come of a Ctrl-C but ``KeyboardInterrupt``.

    It may come in the middle of an import, and code that expects none, such as extension modules,
    makes another error of it.
    """
    came = False

    def notice(number: int, frame: FrameType | None) -> None:
        nonlocal came
        came = True
        signal.default_int_handler(number, frame)

    is_ours = threading.current_thread() is threading.main_thread()
    if not is_ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, notice)
    try:
        yield
    except Exception:
        if came:
            raise KeyboardInterrupt from None
        raise
    finally:
        if signal.getsignal(signal.SIGINT) is notice:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _named(module: ModuleType, file: str, name: str) -> Any:
    found: Any = module
    for part in name.split("."):
        if not hasattr(found, part):
            raise ProgramError(
                f"{file} has no {name}",
                hint=f"it has: {', '.join(_programs(module)) or 'none'}",
                code=_findings.NO_REACTOR,
            )
        found = getattr(found, part)
    return found


def _programs(module: ModuleType) -> dict[str, type[Reactor]]:
    """Return the reactor classes that a module defines itself."""
    return {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, Reactor)
        and value.__module__ == module.__name__
    }


def _only(module: ModuleType, file: str) -> Any:
    """Return what a file defines as its program, if that is clear."""
    programs = _programs(module)
    federations = {name: it for name, it in programs.items() if issubclass(it, Federation)}
    # A main reactor has no ports.
    whole = {name: it for name, it in programs.items() if not _has_ports(it)}
    for candidates in (federations, programs, whole):
        called = {
            name: it
            for name, it in candidates.items()
            if _module_names.is_called(name, module.__name__)
        }
        for some in (candidates, called):
            if len(some) == 1:
                return next(iter(some.values()))
    if not programs:
        raise _none(module, file)
    names = list(whole or programs)
    raise ProgramError(
        f"{file} defines several reactors: {', '.join(names)}",
        # The last ones are made of those before.
        hint=f"name the program: {' or '.join(f'{file}:{name}' for name in names[-3:])}",
        code=_findings.SEVERAL_MAINS,
    )


def _none(module: ModuleType, file: str) -> ProgramError:
    """Say that a file defines no reactor, and from where it imports one."""
    message = f"{file} defines no reactor"
    hint = "a program is a class that extends hprm.Reactor or hprm.Federation"
    imported = {
        name: value._hprm_place_.path
        for name, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, Reactor)
        and not value.__module__.startswith("hprm.")
        and not _has_ports(value)
    }
    wholes = [name for name in imported if _module_names.is_called(name, module.__name__)]
    names = wholes or list(imported)
    if len(names) == 1:
        name = names[0]
        path = _places.shown(imported[name])
        message += f": {name} comes from {path}"
        hint = f"run that: {path}; or name it: {file}:{name}"
    elif names:
        hint = f"name what it imports: {' or '.join(f'{file}:{name}' for name in names[-3:])}"
    return ProgramError(message, hint=hint, code=_findings.NO_MAIN)


def _has_ports(cls: type[Reactor]) -> bool:
    return any(part.kind in ("input", "output") for part in cls._hprm_parts_.values())


def _made(found: Any, file: str, stated: dict[str, str]) -> Reactor:
    """Make the main reactor, with arguments that the user or the calling script states."""
    if isinstance(found, Reactor):
        if stated:
            raise ProgramError(
                f"{file} makes the program itself, so it takes no parameters: {', '.join(stated)}"
            )
        return found
    if not callable(found):
        raise ProgramError(f"{file}: {found!r} is no reactor, and makes none")
    arguments: tuple[Any, ...] = ()
    keywords: dict[str, Any] = {}
    call = _call()
    if call is not None:
        arguments, keywords = _Call(io.BytesIO(call), found).load()
    keywords |= _parameters.read(found, stated)
    if call is None:
        _parameters.refuse_missing(found, keywords)
    made = found(*arguments, **keywords)
    if not isinstance(made, Reactor):
        raise ProgramError(f"{file}: {found!r} gives a {type(made).__name__}, not a reactor")
    return made


@cache
def _call() -> bytes | None:
    """Return the pickled arguments of the constructor, if a script has started this process.

    Programs that this process starts in turn do not get them.
    """
    path = os.environ.pop(CALL, None)
    if path is None:
        return None
    with open(path, "rb") as file:
        return file.read()


class _Call(pickle.Unpickler):
    """Reads the arguments of a constructor, which a script has written.

    What is of the script itself is of the module that has been loaded from it here.
    """

    def __init__(self, file: BinaryIO, found: Any) -> None:
        super().__init__(file)
        self._module = found.__module__

    def find_class(self, module: str, name: str) -> Any:
        """Find a class by its name."""
        return super().find_class(self._module if module == "__main__" else module, name)
