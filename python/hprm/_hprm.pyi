"""The native half of the package: ports, actions, time, serialization, and the loops."""

import sys
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from types import TracebackType
from typing import (
    Any,
    Final,
    Protocol,
    SupportsIndex,
    TypeAlias,
    TypedDict,
    TypeVar,
    final,
    overload,
    type_check_only,
)

from hprm._errors import Description
from hprm._source import ProgramSource

#: Signals within so many seconds count as one.
ONE_SIGNAL_S: Final[float]

_T = TypeVar("_T")

# Nanoseconds, a text with a unit such as "10 ms", or a timedelta.
_Time: TypeAlias = float | str | timedelta

@final
class Tag:
    """A point in superdense time; ``time`` is in nanoseconds since the Unix epoch."""

    def __new__(cls, time: int, microstep: int = 0) -> Tag: ...
    @property
    def time(self) -> int: ...
    @property
    def microstep(self) -> int: ...
    def __lt__(self, other: Tag, /) -> bool: ...
    def __le__(self, other: Tag, /) -> bool: ...
    def __gt__(self, other: Tag, /) -> bool: ...
    def __ge__(self, other: Tag, /) -> bool: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __getnewargs__(self) -> tuple[int, int]: ...

@final
class port_capsule:
    """A port or one channel of it; a multiport is a sequence of these."""

    @property
    def value(self) -> Any: ...
    def get(self, default: Any = None) -> Any: ...
    @property
    def is_present(self) -> bool: ...
    @property
    def width(self) -> int: ...
    @property
    def intended_tag(self) -> Tag: ...
    @property
    def physical_time_of_arrival(self) -> int: ...
    def set(self, value: Any, /) -> None: ...
    def __len__(self) -> int: ...
    def __bool__(self) -> bool: ...
    def __iter__(self) -> Iterator[port_capsule]: ...
    def __reversed__(self) -> Iterator[port_capsule]: ...
    @overload
    def __getitem__(self, index: SupportsIndex, /) -> port_capsule: ...
    @overload
    def __getitem__(self, index: slice, /) -> tuple[port_capsule, ...]: ...

@final
class action_capsule_t:
    """An action."""

    @property
    def value(self) -> Any: ...
    def get(self, default: Any = None) -> Any: ...
    @property
    def is_present(self) -> bool: ...
    def schedule(self, offset: _Time | None = None, value: Any = None) -> None: ...

@final
class mode_capsule_t:
    """A mode that reactions may enter."""

    def enter(self) -> None: ...
    def set(self) -> None: ...

@final
class Api:
    """The runtime of one program, for its module ``lf``."""

    def tag(self) -> Tag: ...
    def fail(self, thread: str, described: Description) -> bool: ...
    def logical(self) -> int: ...
    def logical_elapsed(self) -> int: ...
    def physical(self) -> int: ...
    def physical_elapsed(self) -> int: ...
    def start(self) -> int: ...
    def request_stop(self) -> None: ...
    def stop(self) -> None: ...
    def tag_start_effective(self) -> Tag: ...
    def check_deadline(self, invoke_deadline_handler: bool = True) -> bool: ...
    def update_deadline(self, deadline: _Time) -> None: ...
    def federate(self) -> str | None: ...
    def maxwait(self) -> int: ...
    def set_maxwait(self, maxwait: _Time) -> None: ...
    def tracepoint_name(self, name: str) -> int: ...
    def tracepoint(self, number: int, value: int | None = None) -> None: ...
    def store_stats(self) -> dict[str, int]: ...

@final
class Interrupt:
    """The handler of the signals that ask a running program for its end."""

    def __call__(self, number: int, frame: object, /) -> None: ...

@type_check_only
class Membership(TypedDict):
    """Where a federate belongs, and what its launcher has asked for. Times are in seconds."""

    rti: str
    federation: str
    connect_timeout: float
    advertise: str | None
    tls: tuple[str, str, str] | None
    launched: bool
    logical_trace: str | None
    share_of: str | None
    properties: list[str]

@type_check_only
class Declared(Protocol):
    """What has declared a program: it knows the instances of its reactors by their full names."""

    @property
    def text(self) -> str:
        """The declaration, as JSON."""

    def types(self, reactor: str) -> dict[str, type | tuple[type, ...]]:
        """Return the types of values that are set at ports and actions of an instance."""

    def bind(self, reactor: str, parts: dict[str, Any], api: Api) -> None:
        """Give an instance its ports, actions and modes."""

    def bodies(
        self, reactor: str, reaction: int
    ) -> tuple[
        object,
        tuple[Callable[..., Any], Callable[..., Any] | None, Callable[..., Any] | None],
    ]:
        """Return an instance; and body, deadline handler and tardy handler of a reaction of it."""

