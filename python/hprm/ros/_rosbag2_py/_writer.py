"""Writing a bag one message after the other, as ``rosbag2_py`` does."""

from __future__ import annotations

import weakref
from typing import Any

from hprm.ros._bags.errors import BagError
from hprm.ros._bags.recording import BagWriter
from hprm.ros._messages import DefinitionError, class_of
from hprm.ros._rosbag2_py._storage import (
    ConverterOptions,
    StorageOptions,
    TopicMetadata,
    get_default_storage_id,
)


class SequentialWriter:
    """A bag that a thread of its own writes, which loses nothing. Errors are ``RuntimeError``."""

    def __init__(self) -> None:
        """Write nothing yet."""
        self._bag: BagWriter | None = None
        self._kinds: dict[str, Any] = {}
        self._finish: weakref.finalize[..., SequentialWriter] | None = None

    def open(
        self, storage_options: StorageOptions, converter_options: ConverterOptions | None = None
    ) -> None:
        """Begin a bag, in MCAP if nothing else is said."""
        storage_options.refuse_others()
        (converter_options or ConverterOptions()).refuse_others()
        self.close()
        try:
            storage = storage_options.storage_id or get_default_storage_id()
            self._bag = BagWriter(storage_options.uri, storage=storage, mode="wait")
        except BagError as error:
            raise RuntimeError(str(error)) from error
        # Programs of ROS do not close it.
        self._finish = weakref.finalize(self, self._bag.close)

    def create_topic(self, topic: TopicMetadata) -> None:
        """Add a topic."""
        bag = self._opened()
        if topic.serialization_format not in ("", "cdr"):
            raise RuntimeError(f"messages are in cdr, not in {topic.serialization_format!r}")
        try:
            kind = class_of(topic.type)
            bag.add(topic.name, kind)
        except (LookupError, DefinitionError, BagError) as error:
            raise RuntimeError(f"{topic.name} of type {topic.type}: {error.args[0]}") from None
        self._kinds[topic.name] = kind

    def write(self, topic_name: str, message: bytes, time_stamp: int) -> None:
        """Write the bytes of a message, with its time in nanoseconds since 1970."""
        bag = self._opened()
        kind = self._kinds.get(topic_name)
        if kind is None:
            raise RuntimeError(f"the topic {topic_name} is not in the bag; call create_topic first")
        try:
            bag.put(topic_name, kind, time_stamp, bytes(message))
        except BagError as error:
            raise RuntimeError(str(error)) from error

    def close(self) -> None:
        """Finish the bag."""
        finish, self._finish, self._bag = self._finish, None, None
        self._kinds.clear()
        if finish is not None:
            try:
                finish()
            except BagError as error:
                raise RuntimeError(str(error)) from error

    def _opened(self) -> BagWriter:
        if self._bag is None:
            raise RuntimeError("the bag is not open; call open first")
        return self._bag


def get_registered_writers() -> set[str]:
    """Return the formats of bags that are written."""
    return {"mcap", "sqlite3"}


def get_registered_serializers() -> set[str]:
    """Return the formats of messages."""
    return {"cdr"}
