"""Reading a bag: what is in it, and its messages in the order of their times."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from hprm.ros._bags.definitions import class_in
from hprm.ros._bags.errors import BagError, reading
from hprm.ros._bags.information import BagInfo, Topic
from hprm.ros._messages.cdr import Serializer

#: Under which name the metadata of a bag say what its recorder has lost.
LOST = "hprm.lost"

# Large arrays of messages go to the store of a federate without a copy before.
_SERIALIZER = Serializer(views=True)

_STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}


class BagReader:
    """A bag that is open: a folder with ``metadata.yaml``, or one file of MCAP or SQLite 3.

    It is a context manager, which closes it.
    """

    def __init__(self, path: str | Path) -> None:
        """Open a bag. Raises ``BagError`` if it cannot be read."""
        self.path = Path(path)
        _look(self.path)
        with reading(self.path):
            self._reader = Reader(self.path)
            self._reader.open()
        try:
            with reading(self.path):
                self.info = self._read_info()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the bag."""
        if self._reader.is_open:
            self._reader.close()

    def __enter__(self) -> BagReader:
        """Return the reader."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the bag."""
        self.close()

    def messages(
        self, topics: Collection[str] | None = None, start_offset: float = 0.0
    ) -> Iterator[tuple[int, str, Any]]:
        """Give the messages of some topics, or of all, with their times in nanoseconds.

        ``start_offset`` is in seconds from the first message of the bag. Sequences of more than
        64 KiB of numbers are NumPy arrays that cannot be written to. Raises ``BagError`` for a
        topic that the bag does not have, a type that is not known here, and damaged bytes.
        """
        connections = self.connections(topics)
        with reading(self.path):
            kinds = {it.id: class_in(self.path, it) for it in connections if it.msgcount}
        for connection, time, data in self.raw(connections, round(start_offset * 1e9)):
            with reading(self.path):
                message = _SERIALIZER.deserialize(data, kinds[connection.id])
            yield time, connection.topic, message

    def connections(self, topics: Collection[str] | None = None) -> list[Connection]:
        """Return the connections of some topics, or of all."""
        known = self._reader.connections
        if topics is None:
            return list(known)
        missing = sorted(set(topics) - {it.topic for it in known})
        if missing:
            there = ", ".join(sorted(it.topic for it in known)) or "none"
            raise BagError(f"{self.path} has no topic {missing[0]}; it has {there}")
        return [it for it in known if it.topic in topics]

    def raw(
        self, connections: list[Connection], start_offset: int = 0
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Give messages as bytes, from so many nanoseconds after the first message of the bag."""
        if not connections or self.info.start is None:
            return
        start = self.info.start + start_offset if start_offset > 0 else None
        with reading(self.path):
            found = self._reader.messages(connections, start=start)
        while True:
            with reading(self.path):
                each = next(found, None)
            if each is None:
                return
            connection, time, data = each
            yield connection, time, data

    def _read_info(self) -> BagInfo:
        reader = self._reader
        count = reader.message_count
        files = [self.path] if self.path.is_file() else _files(self.path)
        custom = reader.storage.metadata.custom or {}
        topics = [
            Topic(it.topic, it.msgtype, it.msgcount, getattr(it.ext, "serialization_format", "cdr"))
            for it in sorted(reader.connections, key=lambda it: it.topic)
        ]
        return BagInfo(
            path=str(self.path),
            files=[it.name for it in files],
            size=sum(it.stat().st_size for it in files),
            storage=_storage(files),
            count=count,
            start=reader.start_time if count else None,
            # What the package calls the end is a nanosecond after the last message.
            duration=max(reader.duration - 1, 0) if count else 0,
            topics=topics,
            lost={str(it): int(lost) for it, lost in json.loads(custom.get(LOST, "{}")).items()},
        )


def _look(path: Path) -> None:
    """Say what is wrong with a path, before a reader of one format does."""
    if not path.exists():
        raise BagError(f"there is no bag {path}")
    if path.is_dir():
        if not (path / "metadata.yaml").exists():
            inside = [it.name for it in sorted(path.iterdir()) if it.suffix in _STORAGES]
            hint = f"; name its file, as {path / inside[0]}" if inside else ""
            raise BagError(f"{path} is no bag: it has no metadata.yaml{hint}")
    elif path.suffix == ".bag":
        raise BagError(f"{path} is a bag of ROS 1; rosbags-convert makes one of ROS 2 of it")
    elif path.suffix not in _STORAGES:
        known = " or ".join(_STORAGES)
        raise BagError(f"{path} is no bag: a bag is a folder, or a file {known}")


def _files(folder: Path) -> list[Path]:
    # What is compressed as a whole ends with .zstd.
    return [it for it in sorted(folder.iterdir()) if _STORAGES.keys() & set(it.suffixes)]


def _storage(files: list[Path]) -> str:
    suffixes = [it for file in files[:1] for it in file.suffixes if it in _STORAGES]
    return _STORAGES[suffixes[0]] if suffixes else "unknown"
