"""Federates that share a process: what a process has once, for each of them.

All find a module of which each has its own version, such as ``__main__``, under one name. What they
print is shown line by line behind their names.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from types import ModuleType

from hprm import _hprm

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

# The longest line that is kept together, in characters.
_LONGEST = 1 << 20

_lock = threading.Lock()


def begin(federates: list[tuple[int, str]]) -> None:
    """Show what federates print behind their names, and know whose a thread is, from now on."""
    names = dict(federates)
    sys.stdout = Lines(sys.stdout, names, _hprm.output_failed)
    sys.stderr = Lines(sys.stderr, names, lambda _: 0)
    start = threading.Thread.start

    def start_for_federate(thread: threading.Thread) -> None:
        federate = _hprm.current_federate()
        if federate is not None:
            _hand_down(thread, federate)
        start(thread)

    threading.Thread.start = start_for_federate  # type: ignore[method-assign, assignment]


def _hand_down(thread: threading.Thread, federate: int) -> None:
    """Let a thread that is about to start belong to a federate, as the one that starts it does."""
    run = thread.run

    def run_for_federate() -> None:
        # The name is that of the class again, and the thread is in no cycle of references.
        del thread.run
        _hprm.belong_to_federate(federate)
        run()

    thread.run = run_for_federate  # type: ignore[method-assign]


def let_bodies_start_threads() -> None:
    """Let the threads that bodies start be like those of the main thread, wherever bodies run.

    Python takes a thread that it has not started for a daemon, and what such a thread starts too.
    """

    def daemon(thread: threading.Thread) -> bool:
        return not (thread.ident == threading.get_ident() and _hprm.runs_bodies())

    threading._DummyThread.daemon = property(daemon)  # type: ignore[assignment]


def publish(name: str, module: ModuleType) -> None:
    """Let ``module`` be imported by a name; if there are federates, by that of this thread."""
    federate = _hprm.current_federate()
    if federate is None:
        sys.modules[name] = module
        return
    with _lock:
        shared = sys.modules.get(name)
        if not isinstance(shared, PerFederate):
            shared = sys.modules[name] = PerFederate(name)
        object.__getattribute__(shared, "_modules")[federate] = module


def versions(module: ModuleType) -> list[ModuleType]:
    """Return what ``module`` is for each federate, or itself if it is one for all."""
    if not isinstance(module, PerFederate):
        return [module]
    with _lock:
        return list(object.__getattribute__(module, "_modules").values())


class PerFederate(ModuleType):
    """A module that is another one for each federate.

    A thread that native code has started belongs to none, and sees that of the first.
    """

    def __init__(self, name: str) -> None:
        """Make one of which no federate has a version."""
        super().__init__(name)
        object.__setattr__(self, "_modules", {})

    def __getattribute__(self, name: str) -> Any:
        """Look in the version of this thread's federate."""
        return getattr(_version(self), name)

    def __setattr__(self, name: str, value: Any) -> None:
        """Set in the version of this thread's federate."""
        setattr(_version(self), name, value)

    def __delattr__(self, name: str) -> None:
        """Delete from the version of this thread's federate."""
        delattr(_version(self), name)

    def __dir__(self) -> list[str]:
        """List the version of this thread's federate."""
        return dir(_version(self))


def _version(shared: PerFederate) -> ModuleType:
    modules: dict[int, ModuleType] = object.__getattribute__(shared, "_modules")
    federate = _hprm.current_federate()
    return modules[federate if federate in modules else min(modules)]


class Lines:
    """A stream to which each federate writes whole lines, behind its name."""

    def __init__(
        self, stream: Any, names: dict[int, str], on_failure: Callable[[int], int]
    ) -> None:
        """Write to ``stream`` in the end; if that fails, tell ``on_failure`` and write no more."""
        self._on_failure = on_failure
        self._failed = False
        self._stream = stream
        self._names = names
        # By federate, and by its thread: it may have several workers.
        self._partial: dict[tuple[int, int], str] = {}

    def __getattr__(self, name: str) -> Any:
        """Be like the stream in everything else."""
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write the lines that ``text`` completes."""
        federate = _hprm.current_federate()
        if federate is None:
            written: int = self._stream.write(text)
            return written
        writer = federate, threading.get_ident()
        with _lock:
            *lines, rest = (self._partial.pop(writer, "") + text).split("\n")
            if len(rest) >= _LONGEST:
                lines.append(rest)
                rest = ""
            if rest:
                self._partial[writer] = rest
            if lines:
                prefix = f"[{self._names[federate]}] "
                self._put("".join(f"{prefix}{line}\n" for line in lines))
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write each of them."""
        for line in lines:
            self.write(line)

    def end(self) -> None:
        """Write the lines that have no end."""
        with _lock:
            for (federate, _), rest in sorted(self._partial.items()):
                self._put(f"[{self._names[federate]}] {rest}\n")
            self._partial.clear()
            self._put("")

    def _put(self, text: str) -> None:
        if self._failed:
            return
        try:
            self._stream.write(text)
            self._stream.flush()
        except OSError as error:
            self._failed = True
            self._on_failure(error.errno or 0)
