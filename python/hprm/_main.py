"""The main module of a program: what bodies know without an import, and what preambles add.

A process that ``multiprocessing`` starts imports its parent's main module again. It is told a name
and nothing else, so the name carries the path of the program, for ``hprm._spawned`` to read.
"""

import copy
import importlib.machinery
import os
import sys
import threading
from types import ModuleType
from typing import Any

import hprm
from hprm import _compile, _protobuf, _staging, _threads
from hprm._source import ProgramSource

_PREFIX = "hprm._spawned.program_"

# Of the package, what bodies of `.lf` files know without an import.
_OF_PACKAGE = (
    *("BILLION", "DAY", "DAYS", "FOREVER", "HOUR", "HOURS", "MINUTE"),
    *("MINUTES", "MSEC", "MSECS", "NEVER", "NSEC", "NSECS", "SEC"),
    *("SECS", "USEC", "USECS", "WEEK", "WEEKS", "Make", "ReactorBase"),
    *("Tag", "action_capsule_t", "empty", "empty_like", "instant_t", "interval_t", "port_capsule"),
)

#: What bodies know without an import, beside built-in names.
NAMES = frozenset(_OF_PACKAGE) | {
    *("copy", "get_fed_maxwait", "lf", "os", "request_stop", "set_fed_maxwait", "start", "sys"),
}

# Federates that share a process load at the same time.
_EXTENDING = threading.Lock()


def make_module(source: ProgramSource) -> ModuleType:
    """Make the module in which bodies run."""
    module = ModuleType("__main__")
    module.__spec__ = spec(source.path)
    vars(module)["__hprm_main__"] = sys.modules.get("__main__")
    # Classes of the program are pickled by the name of their module, which is the same in all
    # federates. Processes that multiprocessing starts know it by a name of theirs.
    for name in ("__main__", "__mp_main__", f"__lf_{source.name}__"):
        _threads.publish(name, module)
    return module


def prepare(source: ProgramSource, lf: ModuleType, names: dict[str, Any]) -> None:
    """Put into ``names`` what bodies know without an import, and run the files' preambles there."""
    _compile.register(source.files)
    path = os.path.abspath(source.path)
    stage = _staging.folder(source)
    names["__file__"] = path if stage is None else os.path.join(stage, os.path.basename(path))
    _extend_path(source, stage)
    names |= {name: getattr(hprm, name) for name in _OF_PACKAGE}
    names |= {name: getattr(lf, name) for name in ("get_fed_maxwait", "request_stop", "start")}
    names |= {"copy": copy, "lf": lf, "os": os, "set_fed_maxwait": lf.set_fed_maxwait, "sys": sys}
    names |= _protobuf.messages(source.protobufs)
    for preamble in source.preambles:
        exec(_compile.statements(preamble), names)


def spec(path: str) -> importlib.machinery.ModuleSpec:
    """Describe the main module of the program at ``path``, for processes that are yet to come."""
    path = os.path.abspath(path)
    return importlib.machinery.ModuleSpec(_PREFIX + os.fsencode(path).hex(), None, origin=path)


def path_in(name: str) -> str | None:
    """Return the path that the name of a main module carries, if it is one."""
    if not name.startswith(_PREFIX):
        return None
    return os.fsdecode(bytes.fromhex(name.removeprefix(_PREFIX)))


def _extend_path(source: ProgramSource, stage: str | None) -> None:
    """Let the program import what lies beside it, and what it says it uses."""
    folders = [] if stage is None else [stage]
    folders.append(os.path.dirname(os.path.abspath(source.path)))
    for name, stated_in in source.uses:
        path = os.path.join(os.path.dirname(os.path.abspath(stated_in)), name)
        folders.append(path if os.path.isdir(path) else os.path.dirname(path))
    with _EXTENDING:
        if stage is not None:
            _staging.import_from(stage)
        for folder in reversed(folders):
            if folder in sys.path:
                sys.path.remove(folder)
            sys.path.insert(0, folder)
