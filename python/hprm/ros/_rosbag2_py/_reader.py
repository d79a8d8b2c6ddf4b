"""Reading a bag one message after the other, as ``rosbag2_py`` does."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone

from hprm.ros._bags.errors import BagError
from hprm.ros._bags.information import BagInfo
from hprm.ros._bags.reading import BagReader
from hprm.ros._rosbag2_py._storage import (
    BagMetadata,
    ConverterOptions,
    StorageFilter,
    StorageOptions,
    TopicInformation,
    TopicMetadata,
)

_Message = tuple[str, bytes, int]


class SequentialReader:
    """A bag whose messages are read in the order of their times. Errors are ``RuntimeError``."""

    def __init__(self) -> None:
        """Read nothing yet."""
        self._bag: BagReader | None = None
        self._filter = StorageFilter()
        self._from = 0
        self._messages: Iterator[_Message] = iter(())
        self._next: _Message | None = None

    def open(
        self, storage_options: StorageOptions, converter_options: ConverterOptions | None = None
    ) -> None:
        """Open a bag."""
        storage_options.refuse_others()
        (converter_options or ConverterOptions()).refuse_others()
        self.open_uri(storage_options.uri)
        assert self._bag is not None
        wanted, storage = storage_options.storage_id, self._bag.info.storage
        if wanted not in ("", storage):
            self.close()
            raise RuntimeError(f"{storage_options.uri} has the format {storage}, not {wanted}")

    def open_uri(self, uri: str) -> None:
        """Open a bag, whatever its format."""
        self.close()
        try:
            self._bag = BagReader(uri)
        except BagError as error:
            raise RuntimeError(str(error)) from error
        # Programs of ROS do not close it.
        weakref.finalize(self, self._bag.close)
        self._begin()

    def close(self) -> None:
        """Close the bag."""
        if self._bag is not None:
            self._bag.close()
        self._bag, self._next, self._from = None, None, 0

    def has_next(self) -> bool:
        """Tell whether there is another message."""
        self._opened()
        return self._next is not None

    def read_next(self) -> _Message:
        """Return the topic, the bytes and the time in nanoseconds of the next message."""
        self._opened()
        if self._next is None:
            raise RuntimeError("there is no other message in the bag")
        found = self._next
        # Where other topics are read from, after a change of the filter.
        self._from = found[2] + 1
        self._advance()
        return found

    def seek(self, timestamp: int) -> None:
        """Go to the first message at or after a time in nanoseconds."""
        self._opened()
        self._from = timestamp
        self._begin()

    def set_filter(self, storage_filter: StorageFilter) -> None:
        """Read some topics only, from here on."""
        self._opened()
        self._filter = storage_filter
        self._begin()

    def reset_filter(self) -> None:
        """Read all topics from here on."""
        self.set_filter(StorageFilter())

    def get_all_topics_and_types(self) -> list[TopicMetadata]:
        """Return the topics of the bag."""
        return [it.topic_metadata for it in self.get_metadata().topics_with_message_count]

    def get_metadata(self) -> BagMetadata:
        """Return what the bag has in it."""
        return _metadata(self._opened().info)

    def _opened(self) -> BagReader:
        if self._bag is None:
            raise RuntimeError("the bag is not open; call open first")
        return self._bag

    def _begin(self) -> None:
        bag = self._opened()
        wanted = [it for it in bag.connections() if self._filter.passes(it.topic)]
        offset = 0 if bag.info.start is None else max(self._from - bag.info.start, 0)
        self._messages = (
            (connection.topic, bytes(data), time)
            for connection, time, data in bag.raw(wanted, offset)
        )
        self._advance()

    def _advance(self) -> None:
        try:
            self._next = next(self._messages, None)
        except BagError as error:
            raise RuntimeError(str(error)) from error


def get_registered_readers() -> set[str]:
    """Return the formats of bags that are read."""
    return {"mcap", "sqlite3"}


def _metadata(info: BagInfo) -> BagMetadata:
    epoch = datetime(1970, 1, 1, tzinfo=timezone.utc)
    topics = [
        TopicInformation(TopicMetadata(at, it.name, it.type, it.serialization_format), it.count)
        for at, it in enumerate(info.topics)
    ]
    return BagMetadata(
        info.storage,
        info.size,
        info.files,
        epoch + timedelta(microseconds=(info.start or 0) // 1000),
        timedelta(microseconds=info.duration // 1000),
        info.count,
        topics,
    )
