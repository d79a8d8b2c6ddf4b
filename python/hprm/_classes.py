"""The classes that bodies of reactions know besides ports and actions."""

from __future__ import annotations

from types import ModuleType

from hprm._source import ClassSource

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any, ClassVar


class Make:
    """An object with whatever attributes are set; a missing one comes into being as another.

    >>> made = Make()
    >>> made.box.width = 3
    >>> made.box.width
    3
    """

    def __getattr__(self, name: str) -> Any:
        """Make the missing attribute."""
        if name.startswith("__"):
            # Protocols ask for these to find out what an object can do.
            raise AttributeError(name)
        made = Make()
        setattr(self, name, made)
        return made


class ReactorBase:
    """The base of all reactors: what ``self`` can do in every body."""

    _lf: ClassVar[Any]
    #: The declaration of the reactor, for messages.
    _source: ClassVar[ClassSource]

    @property
    def bank_index(self) -> int:
        """The position in the bank; zero outside of banks."""
        index: int = self.__dict__.get("_bank_index", 0)
        return index

    def lf_module(self) -> ModuleType:
        """Return the module ``lf``."""
        module: ModuleType = self._lf
        return module

    def check_deadline(self, invoke_deadline_handler: bool = True) -> bool:
        """Tell whether the deadline of the running reaction has passed; if so, run its handler."""
        return bool(self._lf.check_deadline(self, invoke_deadline_handler))

    def update_deadline(self, deadline: float) -> None:
        """Change the deadline of the running reaction, in nanoseconds, from now on."""
        self._lf.update_deadline(self, deadline)

    def register_user_trace_event(self, description: str) -> int:
        """Name an event for traces. Return its handle; zero if the program is not traced."""
        return int(self._lf.register_user_trace_event(self, description))

    def tracepoint_user_event(self, handle: int) -> None:
        """Trace an event."""
        self._lf.tracepoint_user_event(self, handle)

    def tracepoint_user_value(self, handle: int, value: int) -> None:
        """Trace an event with a value."""
        self._lf.tracepoint_user_value(self, handle, value)
