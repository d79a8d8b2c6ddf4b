"""What stands for Plasma: objects are files of a folder, in the place of the store's socket."""

from __future__ import annotations

import mmap
import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ObjectID:
    """The name of an object."""

    binary: bytes

    @staticmethod
    def from_random() -> ObjectID:
        """A new name."""
        return ObjectID(os.urandom(20))


class _Client:
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def _path(self, name: ObjectID) -> Path:
        return self._folder / name.binary.hex()

    def create(self, name: ObjectID, size: int) -> mmap.mmap:
        with self._path(name).open("xb+") as file:
            file.truncate(size)
            return mmap.mmap(file.fileno(), size)

    def seal(self, name: ObjectID) -> None:
        self._path(name).chmod(0o400)

    def get_buffers(self, names: list[ObjectID]) -> list[memoryview]:
        return [memoryview(self._path(name).read_bytes()) for name in names]


def connect(path: str) -> _Client:
    """A client. The path that programs name is one for all; the objects are those of a test."""
    folder = Path(os.environ["PAPER_LOGS"], "plasma")
    folder.mkdir(exist_ok=True)
    return _Client(folder)
