"""Ways to serialize; each class is one. What both ends have to do is timed, each for itself.

Where a method keeps large buffers out of band, its bytes are the description alone: placing the
buffers is another workload.
"""

from __future__ import annotations

import pickle
from typing import Any

from session import Session


class _Codec:
    def __init__(self, session: Session) -> None:
        self.session = session

    def takes(self, value: Any) -> bool:
        """Whether the method has a way for such a value."""
        return True

    def serialize(self, value: Any) -> Any:
        """Must be said by each method."""
        raise NotImplementedError

    def arrived(self, value: Any) -> Any:
        """What `deserialize` takes: what `serialize` returns, unless a method says otherwise."""
        return self.serialize(value)


class pickle_in_band(_Codec):  # noqa: N801
    """`pickle` with protocol 5, everything in one byte string."""

    def serialize(self, value: Any) -> bytes:
        """One byte string."""
        return pickle.dumps(value, protocol=5)

    def deserialize(self, encoded: bytes) -> Any:
        """The value."""
        return pickle.loads(encoded)


class pickle_out_of_band(_Codec):  # noqa: N801
    """`pickle` with protocol 5 and a list of buffers that are not copied."""

    def serialize(self, value: Any) -> tuple[bytes, list[pickle.PickleBuffer]]:
        """A byte string and the buffers."""
        buffers: list[pickle.PickleBuffer] = []
        return pickle.dumps(value, protocol=5, buffer_callback=buffers.append), buffers

    def deserialize(self, encoded: tuple[bytes, list[pickle.PickleBuffer]]) -> Any:
        """The value over these buffers."""
        return pickle.loads(encoded[0], buffers=encoded[1])


class hprm(_Codec):
    """The description that a federate makes of a value, and the value over buffers that arrived."""

    def __init__(self, session: Session) -> None:
        """Needs the package's extension module."""
        super().__init__(session)
        from hprm._hprm import ArrivedValue, describe_value

        self._describe, self._arrive = describe_value, ArrivedValue

    def serialize(self, value: Any) -> bytes:
        """A byte string; the buffers stay where they are."""
        return self._describe(value)

    def arrived(self, value: Any) -> Any:
        """What the other end has of it."""
        return self._arrive(value)

    def deserialize(self, encoded: Any) -> Any:
        """The value."""
        return encoded.decode()


class cyclonedds(_Codec):
    """The CDR of Cyclone DDS' binding, for an array of bytes."""

    def __init__(self, session: Session) -> None:
        """Makes a type of the array's length."""
        super().__init__(session)
        from dataclasses import make_dataclass

        from cyclonedds.idl import IdlStruct
        from cyclonedds.idl.types import array, uint8

        length = session.largest
        fields = [("data", array[uint8, length])]
        self._type: Any = make_dataclass("Message", fields, bases=(IdlStruct,))

    def takes(self, value: Any) -> bool:
        """Arrays only."""
        return not isinstance(value, dict)

    def serialize(self, value: Any) -> bytes:
        """One byte string."""
        return self._type(data=memoryview(value).cast("B")).serialize()

    def deserialize(self, encoded: bytes) -> Any:
        """The bytes of the array."""
        import numpy as np

        return np.frombuffer(self._type.deserialize(encoded).data, np.float64)
