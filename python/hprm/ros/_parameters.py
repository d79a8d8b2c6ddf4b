"""The parameters that a node has declared, and what may become of them."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from hprm.ros._interfaces import interface
from hprm.ros._overrides import Value
from hprm.ros._parameter_ranges import out_of_range
from hprm.ros.exceptions import (
    InvalidParameterException,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from hprm.ros.parameter import Parameter

Check = Callable[[list[Parameter]], Any]


@dataclass
class ParameterChanges:
    """What has become of parameters that were set together."""

    new: list[Parameter] = field(default_factory=list)
    changed: list[Parameter] = field(default_factory=list)
    deleted: list[Parameter] = field(default_factory=list)


class Parameters:
    """The part of a node that has its parameters; ``Node`` extends it."""

    def _begin_parameters(self, overrides: dict[str, Value], allow_undeclared: bool) -> None:
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._overrides = {name: Parameter(name, value=value) for name, value in overrides.items()}
        self._allow_undeclared_parameters = allow_undeclared
        self._checks: list[Check] = []
        self._before: list[Callable[[list[Parameter]], list[Parameter]]] = []
        self._after: list[Callable[[list[Parameter]], None]] = []

    # Declaring.

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        """Declare a parameter; return it with the value that it gets."""
        declared = (name,) if value is None and descriptor is None else (name, value, descriptor)
        return self.declare_parameters("", [declared], ignore_override)[0]

    def declare_parameters(
        self,
        namespace: str,
        parameters: Sequence[tuple[Any, ...]],
        ignore_override: bool = False,
    ) -> list[Parameter]:
        """Declare parameters: names with a value or a type, and perhaps a descriptor."""
        made: list[Parameter] = []
        for number, stated in enumerate(parameters):
            if not isinstance(stated[0], str):
                raise TypeError(
                    f"First element {stated[0]} for parameters entry at index {number} should be"
                    " a string"
                )
            name = f"{namespace}.{stated[0]}" if namespace else stated[0]
            if name in self._parameters or name in (it.name for it in made):
                raise ParameterAlreadyDeclaredException([name])
            self._check_name(name)
            made.append(self._first(name, stated[1:], ignore_override))
        for parameter in made:
            result = self._allowed([parameter], self._checks)
            if not result.successful:
                raise InvalidParameterValueException(parameter.name, parameter.value, result.reason)
            self._store([parameter], is_declared=True)
        return made

    def _first(self, name: str, stated: tuple[Any, ...], ignore_override: bool) -> Parameter:
        """Make a parameter that is declared, of its value or its override."""
        value = stated[0] if stated else None
        descriptor = stated[1] if len(stated) > 1 else None
        if descriptor is None:
            descriptor = interface("rcl_interfaces.msg", "ParameterDescriptor")()
        if not stated:
            _warn_of_name_only(name)
            descriptor.dynamic_typing = True
        descriptor.name = name
        default: Any = value
        if isinstance(value, Parameter.Type):
            if value is Parameter.Type.NOT_SET:
                raise ValueError(
                    f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET"
                )
            if descriptor.dynamic_typing:
                raise ValueError(
                    f"When declaring parameter {{{name}}} passing a descriptor with"
                    "`dynamic_typing=True` is not allowed when the parameter type is provided"
                )
            descriptor.type, default = value.value, None
        elif isinstance(value, Parameter):
            default = value.value
        if default is None and value is None and not descriptor.dynamic_typing:
            raise ValueError(
                "Cannot declare a statically typed parameter with default value of type"
                " PARAMETER_NOT_SET"
            )
        if isinstance(value, Parameter.Type) is False and default is not None:
            descriptor.type = Parameter.Type.from_parameter_value(default).value
        self._descriptors[name] = descriptor
        parameter = Parameter(name, value=default)
        if not ignore_override and name in self._overrides:
            parameter = self._overrides[name]
        wrong = self._mismatch(parameter)
        if wrong and parameter.type_ is not Parameter.Type.NOT_SET:
            raise InvalidParameterTypeException(parameter, Parameter.Type(descriptor.type).name)
        return parameter

    def undeclare_parameter(self, name: str) -> None:
        """Forget a parameter that was declared."""
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        if self._descriptors[name].read_only:
            raise ParameterImmutableException(name)
        del self._parameters[name], self._descriptors[name]

    def has_parameter(self, name: str) -> bool:
        """Return whether a parameter was declared."""
        return name in self._parameters

    # Reading.

    def get_parameter(self, name: str) -> Parameter:
        """Return a parameter."""
        found = self._parameters.get(name)
        if found is None:
            if self._allow_undeclared_parameters:
                return Parameter(name)
            raise ParameterNotDeclaredException(name)
        descriptor = self._descriptors[name]
        if found.type_ is Parameter.Type.NOT_SET and not descriptor.dynamic_typing:
            raise ParameterUninitializedException(name)
        return found

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        """Return some parameters."""
        if not all(isinstance(it, str) for it in names):
            raise TypeError("All names must be instances of type str")
        return [self.get_parameter(name) for name in names]

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """Return a parameter, or an alternative if it has no value."""
        found = self._parameters.get(name)
        if found is None or found.type_ is Parameter.Type.NOT_SET:
            return Parameter(name) if alternative_value is None else alternative_value
        return found

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """Return the parameters below a prefix, by the rest of their names."""
        before = f"{prefix}." if prefix else ""
        return {
            name.removeprefix(before): it
            for name, it in self._parameters.items()
            if name.startswith(before)
        }

    def get_parameter_type(self, name: str) -> Parameter.Type:
        """Return the type of a parameter."""
        return self.get_parameter(name).type_

    def get_parameter_types(self, names: list[str]) -> list[Parameter.Type]:
        """Return the types of some parameters."""
        return [self.get_parameter_type(name) for name in names]

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """Return the names of parameters as ``rcl_interfaces.msg.ListParametersResult``.

        Parameters
        ----------
        prefixes
            Those below one of these, or called like it; all, if there are none.
        depth
            How many names, with dots between them, there may be below a prefix; 0 is no limit.

        """
        if not isinstance(prefixes, list):
            raise TypeError("The prefixes argument must be a list")
        if not all(isinstance(prefix, str) for prefix in prefixes):
            raise TypeError("All prefixes must be instances of type str")
        if not isinstance(depth, int):
            raise TypeError("The depth must be instance of type int")
        if depth < 0:
            raise ValueError("The depth must be greater than or equal to zero")

        def is_listed(name: str) -> bool:
            rests = (
                [name]
                if not prefixes
                else [name.removeprefix(f"{it}.") for it in prefixes if name.startswith(f"{it}.")]
            )
            return name in prefixes or any(not depth or it.count(".") < depth for it in rests)

        names = [name for name in self._parameters if is_listed(name)]
        above = dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name)
        made = interface("rcl_interfaces.msg", "ListParametersResult")
        return made(names=names, prefixes=list(above))

    def describe_parameter(self, name: str) -> Any:
        """Return the descriptor of a parameter."""
        if name not in self._descriptors:
            if self._allow_undeclared_parameters:
                return interface("rcl_interfaces.msg", "ParameterDescriptor")()
            raise ParameterNotDeclaredException(name)
        return self._descriptors[name]

    def describe_parameters(self, names: list[str]) -> list[Any]:
        """Return the descriptors of some parameters."""
        return [self.describe_parameter(name) for name in names]

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Give a parameter another descriptor; return its value."""
        if name not in self._parameters:
            raise ParameterNotDeclaredException(name)
        if self._descriptors[name].read_only:
            raise ParameterImmutableException(name)
        descriptor.name = name
        self._descriptors[name] = descriptor
        if alternative_value is not None:
            self._parameters[name] = Parameter.from_parameter_msg(
                interface("rcl_interfaces.msg", "Parameter")(name=name, value=alternative_value)
            )
        return self._parameters[name].get_parameter_value()

    # Setting.

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        """Set parameters one after the other; return whether that was allowed for each."""
        return [self.set_parameters_atomically([it]) for it in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set parameters all together, or none of them; return whether that was allowed."""
        for before in self._before:
            parameter_list = before(parameter_list)
        if self._before and not parameter_list:
            return interface("rcl_interfaces.msg", "SetParametersResult")(
                reason="parameter list cannot be empty, this might be due to "
                "pre_set_parameters_callback modifying the original parameters list."
            )
        for parameter in parameter_list:
            if not isinstance(parameter, Parameter):
                raise TypeError("parameter must be instance of type 'Parameter'")
        unknown = [it.name for it in parameter_list if it.name not in self._parameters]
        if unknown and not self._allow_undeclared_parameters:
            raise ParameterNotDeclaredException(unknown)
        result = self._allowed(parameter_list, self._checks)
        if result.successful:
            self._store(parameter_list)
        return result

    def _store(self, parameters: list[Parameter], *, is_declared: bool = False) -> None:
        """Set parameters, which is allowed, and tell of it; one without a value is forgotten."""
        changes = ParameterChanges()
        for parameter in parameters:
            name, has_value = parameter.name, parameter.type_ is not Parameter.Type.NOT_SET
            if not has_value and not is_declared:
                changes.deleted.append(parameter)
                self._parameters.pop(name, None)
                self._descriptors.pop(name, None)
                continue
            descriptor = self._descriptors.get(name)
            if descriptor is None:
                descriptor = self._descriptors[name] = interface(
                    "rcl_interfaces.msg", "ParameterDescriptor"
                )(name=name, dynamic_typing=True)
            if descriptor.dynamic_typing:
                descriptor.type = parameter.type_.value
            before = self._parameters.get(name)
            is_new = before is None or before.type_ is Parameter.Type.NOT_SET
            (changes.new if is_new else changes.changed).append(parameter)
            self._parameters[name] = parameter
        self._tell_changes(changes)
        for after in self._after:
            after(parameters)

    def _tell_changes(self, changes: ParameterChanges) -> None:
        """Tell others of what has changed."""
        raise NotImplementedError

    def add_on_set_parameters_callback(self, callback: Check) -> None:
        """Have a function decide whether parameters may be set; the last one is asked first."""
        self._checks.insert(0, callback)

    def remove_on_set_parameters_callback(self, callback: Check) -> None:
        """Ask a function no more."""
        self._checks.remove(callback)

    def add_pre_set_parameters_callback(
        self, callback: Callable[[list[Parameter]], list[Parameter]]
    ) -> None:
        """Have a function change what is set, before it is checked."""
        self._before.insert(0, callback)

    def remove_pre_set_parameters_callback(
        self, callback: Callable[[list[Parameter]], list[Parameter]]
    ) -> None:
        """Call a function no more."""
        self._before.remove(callback)

    def add_post_set_parameters_callback(self, callback: Callable[[list[Parameter]], None]) -> None:
        """Have a function called when parameters were set."""
        self._after.insert(0, callback)

    def remove_post_set_parameters_callback(
        self, callback: Callable[[list[Parameter]], None]
    ) -> None:
        """Call a function no more."""
        self._after.remove(callback)

    # Rules.

    def _allowed(self, parameters: Iterable[Parameter], checks: list[Check]) -> Any:
        result = interface("rcl_interfaces.msg", "SetParametersResult")
        parameters = list(parameters)
        for parameter in parameters:
            wrong = self._refusal(parameter)
            if wrong:
                return result(successful=False, reason=wrong)
        for check in checks:
            answer = check(parameters)
            if not answer.successful:
                return answer
        return result(successful=True)

    def _refusal(self, parameter: Parameter) -> str | None:
        """Say why a parameter may not have this value, if it may not."""
        descriptor = self._descriptors.get(parameter.name)
        if descriptor is None:
            return None
        if descriptor.read_only and parameter.name in self._parameters:
            return f"Trying to set a read-only parameter: {parameter.name}."
        is_unset = parameter.type_ is Parameter.Type.NOT_SET
        if is_unset and not descriptor.dynamic_typing:
            is_declared = parameter.name in self._parameters
            return "Static parameter cannot be undeclared" if is_declared else None
        wrong = self._mismatch(parameter)
        if wrong:
            return wrong
        return out_of_range(parameter, descriptor)

    def _mismatch(self, parameter: Parameter) -> str | None:
        descriptor = self._descriptors[parameter.name]
        expected = Parameter.Type(descriptor.type)
        if descriptor.dynamic_typing or expected is Parameter.Type.NOT_SET:
            return None
        if parameter.type_ is expected or expected.check(parameter.value):
            return None
        return f"Wrong parameter type, expected '{expected}' got '{parameter.type_}'"

    @staticmethod
    def _check_name(name: str) -> None:
        if not name:
            raise InvalidParameterException(name)


def _warn_of_name_only(name: str) -> None:
    """Warn of a parameter that has neither value nor type, at the line of the program."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__") == __name__:
        level, frame = level + 1, frame.f_back
    warnings.warn(
        f"when declaring parameter named '{name}', declaring a parameter only providing its name is"
        " deprecated. You have to pass a default value, a type, or a descriptor with"
        " `dynamic_typing=True`",
        stacklevel=level,
    )
