"""What to do about an exception that a body raised: a hint behind its traceback.

It is looked for while the reaction still counts as running, so that ports can be asked.
"""

import linecache
import re
import sys
import traceback
from collections.abc import Iterator
from types import FrameType, ModuleType
from typing import Any

from hprm import _names
from hprm._classes import ReactorBase
from hprm._hprm import action_capsule_t, port_capsule
from hprm._ports import Contained
from hprm._source import ClassSource, ReactionSource

_ATTRIBUTE = "__hprm_hint__"

_UNPICKLABLE = (
    "pickle carries no locks, open files or generators, and functions and classes only by their "
    "names in a preamble or a module; send data instead, such as dicts, lists, arrays and "
    "dataclasses (handbook page concepts/serialization)"
)

_READ_ONLY = re.compile(r"read-only|read only|not writeable", re.IGNORECASE)


def explain(error: BaseException) -> None:
    """Find a hint for an exception, and keep it there."""
    if isinstance(error, SystemExit | KeyboardInterrupt):
        return
    try:
        hint = _hint(error)
        if hint is not None:
            setattr(error, _ATTRIBUTE, hint)
    except Exception:
        # Whatever objects of the program answer, the exception itself must be shown.
        return


def explain_unpicklable(error: BaseException, pickler: str) -> None:
    """Keep a hint with an error of pickle, which the file ``pickler`` has called."""
    *_, (last, _) = traceback.walk_tb(error.__traceback__)
    # The pickler is not written in Python, so deeper frames are of the value's own methods.
    if last.f_code.co_filename == pickler:
        setattr(error, _ATTRIBUTE, _UNPICKLABLE)


def add(error: BaseException, text: str) -> None:
    """Keep more with the hint of an error, if it has one."""
    hint = of(error)
    setattr(error, _ATTRIBUTE, text if hint is None else f"{hint}; {text}")


def of(error: BaseException) -> str | None:
    """Return the hint for an exception."""
    if getattr(error, _ATTRIBUTE, None) is None:
        explain(error)
    hint: str | None = getattr(error, _ATTRIBUTE, None)
    return hint


def _hint(error: BaseException) -> str | None:
    if isinstance(error, ModuleNotFoundError) and error.name:
        package = error.name.partition(".")[0]
        return (
            f"the program runs with {sys.executable}; install {package} there, or name "
            "another interpreter with --python"
        )
    if isinstance(error, ImportError) and "failed to map segment" in str(error):
        return "no memory is left to load it: raise ulimit -v, or the limit of the container"
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    lines = [line for _, line in traceback.walk_tb(error.__traceback__)]
    if not frames:
        return None
    frame, line = frames[-1], lines[-1]
    match error:
        case NameError():
            return _name(error, frames)
        case AttributeError(obj=None, name=str()) | TypeError() if "NoneType" in str(error):
            return _absent(frame, line)
        case TypeError() if "port_capsule' object is not callable" in str(error):
            return "`port.set(value)` sets a port, and `port.value` is its value"
        case TypeError() if "port_capsule" in str(error):
            return "a port is not its value, which is `port.value`"
        case AttributeError(name=str()):
            return _attribute(error, frames)
        case ValueError() | TypeError() if _READ_ONLY.search(str(error)):
            return (
                "arrays that are sent or received are shared and read-only; write to a copy, "
                "`value.copy()`, or declare the input as `mutable input`, in Python as "
                "`hprm.Input(mutable=True)`"
            )
    return None


def _name(error: NameError, frames: list[FrameType]) -> str | None:
    name = getattr(error, "name", None)
    if name is None:
        found = re.search(r"'(\w+)'", str(error))
        if found is None:
            return None
        name = found[1]
    cls, reaction = _place(frames)
    if cls is not None:
        hint = _names.of_reactor(name, cls, reaction)
        if hint is None and hasattr(_reactor(frames), name):
            hint = f"the reactor has it: write `self.{name}`"
        if hint is not None:
            return hint
    if _has_classes():
        from hprm import _meant

        meant = _meant.by_name(name, frames)
        if meant is not None:
            return meant
    if isinstance(error, UnboundLocalError):
        return None
    frame = frames[-1]
    return _names.elsewhere(name, [*frame.f_locals, *frame.f_globals])


