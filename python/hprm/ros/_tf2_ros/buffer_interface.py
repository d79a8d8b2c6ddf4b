"""What buffers of transforms do with data of registered types, as in ``tf2_ros``."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any, ClassVar

from hprm.ros._interfaces import interface
from hprm.ros.duration import Duration


class TypeException(Exception):
    """No function is registered for a type."""

    def __init__(self, errstr: str) -> None:
        """Say which type."""
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A class of buffers lacks a method."""

    def __init__(self) -> None:
        """Make the exception."""
        self.errstr = "CanTransform or LookupTransform not implemented"
        super().__init__(self.errstr)


class BufferInterface:
    """What all buffers of transforms have: they transform data of registered types.

    ``import tf2_geometry_msgs`` registers points, vectors, poses and polygons.
    """

    def __init__(self) -> None:
        """Begin with the functions that are registered."""
        self.registration = TransformRegistration()

    def transform(
        self,
        object_stamped: Any,
        target_frame: str,
        timeout: Duration = Duration(),  # noqa: B008 (it never changes)
        new_type: Any = None,
    ) -> Any:
        """Return data with a header in another frame, at the time of the header.

        Raises ``TypeException`` if nothing is registered for the type; ``new_type`` is what the
        result is converted to.
        """
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        found = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        return _converted(do_transform(object_stamped, found), new_type)

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: Any,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008 (it never changes)
        new_type: Any = None,
    ) -> Any:
        """Return data in another frame at another time, by way of a frame that does not move."""
        do_transform = self.registration.get(type(object_stamped))
        header = object_stamped.header
        found = self.lookup_transform_full(
            target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout
        )
        return _converted(do_transform(object_stamped, found), new_type)

    def lookup_transform(self, *args: Any, **kwargs: Any) -> Any:
        """Return the transform from one frame to another; subclasses have this."""
        raise NotImplementedException

    def lookup_transform_full(self, *args: Any, **kwargs: Any) -> Any:
        """Return the transform between two frames at two times; subclasses have this."""
        raise NotImplementedException

    def can_transform(self, *args: Any, **kwargs: Any) -> Any:
        """Return whether there is such a transform; subclasses have this."""
        raise NotImplementedException

    def can_transform_full(self, *args: Any, **kwargs: Any) -> Any:
        """Return whether there is such a transform; subclasses have this."""
        raise NotImplementedException


def _converted(result: Any, new_type: Any) -> Any:
    return result if new_type is None else convert(result, new_type)


def Stamped(obj: Any, stamp: Any, frame_id: str) -> Any:  # noqa: N802 (the name of tf2_ros)
    """Give an object a header, and return it."""
    obj.header = interface("std_msgs.msg", "Header")(frame_id=frame_id, stamp=stamp)
    return obj


def _found(functions: dict[Any, Any], key: Any) -> Callable[..., Any]:
    try:
        return functions[key]  # type: ignore[no-any-return]
    except KeyError:
        raise TypeException(f"Type {key} is not loaded or supported") from None


class TransformRegistration:
    """The functions that transform data, by type; all objects share them."""

    _functions: ClassVar[dict[Any, Any]] = {}

    def print_me(self) -> None:
        """Print what is registered."""
        print(self._functions)

    def add(self, key: Any, callback: Callable[[Any, Any], Any]) -> None:
        """Register a function of data and transform for a type."""
        self._functions[key] = callback

    def get(self, key: Any) -> Callable[[Any, Any], Any]:
        """Return the function for a type; raise ``TypeException`` if there is none."""
        return _found(self._functions, key)


class ConvertRegistration:
    """The functions that convert data, by type; all objects share them."""

    _to_msg: ClassVar[dict[Any, Any]] = {}
    _from_msg: ClassVar[dict[Any, Any]] = {}
    _convert: ClassVar[dict[Any, Any]] = {}

    def add_from_msg(self, key: Any, callback: Callable[[Any], Any]) -> None:
        """Register how a type is made from a message."""
        self._from_msg[key] = callback

    def add_to_msg(self, key: Any, callback: Callable[[Any], Any]) -> None:
        """Register how a type becomes a message."""
        self._to_msg[key] = callback

    def add_convert(self, key: tuple[Any, Any], callback: Callable[[Any], Any]) -> None:
        """Register how one type becomes another one without a message."""
        self._convert[key] = callback

    def get_from_msg(self, key: Any) -> Callable[[Any], Any]:
        """Return how a type is made from a message."""
        return _found(self._from_msg, key)

    def get_to_msg(self, key: Any) -> Callable[[Any], Any]:
        """Return how a type becomes a message."""
        return _found(self._to_msg, key)

    def get_convert(self, key: tuple[Any, Any]) -> Callable[[Any], Any]:
        """Return how one type becomes another one."""
        return _found(self._convert, key)


def convert(a: Any, b_type: Any) -> Any:
    """Return an object as another type: directly if that is registered, else by a message."""
    registered = ConvertRegistration()
    try:
        return registered.get_convert((type(a), b_type))(a)
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
    return registered.get_from_msg(b_type)(registered.get_to_msg(type(a))(a))
