"""Bags under the names of ``rosbag2_py``: what programs read and write them with one by one.

A bag that is written has its name when the writer is closed, is no longer referred to, or when the
program ends. The modules have the names of those in ROS, since programs use these, too.
"""

from hprm.ros._rosbag2_py._info import Info
from hprm.ros._rosbag2_py._reader import SequentialReader, get_registered_readers
from hprm.ros._rosbag2_py._storage import (
    BagMetadata,
    ConverterOptions,
    StorageFilter,
    StorageOptions,
    TopicInformation,
    TopicMetadata,
    get_default_storage_id,
)
from hprm.ros._rosbag2_py._writer import (
    SequentialWriter,
    get_registered_serializers,
    get_registered_writers,
)

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
    "get_default_storage_id",
    "get_registered_readers",
    "get_registered_serializers",
    "get_registered_writers",
]

#: What there is instead of what is left out.
_INSTEAD = {
    "Player": "hprm bag play",
    "PlayOptions": "hprm bag play",
    "Recorder": "hprm bag record",
    "RecordOptions": "hprm bag record",
    "SequentialCompressionReader": "SequentialReader reads compressed bags",
    "SequentialCompressionWriter": "SequentialWriter writes without compression",
    "bag_rewrite": "hprm bag convert",
}


def __getattr__(name: str) -> object:
    """Say what there is instead of what is left out."""
    if name in _INSTEAD:
        raise ImportError(f"rosbag2_py.{name} is not there: {_INSTEAD[name]}")
    raise AttributeError(f"module 'rosbag2_py' has no attribute {name!r}")
