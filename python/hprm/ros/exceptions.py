"""The exceptions of ``rclpy.exceptions``, and those that rclpy has in its extension module."""

from __future__ import annotations

from typing import Any


class NotInitializedException(Exception):
    """``init`` has not been called yet."""

    def __init__(self, message: str | None = None) -> None:
        """Say what needed it."""
        said = "rclpy.init() has not been called."
        super().__init__(f"{said[:-1]}. msg:{message}" if message else said)


class NoTypeSupportImportedException(Exception):
    """A class is no interface: it has no type support."""

    def __init__(self, what: str = "") -> None:
        """Make the exception; ``what`` is wrong."""
        super().__init__(f"no type_support imported{what and ': '}{what}")


class NameValidationException(Exception):
    """A name is invalid; the message shows where."""

    def __init__(self, name_type: str, name: str, error_msg: str, invalid_index: int) -> None:
        """Say what is wrong, with a mark below the character."""
        mark = " " * invalid_index + "^"
        super().__init__(f"Invalid {name_type}: {error_msg}:\n  '{name}'\n   {mark}")


class InvalidNamespaceException(NameValidationException):
    """A namespace is invalid."""

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        """Say what is wrong with it."""
        super().__init__("namespace", name, error_msg, invalid_index)


class InvalidNodeNameException(NameValidationException):
    """A node's name is invalid."""

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        """Say what is wrong with it."""
        super().__init__("node name", name, error_msg, invalid_index)


class InvalidTopicNameException(NameValidationException):
    """A topic's name is invalid."""

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        """Say what is wrong with it."""
        super().__init__("topic name", name, error_msg, invalid_index)


class InvalidServiceNameException(NameValidationException):
    """A service's name is invalid."""

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        """Say what is wrong with it."""
        super().__init__("service name", name, error_msg, invalid_index)


class ParameterException(Exception):
    """What all exceptions about parameters have in common."""

    def __init__(self, error_msg: str, parameters: str | list[str] | tuple[str, ...]) -> None:
        """Say what is wrong with which parameters."""
        super().__init__(f"{error_msg}: {parameters}")


class ParameterNotDeclaredException(ParameterException):
    """A parameter is used that was not declared."""

    def __init__(self, parameters: str | list[str]) -> None:
        """Name the parameters."""
        super().__init__("Invalid access to undeclared parameter(s)", parameters)


class ParameterAlreadyDeclaredException(ParameterException):
    """A parameter is declared for the second time."""

    def __init__(self, parameters: str | list[str]) -> None:
        """Name the parameters."""
        super().__init__("Parameter(s) already declared", parameters)


class InvalidParameterException(ParameterException):
    """A parameter's name is invalid."""

    def __init__(self, parameter_name: str) -> None:
        """Name the parameter."""
        super().__init__("Invalid parameter name", parameter_name)


class InvalidParameterTypeException(ParameterException):
    """A value has another type than its parameter."""

    def __init__(self, desired_parameter: Any, expected_type: str) -> None:
        """Name the parameter that should have been set, and the type that it has to have."""
        super().__init__(
            f"Trying to set parameter '{desired_parameter.name}' to "
            f"'{desired_parameter.value}' of type '{desired_parameter.type_.name}', "
            f"expecting type '{expected_type}'",
            desired_parameter.name,
        )


class InvalidParameterValueException(ParameterException):
    """A callback or a descriptor refuses a value."""

    def __init__(self, parameter: str, value: Any, reason: str) -> None:
        """Name the parameter, the value and the reason."""
        super().__init__(
            f"Invalid parameter value ({value}) for parameter. Reason: {reason}", parameter
        )


class ParameterImmutableException(ParameterException):
    """A read-only parameter is set."""

    def __init__(self, parameter_name: str) -> None:
        """Name the parameter."""
        super().__init__("Attempted to modify read-only parameter", parameter_name)


class ParameterUninitializedException(ParameterException):
    """A parameter is used that has no value yet."""

    def __init__(self, parameter_name: str) -> None:
        """Name the parameter."""
        super().__init__(f"The parameter '{parameter_name}' is not initialized", parameter_name)


class ROSInterruptException(Exception):
    """``shutdown`` ended what a thread was waiting for."""

    def __init__(self) -> None:
        """Make the exception."""
        super().__init__("rclpy.shutdown() has been called")


class InvalidHandle(Exception):
    """An object is used that was destroyed."""


class RCLError(RuntimeError):
    """What rclpy's C libraries report."""


class RCLInvalidROSArgsError(RCLError):
    """An argument after ``--ros-args`` cannot be read."""


class UnknownROSArgsError(RuntimeError):
    """There is no such argument after ``--ros-args``."""


class NodeNameNonExistentError(RCLError):
    """No node has this name."""


class UnsupportedEventTypeError(RCLError):
    """There are no such events here."""