def _attribute(error: AttributeError, frames: list[FrameType]) -> str | None:
    thing, name = error.obj, error.name
    if name is None:
        return None
    cls, reaction = _place(frames)
    match thing:
        case port_capsule() | action_capsule_t():
            what = "port" if isinstance(thing, port_capsule) else "action"
            if name == "set":
                return "an action is scheduled: `action.schedule(offset, value)`"
            called = _called(thing, frames[-1])
            like = _names.did_you_mean(name, dir(thing))
            return like or f"`{called}` is the {what}, and its value is `{called}.value`"
        case Contained():
            instance = vars(thing)[""].partition("[")[0]
            return None if cls is None else _names.of_reactor(instance, cls, reaction, name)
        case ReactorBase() if cls is not None and cls is type(thing)._source:
            if reaction is not None and name in reaction.arguments:
                return f"write `{name}`: a body gets what its reaction names"
            meant = _names.of_reactor(name, cls, reaction)
            if meant is not None and reaction is not None:
                return f"a body gets what its reaction names, without `self.`: {meant}"
            return meant or _names.did_you_mean(name, dir(thing))
    if _has_classes():
        from hprm import _meant

        meant = _meant.by_attribute(thing, name)
        if meant is not None:
            return meant
    if not isinstance(thing, ModuleType) and sys.version_info >= (3, 12):
        return None
    return _names.did_you_mean(name, dir(thing))


def _has_classes() -> bool:
    """Whether the reactors of the program are classes: what is for these takes time to load."""
    return "hprm._reactor" in sys.modules


def _place(frames: list[FrameType]) -> tuple[ClassSource | None, ReactionSource | None]:
    """Find in which reactor and reaction an exception was raised."""
    for frame in reversed(frames):
        if not frame.f_code.co_filename.endswith(".lf"):
            continue
        reactor = frame.f_locals.get("self")
        if isinstance(reactor, ReactorBase) and hasattr(type(reactor), "_source"):
            source = type(reactor)._source
            name, _, number = frame.f_code.co_name.rpartition("_function_")
            if name in ("reaction", "deadline", "STP") and number.isdigit():
                return source, source.reactions[int(number)]
            return source, None
    return None, None


def _reactor(frames: list[FrameType]) -> object:
    found = [frame.f_locals["self"] for frame in frames if "self" in frame.f_locals]
    return next((self for self in reversed(found) if isinstance(self, ReactorBase)), None)


def _called(thing: object, frame: FrameType) -> str:
    names = [name for name, value in frame.f_locals.items() if value is thing]
    return names[0] if names else repr(thing).partition(" ")[2].rstrip(">")


def _absent(frame: FrameType, line: int) -> str | None:
    """Find a port or an action that the line reads while it is absent."""
    text = linecache.getline(frame.f_code.co_filename, line)
    first = frame.f_code.co_firstlineno
    before = [linecache.getline(frame.f_code.co_filename, n) for n in range(first, line)]
    for name in _read(text):
        if _is_absent(name, frame):
            return _ask(name)
    # A variable that was given the value of a port before.
    for variable in re.findall(r"\b([A-Za-z_]\w*)\b", text):
        if variable in frame.f_locals and frame.f_locals[variable] is None:
            for earlier in reversed(before):
                given = re.match(rf"\s*{variable}\s*=\s*([\w.\[\]]+)\.value\s*(?:#|$|;)", earlier)
                if given is not None and _is_absent(given[1], frame):
                    return _ask(given[1])
    return None


def _read(text: str) -> Iterator[str]:
    yield from re.findall(r"\b([A-Za-z_]\w*(?:\[\w+\])?(?:\.\w+(?:\[\w+\])?)?)\.value\b", text)


def _is_absent(name: str, frame: FrameType) -> bool:
    """Tell whether what a body calls ``name``, perhaps with indices, is absent."""
    thing: Any = None
    for part in re.findall(r"\w+|\[\w+\]", name):
        if thing is None:
            thing = frame.f_locals.get(part)
        elif part.startswith("["):
            index = part[1:-1]
            thing = thing[int(index) if index.isdigit() else frame.f_locals[index]]
        else:
            thing = getattr(thing, part)
        if thing is None:
            return False
    return isinstance(thing, port_capsule | action_capsule_t) and not thing.is_present


def _ask(name: str) -> str:
    return (
        f"`{name}` is absent at this tag, so `{name}.value` is None; ask first: "
        f"`if {name}.is_present:`"
    )
