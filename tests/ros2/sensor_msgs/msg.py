"""The message that the benchmarks send."""

from __future__ import annotations

import array


class Image:
    """Its data is an array of bytes, whatever bytes are assigned."""

    def __init__(self) -> None:
        """Is empty."""
        self._data = array.array("B")

    @property
    def data(self) -> array.array[int]:
        """The bytes."""
        return self._data

    @data.setter
    def data(self, value: bytes | array.array[int]) -> None:
        assert isinstance(value, bytes) or (
            isinstance(value, array.array) and value.typecode == "B"
        )
        self._data = array.array("B", value)