def run_declared(
    declared: Declared,
    properties: list[str] = ...,
    *,
    logical_trace: str | None = None,
    trace: str | None = None,
    failures: list[str] | None = None,
) -> int:
    """Run a declared program in this process, which goes on. Return the exit code.

    What has failed is appended to ``failures``, as JSON.

    What is wrong is told on the standard error, but no warnings: ``check_declared`` returns them.
    Signals that ask for the end stop the program, if this is the main thread and the process does
    not handle them itself.
    """

def check_declared(declared: Declared, properties: list[str] = ...) -> tuple[bool, str, str]:
    """Return whether a declared program can run, its diagnostics as text, and how to read more."""

def nanoseconds(time: _Time, /) -> int:
    """Return the nanoseconds of a whole number of them, a text such as "10 ms", or a timedelta.

    Raises ``TypeError`` if it is nothing of that, and ``ValueError`` if it is negative, or longer
    than 292 years.
    """

def named_program(path: str) -> tuple[str, str | None] | None:
    """Return the file of a program in Python, and what is behind the colon in ``app.py:NAME``."""

def run_program(
    path: str,
    properties: list[str] = ...,
    *,
    logical_trace: str | None = None,
    launch: Callable[[], int] | None = None,
) -> int:
    """Run a program in this process, to its end. Return the exit code.

    If it is a federation, ``launch`` may run it instead.

    It is an ``.lf`` file, or a Python file, perhaps with the name of a reactor: ``app.py:NAME``.
    Target properties, each as ``KEY=VALUE``, override those of the program.
    """

def read_descriptions() -> str:
    """Read what the launcher hands to this process of executables.

    Return the environment variable that has told it.
    """

def run_federate(path: str, federate: str, membership: Membership) -> int:
    """Run one federate of a program to its end. Return the exit code.

    If it was launched, then the launcher reports warnings and failures.
    """

def run_member(
    declared: Declared, federate: str, membership: Membership, failures: list[str]
) -> int:
    """Run one federate of a declared program in this thread, to its end. Return the exit code.

    The process goes on. What has failed is appended to ``failures``, as JSON.
    """

@final
class LocalRti:
    """An RTI, in a thread of this process."""

    @property
    def address(self) -> str: ...
    @property
    def federation(self) -> str: ...
    def request_stop(self) -> None: ...
    def share(self, federate: str) -> tuple[Path, Path] | None: ...
    def merge_shares(self, interrupted: bool, code: int) -> None: ...
    def abort(self) -> None: ...
    def wait(self) -> int: ...

def leave_out_long_reactions() -> None:
    """Report no reactions of programs that begin from now on that take long: others do."""

def start_rti(
    declared: Declared,
    address: str,
    properties: list[str],
    tell: Callable[[str, str, str, float], object],
    *,
    logical_trace: str | None = None,
) -> LocalRti:
    """Start an RTI for a declared federation, which listens at an address.

    ``tell`` is called, in another thread, with what becomes of a federate: ``lost``, ``failed``,
    ``refused``, ``silent`` or ``answers``; then its name, a text, and for how many seconds it was
    silent. What is wrong with the program, the address or the place for a logical trace is the
    message of a ``RuntimeError``. Each federate writes its ``share`` of that trace;
    ``merge_shares`` makes it when all have ended.
    """

def loading_failed(error: BaseException, path: str) -> tuple[int, list[str]]:
    """Return what an exception means that has ended the loading of the program at ``path``.

    That is the exit code that follows, and the reports, as JSON.
    """

def tell_mistake(error: BaseException) -> None:
    """Tell of a mistake in a program, as of one that a run finds."""

def tell_programs() -> None:
    """Have failures told as JSON from now on: one object a line, on the standard error."""

def describe_program(path: str, *, all: bool = False) -> ProgramSource:
    """Describe a program without its instances, to use some of its Python outside of a run.

    Or ``all`` that is in a file, which need not have a main reactor then. What is wrong with it
    is the message of a ``ValueError``.
    """

def output_failed(number: int) -> int:
    """Tell that the standard output cannot be written. Return the exit code that follows."""

def run_in_process(
    path: str,
    properties: list[str] = ...,
    *,
    logical_traces: str | None = None,
    share_of: str | None = None,
    join_timeout: float | None = None,
    hang_timeout: float | None = None,
) -> int:
    """Run a federation in this process, a thread for each federate. Return the exit code.

    Each federate writes its share of the logical trace to a file in the folder ``logical_traces``;
    the user calls the trace ``share_of``.
    If not all have loaded the program within ``join_timeout`` seconds, that is a failure.
    """

