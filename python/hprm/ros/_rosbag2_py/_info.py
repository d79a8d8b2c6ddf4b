"""What bags have in them, as ``rosbag2_py`` tells it."""

from __future__ import annotations

from hprm.ros._rosbag2_py._reader import SequentialReader
from hprm.ros._rosbag2_py._storage import BagMetadata, StorageOptions


class Info:
    """What bags have in them."""

    def read_metadata(self, uri: str, storage_id: str = "") -> BagMetadata:
        """Return what a bag has in it."""
        reader = SequentialReader()
        reader.open(StorageOptions(uri, storage_id))
        try:
            return reader.get_metadata()
        finally:
            reader.close()
