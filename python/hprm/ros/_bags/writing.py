"""A bag that is being written: it has its name only when it is whole."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
from pathlib import Path

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import StoragePlugin, Writer

from hprm.ros._bags.definitions import Definition
from hprm.ros._bags.errors import BagError
from hprm.ros._bags.reading import LOST

#: The formats of bags.
STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}


def look(path: Path, storage: str) -> None:
    """Say what is wrong with the place for a bag, before anything is written."""
    if storage not in STORAGES:
        raise BagError(f"{storage!r} is no format of bags; these are: {', '.join(STORAGES)}")
    if path.exists():
        raise BagError(f"{path} exists already, and is not overwritten")
    if not path.absolute().parent.is_dir():
        raise BagError(f"there is no folder {path.absolute().parent} for the bag {path.name}")


class Draft:
    """A bag in a folder beside its place, which ``commit`` renames. Only one thread may use it."""

    def __init__(self, path: Path, storage: str) -> None:
        """Make the folder."""
        look(path, storage)
        self.path = path
        try:
            above = path.absolute().parent
            self._folder = Path(tempfile.mkdtemp(".part", f".{path.name}.", above))
        except OSError as error:
            raise BagError(f"{path} cannot be written: {error.strerror}") from None
        try:
            self._made = self._folder / path.name
            self._writer = Writer(self._made, version=9, storage_plugin=STORAGES[storage])
            self._writer.open()
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise

    def add(self, topic: str, name: str, definition: Definition, qos: list[Qos]) -> Connection:
        """Add a topic with the name of its type."""
        return self._writer.add_connection(
            topic,
            name,
            msgdef=definition.text,
            rihs01=definition.digest,
            offered_qos_profiles=qos,
        )

    def write(self, connection: Connection, time: int, data: bytes) -> None:
        """Write a message."""
        self._writer.write(connection, time, data)

    def commit(self, lost: dict[str, int] | None = None) -> None:
        """Finish the bag, and give it its name. What goes wrong leaves nothing behind."""
        try:
            if lost:
                self._writer.set_custom_data(LOST, json.dumps(lost))
            self._writer.close()
            look(self.path, "mcap")
            os.rename(self._made, self.path)
            self._folder.rmdir()
        except BaseException as error:
            self.abort()
            if isinstance(error, OSError):
                raise BagError(f"{self.path} cannot be written: {error.strerror}") from None
            raise

    def abort(self) -> None:
        """Leave nothing behind."""
        # Whatever state the writer is in, its files go.
        with contextlib.suppress(Exception):
            self._writer.abort()
        shutil.rmtree(self._folder, ignore_errors=True)
