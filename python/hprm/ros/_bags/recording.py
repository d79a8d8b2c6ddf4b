"""Writing a bag while messages come: a bounded queue, and a thread that writes what is in it."""

from __future__ import annotations

import array
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy
from rosbags.interfaces import Connection, Qos

from hprm.ros._bags.definitions import definition_of
from hprm.ros._bags.errors import BagError
from hprm.ros._bags.writing import Draft, look
from hprm.ros._messages import type_name
from hprm.ros._messages.cdr import SERIALIZER

# What the queue holds at most, unless the caller says otherwise.
_MESSAGES = 1_000
_BYTES = 256 * 2**20

Mode = Literal["drop", "wait"]


@dataclass(frozen=True)
class Recorded:
    """How many messages of each topic are in a bag, and how many the recorder has lost."""

    written: dict[str, int]
    lost: dict[str, int]


def _warn(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


class BagWriter:
    """A bag that a thread of its own writes.

    Where the disk does not keep up, it loses messages and counts them for each topic (``drop``), or
    lets the caller of ``put`` wait (``wait``). It is a context manager: an exception leaves no bag.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        storage: str = "mcap",
        mode: Mode = "drop",
        capacity: int = _MESSAGES,
        capacity_bytes: int = _BYTES,
        warn: Callable[[str], None] = _warn,
    ) -> None:
        """Begin a bag, whose queue holds so many messages and bytes.

        ``warn`` is told when messages of a topic are lost for the first time.
        """
        if mode not in ("drop", "wait"):
            raise ValueError(f"mode is 'drop' or 'wait', not {mode!r}")
        if capacity < 1:
            raise ValueError("the queue has room for one message at least")
        self.path = Path(path)
        look(self.path, storage)
        self._storage, self._mode, self._warn = storage, mode, warn
        self._capacity, self._capacity_bytes = capacity, capacity_bytes
        self._changed = threading.Condition()
        self._queue: deque[tuple[str, type, int, Any, int, Sequence[Qos]]] = deque()
        self._held = 0
        self._is_ending = False
        self._is_aborted = False
        self._failure: BaseException | None = None
        self._written: Counter[str] = Counter()
        self._lost: Counter[str] = Counter()
        self._thread = threading.Thread(target=self._run, name=f"bag {self.path.name}", daemon=True)
        self._thread.start()

    @property
    def lost(self) -> dict[str, int]:
        """How many messages have been lost until now, by topic."""
        with self._changed:
            return dict(self._lost)

    def put(self, topic: str, kind: type, time: int, message: Any) -> bool:
        """Have a message, or its bytes, written with its time in nanoseconds since 1970.

        The message must not be changed after that. Return whether it will be written; False if it
        is lost. Raises ``BagError`` once the bag cannot be written.
        """
        if type(message) not in (kind, bytes):
            raise TypeError(f"the messages of {topic} are {kind.__name__}, not {type(message)}")
        return self._put(topic, kind, time, message)

    def add(self, topic: str, kind: type, offers: Sequence[Qos] = ()) -> None:
        """Have a topic in the bag, even if none of its messages comes.

        If none has come before, the bag says which quality of service its publishers offer.
        """
        self._put(topic, kind, 0, None, offers)

    def _put(
        self, topic: str, kind: type, time: int, message: Any, offers: Sequence[Qos] = ()
    ) -> bool:
        size = _size(message)
        with self._changed:
            if self._mode == "wait":
                self._changed.wait_for(lambda: self._has_room(size) or self._has_ended())
            self._raise_failure()
            if self._is_ending:
                raise BagError(f"{self.path} is closed")
            if self._has_room(size):
                self._queue.append((topic, kind, time, message, size, offers))
                self._held += size
                self._changed.notify_all()
                return True
            self._lost[topic] += 1
            is_first = self._lost[topic] == 1
        if is_first:
            self._warn(
                f"the bag {self.path} loses messages of {topic}: they come faster than they are "
                "written"
            )
        return False

    def close(self) -> Recorded:
        """Write what is in the queue, and finish the bag.

        Raises ``BagError`` if it could not be written; then nothing is left of it.
        """
        with self._changed:
            self._is_ending = True
            self._changed.notify_all()
        self._thread.join()
        with self._changed:
            self._raise_failure()
            return Recorded(dict(self._written), dict(self._lost))

    def abort(self) -> None:
        """End without a bag."""
        with self._changed:
            self._is_ending = self._is_aborted = True
            self._changed.notify_all()
        self._thread.join()

    def __enter__(self) -> BagWriter:
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Finish the bag; after an exception, leave none."""
        if kind is None:
            self.close()
        else:
            self.abort()

    def _has_room(self, size: int) -> bool:
        # A message that is larger than the queue passes alone.
        fits = self._held + size <= self._capacity_bytes or not self._queue
        return fits and len(self._queue) < self._capacity

    def _has_ended(self) -> bool:
        return self._is_ending or self._failure is not None

    def _raise_failure(self) -> None:
        if isinstance(self._failure, BagError):
            raise BagError(str(self._failure)) from self._failure
        if self._failure is not None:
            raise BagError(f"{self.path} cannot be written: {self._failure}") from self._failure

    def _run(self) -> None:
        """Write until the end, in the thread."""
        draft = None
        try:
            draft = Draft(self.path, self._storage)
            self._write_all(draft)
            if self._is_aborted:
                draft.abort()
            else:
                draft.commit(dict(self._lost))
        # Whatever it is, the next call of `put` or `close` tells it.
        except BaseException as error:
            if draft is not None:
                draft.abort()
            with self._changed:
                self._failure = error
                self._queue.clear()
                self._held = 0
                self._changed.notify_all()

    def _write_all(self, draft: Draft) -> None:
        connections: dict[tuple[str, type], Connection] = {}
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._is_ending)
                if self._is_aborted or not self._queue:
                    return
                topic, kind, time, message, size, offers = self._queue[0]
            key = topic, kind
            if key not in connections:
                definition = definition_of(kind)
                connections[key] = draft.add(topic, type_name(kind), definition, list(offers))
            if message is not None:
                is_data = isinstance(message, bytes)
                data = message if is_data else SERIALIZER.serialize(message)
                draft.write(connections[key], time, data)
            with self._changed:
                # What is being written counts until it is.
                self._queue.popleft()
                self._held -= size
                self._written[topic] += message is not None
                self._changed.notify_all()


def _size(value: Any) -> int:
    """Return about how many bytes a message has."""
    if isinstance(value, numpy.ndarray):
        return int(value.nbytes)
    if isinstance(value, array.array):
        return len(value) * value.itemsize
    if isinstance(value, str | bytes):
        return len(value)
    if isinstance(value, list | tuple | set):
        return sum(map(_size, value))
    fields = getattr(type(value), "_fields_and_field_types", None)
    return 8 if fields is None else sum(_size(getattr(value, it)) for it in fields)
