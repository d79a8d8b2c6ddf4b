"""Ways to serialize; each class is one. What both ends have to do is timed, each for itself.

Where a method keeps large buffers out of band, its bytes are the description alone: placing the
buffers is another workload.
"""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
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
        return np.frombuffer(self._type.deserialize(encoded).data, np.float64)


def _named(value: Any) -> tuple[int, list[tuple[str, np.ndarray]]]:
    """The number of a frame and its arrays with their names, as a schema of messages has them."""
    if isinstance(value, dict):
        return value["frame"], list(value["cameras"].items())
    return 0, [("", value)]


def _value(frame: int, arrays: list[tuple[str, np.ndarray]]) -> Any:
    """What `_named` was given."""
    if len(arrays) == 1 and not arrays[0][0]:
        return arrays[0][1]
    return {"frame": frame, "cameras": dict(arrays)}


class protobuf(_Codec):  # noqa: N801
    """Protocol Buffers: a message with the bytes, the shape and the type of each array."""

    def __init__(self, session: Session) -> None:
        """Makes the classes of the schema, which needs no compiler."""
        super().__init__(session)
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

        field = descriptor_pb2.FieldDescriptorProto
        one, many = field.LABEL_OPTIONAL, field.LABEL_REPEATED
        file = descriptor_pb2.FileDescriptorProto(name="bench.proto", package="bench")
        file.syntax = "proto3"
        array, frame = file.message_type.add(name="Array"), file.message_type.add(name="Frame")
        array.field.add(name="name", number=1, type=field.TYPE_STRING, label=one)
        array.field.add(name="dtype", number=2, type=field.TYPE_STRING, label=one)
        array.field.add(name="shape", number=3, type=field.TYPE_INT64, label=many)
        array.field.add(name="data", number=4, type=field.TYPE_BYTES, label=one)
        frame.field.add(name="number", number=1, type=field.TYPE_INT64, label=one)
        arrays = frame.field.add(name="arrays", number=2, type=field.TYPE_MESSAGE, label=many)
        arrays.type_name = ".bench.Array"
        pool = descriptor_pool.DescriptorPool()
        pool.Add(file)
        classes = message_factory.GetMessageClassesForFiles(["bench.proto"], pool)
        self._frame: Any = classes["bench.Frame"]

    def serialize(self, value: Any) -> bytes:
        """One byte string."""
        number, arrays = _named(value)
        message = self._frame(number=number)
        for name, array in arrays:
            data = array.tobytes()
            message.arrays.add(name=name, dtype=array.dtype.str, shape=array.shape, data=data)
        return message.SerializeToString()

    def deserialize(self, encoded: bytes) -> Any:
        """The value over the bytes of the message."""
        message = self._frame.FromString(encoded)
        arrays = [
            (it.name, np.frombuffer(it.data, it.dtype).reshape(it.shape)) for it in message.arrays
        ]
        return _value(message.number, arrays)


class ros_message(_Codec):  # noqa: N801
    """An `Image` of ROS 2 for each array, as ros2_numpy makes it; what travels is not made yet.

    The classes are those of rosbags, which keeps bytes in arrays and checks none.
    """

    def __init__(self, session: Session) -> None:
        """Has the classes of Humble."""
        super().__init__(session)
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self._image, self._header, self._time = (
            self.store.types[name]
            for name in (
                "sensor_msgs/msg/Image",
                "std_msgs/msg/Header",
                "builtin_interfaces/msg/Time",
            )
        )

    def data(self, array: np.ndarray) -> Any:
        """The array as a message has it."""
        return np.frombuffer(array.tobytes(), np.uint8)

    def serialize(self, value: Any) -> Any:
        """A message for each array."""
        number, arrays = _named(value)
        return [
            self._image(
                header=self._header(stamp=self._time(sec=number, nanosec=0), frame_id=name),
                height=1,
                width=array.size,
                encoding="64FC1",
                is_bigendian=0,
                step=array.nbytes,
                data=self.data(array),
            )
            for name, array in arrays
        ]

    def deserialize(self, encoded: Any) -> Any:
        """The value over the bytes of the messages."""
        arrays = [
            (message.header.frame_id, np.frombuffer(message.data, np.float64))
            for message in encoded
        ]
        return _value(encoded[0].header.stamp.sec, arrays)


class ros_cdr(ros_message):  # noqa: N801
    """The same, and the CDR of the messages, which is what travels."""

    def serialize(self, value: Any) -> Any:
        """A byte string for each array."""
        kind = self._image.__msgtype__
        return [self.store.serialize_cdr(message, kind) for message in super().serialize(value)]

    def deserialize(self, encoded: Any) -> Any:
        """The value."""
        kind = self._image.__msgtype__
        return super().deserialize([self.store.deserialize_cdr(it, kind) for it in encoded])


class ros_checked(ros_message):  # noqa: N801
    """As `ros_message`, with the check that rclpy's classes make of `bytes`: of each byte."""

    def data(self, array: np.ndarray) -> Any:
        """The array as rclpy has it, once its values have been found to be bytes."""
        data = array.tobytes()
        if not all(isinstance(it, int) for it in data) or not all(0 <= it < 256 for it in data):
            raise ValueError("not bytes")
        return np.frombuffer(data, np.uint8)


class ros2_numpy(_Codec):  # noqa: N801
    """The package itself, with rclpy's classes, where there is a ROS 2."""

    def __init__(self, session: Session) -> None:
        """Needs both packages."""
        super().__init__(session)
        import ros2_numpy as package
        from sensor_msgs.msg import Image

        self._package, self._image = package, Image

    def takes(self, value: Any) -> bool:
        """Arrays only."""
        return not isinstance(value, dict)

    def serialize(self, value: Any) -> Any:
        """An `Image`."""
        return self._package.msgify(self._image, value.reshape(1, -1), encoding="64FC1")

    def deserialize(self, encoded: Any) -> Any:
        """The array."""
        return self._package.numpify(encoded).reshape(-1)
