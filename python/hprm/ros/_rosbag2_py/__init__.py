"""Bags under the names of ``rosbag2_py``: what programs read and write them with one by one.

A bag that is written has its name when the writer is closed, is no longer referred to, or when the
program ends.
"""

from hprm.ros._rosbag2_py.options import (
    BagMetadata,
    ConverterOptions,
    StorageFilter,
    StorageOptions,
    TopicInformation,
    TopicMetadata,
)
from hprm.ros._rosbag2_py.reader import Info, SequentialReader
from hprm.ros._rosbag2_py.writer import SequentialWriter

__all__ = [
    "BagMetadata",
    "ConverterOptions",
    "Info",
    "SequentialReader",
    "SequentialWriter",
    "StorageFilter",
    "StorageOptions",
    "TopicInformation",
    "TopicMetadata",
    "get_registered_readers",
    "get_registered_serializers",
    "get_registered_writers",
]


def get_registered_readers() -> set[str]:
    """Return the formats of bags that are read."""
    return {"mcap", "sqlite3"}


def get_registered_writers() -> set[str]:
    """Return the formats of bags that are written."""
    return {"mcap", "sqlite3"}


def get_registered_serializers() -> set[str]:
    """Return the formats of messages."""
    return {"cdr"}
