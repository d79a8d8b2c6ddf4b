"""Arguments of reactions that are made of ports: contained instances, and mutable inputs."""

import copy
from typing import Any, NoReturn

from hprm._classes import Make
from hprm._hprm import port_capsule
from hprm._kinds import loaded


class Contained:
    """An instance inside a reactor, with the ports that a reaction names as attributes."""

    def __init__(self, name: str, ports: dict[str, port_capsule]) -> None:
        """Make an instance of that name."""
        self.__dict__.update(ports)
        self.__dict__[""] = name

    def __getattr__(self, port: str) -> NoReturn:
        """Say why a port is missing."""
        name = self.__dict__.get("", "?")
        raise AttributeError(
            f"{name}.{port} is not a trigger, source or effect of this reaction",
            name=port,
            obj=self,
        )

    def __setattr__(self, port: str, value: object) -> NoReturn:
        """Say how a port is set."""
        name = self.__dict__[""]
        raise AttributeError(f"a port is set by its method: {name}.{port}.set(...)")

    def __repr__(self) -> str:
        """Name the instance."""
        return f"<instance {self.__dict__['']}>"


class MutableInput(Make):
    """An input that a reaction may change: ``value`` is a copy of its own."""

    value: Any
    is_present: bool

    def __init__(self, port: port_capsule) -> None:
        """Copy what is present."""
        self.is_present = port.is_present
        self.value = _copied(port.value)

    def set(self, value: object) -> NoReturn:
        """Say how an input is changed."""
        raise TypeError("an input cannot be set; give its copy another value: ...value = ...")


def mutable(port: port_capsule) -> "MutableInput | list[MutableInput]":
    """Copy an input, or all channels of one."""
    if port.width < 0:
        return MutableInput(port)
    return [MutableInput(channel) for channel in port]


def _copied(value: Any) -> Any:
    numpy = loaded("numpy")
    if numpy is not None and type(value) is numpy.ndarray and not value.dtype.hasobject:
        from hprm._kinds import arrays

        made = numpy.empty(value.shape, value.dtype)
        arrays.raw(made)[...] = arrays.raw(value)
        return made
    return copy.deepcopy(value)