def current_federate() -> int | None:
    """Return the number of the federate that this thread belongs to, if it shares a process."""

def belong_to_federate(number: int) -> None:
    """Let this thread belong to a federate, if several share a process."""

def runs_bodies() -> bool:
    """Return whether this thread runs bodies, whichever thread has started it."""

@final
class Stage:
    @property
    def path(self) -> Path | None: ...
    def remove(self) -> None: ...

def stage_files(program: str, files: list[tuple[str, str]]) -> Stage | None: ...
def is_stage_of(stage: str, program: str) -> bool: ...
def die_with_parent(parent: int) -> bool:
    """Have the kernel end this process when its parent ends; return whether that is alive."""

def in_store(function: Callable[..., _T], /, *arguments: Any, **keywords: Any) -> _T:
    """Call a function of NumPy whose array is to be in the federate's store, if there is one."""

def use_store() -> None:
    """From now on, have NumPy's large arrays of this thread be in the federate's store."""

@final
class Memory:
    """Received bytes, which other processes may read too: a buffer that cannot be written."""

    if sys.version_info >= (3, 12):
        def __buffer__(self, flags: int, /) -> memoryview: ...

@final
class Frozen:
    """The memory of an array that threads share: a buffer that can never be written again."""

    if sys.version_info >= (3, 12):
        def __buffer__(self, flags: int, /) -> memoryview: ...

@final
class Turn:
    """A token that threads give to one another."""

    def __new__(cls) -> Turn: ...
    def give(self) -> None:
        """Put the token there, and wake the thread that waits for it; a second one is the same."""

    def take(self, timeout: float | None = None, giving: Turn | None = None) -> bool:
        """Take the token, as soon as it is there, and return whether it was there in time.

        Another one may be given just before, once the interpreter is free for the thread that waits
        for that.
        """

def freeze(array: Any) -> Frozen | None:
    """Make the memory of an array read-only for good, for its views too.

    None, and nothing has changed, if the array does not own its memory.
    """

def shaped(data: Any, format: str, shape: list[int], itemsize: int, fortran: bool) -> memoryview:
    """Return a read-only view of bytes as elements of a format, in a shape.

    Raises ``ValueError`` if there are not exactly as many bytes.
    """

def own(array: Any) -> Any:
    """Return a writeable array for a received one, which is not copied before it is written.

    It is a view of a copy-on-write mapping: the kernel copies a page at the first write to it, and
    no other process sees the write. An array that is small, or not in shared memory, is copied.
    """

def digest(value: Any) -> tuple[str, str, bool]:
    """Return what a trace says of a value: digest, text, and whether something is opaque."""

def encode(value: Any, local: bool = True) -> tuple[bytes, list[bytes]]:
    """Return the head and the parts of a value, as it travels without shared memory."""

def decode(head: bytes, parts: list[bytes], local: bool = True) -> Any:
    """Rebuild the value of a head and its parts."""

def describe_value(value: Any) -> bytes:
    """Return what describes a value, without its large buffers."""

@final
class ArrivedValue:
    """A value as it arrives, which may be decoded any number of times."""

    def __new__(cls, value: Any) -> ArrivedValue: ...
    def decode(self) -> Any:
        """Return the value, over the buffers that arrived."""

def store_round_trip(
    value: Any, readers: int, capacity: int | None = None
) -> tuple[list[Any], dict[str, int]]:
    """Send a value through stores to that many readers; return theirs, and the sender's numbers."""

@final
class Watch:
    """What federates send, from now on: an iterator over messages.

    It ends when all federates that are watched have ended. In a ``with`` statement it is closed
    at the end.
    """

    def __iter__(self) -> Watch: ...
    def __next__(self) -> WatchedMessage: ...
    def __enter__(self) -> Watch: ...
    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
        /,
    ) -> None: ...
    def close(self) -> None:
        """Watch no longer."""

@final
class WatchedMessage:
    """A message that a federate has sent."""

    @property
    def port(self) -> str: ...
    @property
    def tag(self) -> Tag | None: ...
    @property
    def elapsed(self) -> int: ...
    @property
    def sent(self) -> int: ...
    @property
    def size(self) -> int: ...
    @property
    def missed(self) -> int: ...
    @property
    def value(self) -> Any: ...

def watch_ports(
    ports: list[str],
    federation: str | None,
    wait: int,
    pickles: bool,
    *,
    options: bool = False,
) -> Watch:
    """Watch ports of a running federation, or all connections if none is named.

    Wait so many nanoseconds until there is such a federation. Hints tell users of ``options`` of
    the command, or else of arguments.
    """
