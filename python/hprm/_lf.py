"""The module ``lf`` of a program: time, tags and requests to its runtime."""

from __future__ import annotations

import itertools
import os
from types import ModuleType

from hprm import _hprm, _threads
from hprm._hprm import Api, Tag, action_capsule_t, port_capsule
from hprm._source import ProgramSource

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import NoReturn

#: The environment variable with the secret of a federate's federation.
FEDERATION_ID = "HPRM_FEDERATION_ID"


#: What the module has, and its class `time`.
NAMES = frozenset(
    (
        *("Tag", "port_capsule", "action_capsule_t", "time", "tag", "tag_compare"),
        *("tag_start_effective", "request_stop", "stop", "get_federation_id", "source_directory"),
        *("package_directory", "get_fed_maxwait", "set_fed_maxwait", "start", "check_deadline"),
        *("update_deadline", "register_user_trace_event", "tracepoint_user_event"),
        *("tracepoint_user_value", "store_stats"),
    )
)
TIMES = frozenset(("logical", "logical_elapsed", "physical", "physical_elapsed", "start"))


def make_module(api: Api, source: ProgramSource) -> ModuleType:
    """Make the module of a program, importable by the name that Lingua Franca gives it."""
    lf = ModuleType(f"LinguaFranca{source.name}", make_module.__doc__)
    folder = os.path.dirname(os.path.abspath(source.path))
    # Of a program that is not traced, no event has a handle.
    handles = itertools.count(1) if source.tracing else itertools.repeat(0)
    vars(lf).update(
        Tag=Tag,
        port_capsule=port_capsule,
        action_capsule_t=action_capsule_t,
        time=_time(api),
        tag=api.tag,
        tag_compare=tag_compare,
        tag_start_effective=api.tag_start_effective,
        request_stop=api.request_stop,
        stop=api.stop,
        get_federation_id=lambda: _federation_id(api),
        source_directory=lambda: folder,
        package_directory=lambda: _package(folder),
        get_fed_maxwait=api.maxwait,
        set_fed_maxwait=api.set_maxwait,
        start=_start,
        check_deadline=lambda reactor, invoke=True: api.check_deadline(invoke),
        update_deadline=lambda reactor, deadline: api.update_deadline(deadline),
        register_user_trace_event=lambda reactor, name: api.tracepoint_name(name) or next(handles),
        tracepoint_user_event=lambda reactor, handle: api.tracepoint(handle),
        tracepoint_user_value=lambda reactor, handle, value: api.tracepoint(handle, value),
        store_stats=api.store_stats,
    )
    _threads.publish(lf.__name__, lf)
    return lf


def tag_compare(left: Tag, right: Tag) -> int:
    """Return -1, 0 or 1, as the first tag is before, at or after the second."""
    return (left > right) - (left < right)


def _time(api: Api) -> type:
    """Make the class ``lf.time``."""
    names = {name: staticmethod(getattr(api, name)) for name in TIMES}
    return type("time", (), {"__doc__": "Times in nanoseconds.", **names})


def _package(folder: str) -> str:
    """Find what contains the nearest folder named ``src``, or else the folder itself."""
    here = folder
    while os.path.basename(here) != "src":
        above = os.path.dirname(here)
        if above == here:
            return folder
        here = above
    return os.path.dirname(here)


def _federation_id(api: Api) -> str:
    """Get the secret that lets another process join this federation."""
    if api.federate() is None:
        raise RuntimeError("only a federate has a federation id, and this program runs as a whole")
    if _hprm.current_federate() is not None:
        raise RuntimeError("federates that are threads form a federation that no process can join")
    return os.environ[FEDERATION_ID]


def _start(argv: object = None) -> NoReturn:
    raise RuntimeError("the program has been started already, by the command that runs it")
