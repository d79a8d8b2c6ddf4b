"""Classes of messages, services and actions, made of structures."""

from __future__ import annotations

import array
from collections.abc import Callable
from typing import Any

from hprm.ros._messages import arrays
from hprm.ros._messages.definitions import DefinitionError, Field, Structure, Type
from hprm.ros._messages.fields import NUMBERS, checker, converter, python_type

#: Finds the class of a message by ``package/Name``.
Resolve = Callable[[str], type]

_UUID = "unique_identifier_msgs/UUID"
_TIME = "builtin_interfaces/Time"


def message(structure: Structure, module: str, resolve: Resolve) -> type:
    """Make the class of a message; ``structure.name`` ends with its name."""
    name = structure.name.rpartition("/")[2]
    kinds = {it.name: _kind(it, structure, resolve) for it in structure.fields}
    described = {it.name: it.type.name for it in structure.fields}
    members: dict[str, Any] = {
        "__doc__": f"Message class '{name}'.",
        "__module__": module,
        "__slots__": [f"_{it}" for it in described],
        "__hash__": None,
        "__eq__": _equal,
        "__repr__": _repr,
        "_fields_and_field_types": described,
        "__hprm_structure__": structure,
        "__hprm_kinds__": kinds,
        "SLOT_TYPES": _NoSlotTypes(),
        "get_fields_and_field_types": classmethod(_get_fields_and_field_types),
        **{name: value for name, (_, value) in structure.constants.items()},
        **{
            f"{it.name.upper()}__DEFAULT": it.default
            for it in structure.fields
            if it.default is not None
        },
    }
    checks = {it.name: checker(it, kinds[it.name]) for it in structure.fields}
    members["__init__"] = _constructor(structure, kinds, checks)
    made = type(name, (), members)
    for field_name, check in checks.items():
        slot = made.__dict__[f"_{field_name}"]
        setter = _setter(slot.__set__, check)
        setattr(made, field_name, property(slot.__get__, setter, doc=f"Field '{field_name}'."))
    # A field of this name needs its slot.
    if "copied" not in described:
        made._copied = _copier(made)  # type: ignore[attr-defined]
    return made


def service(structures: list[Structure], module: str, resolve: Resolve) -> dict[str, type]:
    """Make the classes of a service of the structures of its request and its response.

    Under ``__getattr__`` is what makes that of its events, for the module that has the others.
    """
    full = structures[0].name
    made = {
        part: message(_renamed(structure, f"{full}_{part}"), module, resolve)
        for part, structure in zip(("Request", "Response"), structures, strict=True)
    }
    classes = _with_service(full, made["Request"], made["Response"], module, resolve)
    whole: Any = classes[full.rpartition("/")[2]]

    def find(name: str) -> Any:
        if name != f"{whole.__name__}_Event":
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        return whole.Event

    return {**classes, "__getattr__": find}  # type: ignore[dict-item]


def action(structures: list[Structure], module: str, resolve: Resolve) -> dict[str, type]:
    """Make the classes of an action of the structures of its goal, its result and its feedback."""
    full = structures[0].name
    package, _, name = full.split("/")
    parts = {
        part: message(_renamed(structure, f"{full}_{part}"), module, resolve)
        for part, structure in zip(("Goal", "Result", "Feedback"), structures, strict=True)
    }
    made = {it.__name__: it for it in parts.values()}

    def find(base: str) -> type:
        found = made.get(base.partition("/")[2]) if base.startswith(f"{package}/") else None
        return found or resolve(base)

    def wrapped(suffix: str, *fields: tuple[str, str]) -> type:
        listed = [Field(field, Type(base)) for field, base in fields]
        structure = Structure(f"{full}_{suffix}", structures[0].file, listed)
        return message(structure, module, find)

    goal_id = ("goal_id", _UUID)
    send_goal = _with_service(
        f"{full}_SendGoal",
        wrapped("SendGoal_Request", goal_id, ("goal", f"{package}/{name}_Goal")),
        wrapped("SendGoal_Response", ("accepted", "bool"), ("stamp", _TIME)),
        module,
        resolve,
    )
    get_result = _with_service(
        f"{full}_GetResult",
        wrapped("GetResult_Request", goal_id),
        wrapped("GetResult_Response", ("status", "int8"), ("result", f"{package}/{name}_Result")),
        module,
        resolve,
    )
    feedback = wrapped("FeedbackMessage", goal_id, ("feedback", f"{package}/{name}_Feedback"))
    impl = type(
        "Impl",
        (),
        {
            "__doc__": f"What carries the action '{name}'.",
            "__module__": module,
            "__qualname__": f"{name}.Impl",
            "SendGoalService": send_goal[f"{name}_SendGoal"],
            "GetResultService": get_result[f"{name}_GetResult"],
            "FeedbackMessage": feedback,
            "CancelGoalService": resolve("action_msgs/srv/CancelGoal"),
            "GoalStatusMessage": resolve("action_msgs/GoalStatusArray"),
        },
    )
    members = {**parts, "Impl": impl, "__init__": _refuse("Action")}
    whole = _container(name, full, module, members)
    return {**made, **send_goal, **get_result, feedback.__name__: feedback, name: whole}


def _with_service(
    full: str, request: type, response: type, module: str, resolve: Resolve
) -> dict[str, type]:
    name = full.rpartition("/")[2]
    members: dict[str, Any] = {
        "Request": request,
        "Response": response,
        "Event": _LazyEvent(full, module, resolve),
        "__init__": _refuse("Service"),
    }
    whole = _container(name, full, module, members)
    return {it.__name__: it for it in (request, response, whole)}


class _LazyEvent:
    """Makes the class of a service's events when it is asked for: few programs need one."""

    def __init__(self, full: str, module: str, resolve: Resolve) -> None:
        self._full, self._module, self._resolve = full, module, resolve

    def __get__(self, _: object, service: Any) -> type:
        package = self._full.split("/")[0]
        parts = {it.__name__: it for it in (service.Request, service.Response)}

        def find(base: str) -> type:
            return parts.get(base.partition("/")[2]) or self._resolve(base)

        fields = [Field("info", Type("service_msgs/ServiceEventInfo"))]
        for field, part in zip(("request", "response"), parts, strict=True):
            fields.append(Field(field, Type(f"{package}/{part}", many="sequence", size=1)))
        structure = Structure(
            f"{self._full}_Event", service.Request.__hprm_structure__.file, fields
        )
        service.Event = made = message(structure, self._module, find)
        return made


def _container(name: str, full: str, module: str, members: dict[str, Any]) -> type:
    kind = full.split("/")[1]
    described = {"srv": "Service", "action": "Action"}[kind]
    doc = f"{described} class '{name}'."
    return type(name, (), {"__doc__": doc, "__module__": module, "_name": full, **members})


def _refuse(what: str) -> Callable[[Any], None]:
    def init(self: Any) -> None:
        raise NotImplementedError(f"{what} classes can not be instantiated")

    return init


def _renamed(structure: Structure, name: str) -> Structure:
    return Structure(name, structure.file, structure.fields, structure.constants)


def _kind(it: Field, structure: Structure, resolve: Resolve) -> type:
    basic = python_type(it.type.base)
    if basic is not None:
        return basic
    try:
        return resolve(it.type.base)
    except LookupError as error:
        raise DefinitionError(
            f"{structure.place(it.line)}: the type of {it.name!r} is unknown: {error.args[0]}"
        ) from None


def _setter(put: Callable[[Any, Any], None], check: Callable[[Any], Any]) -> Callable[..., None]:
    def set_(self: Any, value: Any) -> None:
        put(self, check(value))

    return set_


def _constructor(
    structure: Structure, kinds: dict[str, type], checks: dict[str, Callable[[Any], Any]]
) -> Callable[..., None]:
    """Compile a constructor, because what is written out takes a third of the time."""
    scope: dict[str, Any] = {"array": array.array, "arrays": arrays, "reject": _reject}
    plain, given = [], []
    for it in structure.fields:
        scope[f"kind_{it.name}"] = kinds[it.name]
        scope[f"convert_{it.name}"] = converter(it, checks[it.name])
        first = f"self._{it.name} = {_initial(it, scope)}"
        plain.append(first)
        given.append(
            f"if {it.name!r} in kwargs: self._{it.name} = convert_{it.name}(kwargs[{it.name!r}])\n"
            f"    else: {first}"
        )
    scope["names"] = frozenset(it.name for it in structure.fields)
    lines = ["def __init__(self, **kwargs):", "    if not kwargs:"]
    lines += [f"        {line}" for line in (*plain, "return")]
    lines += ["    if not names.issuperset(kwargs): reject(names, kwargs)"]
    lines += [f"    {line}" for line in given]
    exec(compile("\n".join(lines), f"<{structure.name}>", "exec"), scope)
    made: Callable[..., None] = scope["__init__"]
    return made


def _initial(it: Field, scope: dict[str, Any]) -> str:
    """Return the expression of what a field holds at first."""
    base, many = it.type.base, it.type.many
    code, dtype = NUMBERS.get(base, ("", ""))
    if it.default is not None:
        written = repr(it.default)
        if many is None or not code:
            return written
        if many == "array":
            return f"arrays.array({written}, {dtype!r})"
        return f"array({code!r}, {written})"
    if many == "sequence":
        return f"array({code!r})" if code else "[]"
    if many == "array" and code:
        return f"arrays.zeros({it.type.size}, {dtype!r})"
    scope_name = f"kind_{it.name}"
    one = f"{scope_name}()" if it.type.is_message else repr(_ZERO[scope[scope_name]])
    return one if many is None else f"[{one} for _ in range({it.type.size})]"


_ZERO = {int: 0, float: 0.0, bool: False, str: "", bytes: b"\0"}


def _reject(names: frozenset[str], given: dict[str, Any]) -> None:
    unknown = ", ".join(sorted(set(given) - names))
    raise AssertionError(f"Invalid arguments passed to constructor: {unknown}")


def _equal(self: Any, other: object) -> bool:
    if not isinstance(other, self.__class__):
        return False
    return all(_same(getattr(self, it), getattr(other, it)) for it in self.__slots__)


def _same(one: Any, other: Any) -> bool:
    if arrays.is_array(one) or arrays.is_array(other):
        import numpy

        return bool(numpy.array_equal(one, other))
    return bool(one == other)


def _repr(self: Any) -> str:
    kind = type(self)
    module = kind.__module__.rpartition(".")[0]
    arguments = []
    for it in kind.__hprm_structure__.fields:
        value = getattr(self, it.name)
        if it.type.many == "sequence" and it.type.base in NUMBERS:
            value = value.tolist()
        arguments.append(f"{it.name}={value!r}")
    return f"{module}.{kind.__name__}({', '.join(arguments)})"


def _copier(kind: Any) -> Callable[[Any], Any]:
    slots = [kind.__dict__[it] for it in kind.__slots__]
    transfers = [(slot.__get__, slot.__set__) for slot in slots]

    def copied(self: Any) -> Any:
        """Return a copy, which shares only large arrays of NumPy."""
        made = object.__new__(kind)
        for get, put in transfers:
            value = get(self)
            put(made, value if type(value) in _ZERO else _copy(value))
        return made

    return copied


def _copy(value: Any) -> Any:
    if arrays.is_array(value):
        return value if value.nbytes > arrays.LARGE else value.copy()
    if isinstance(value, array.array):
        return value[:]
    if isinstance(value, list):
        return [_copy(it) for it in value]
    copied = getattr(value, "_copied", None)
    return value if copied is None else copied()


def _get_fields_and_field_types(kind: Any) -> dict[str, str]:
    return dict(kind._fields_and_field_types)


class _NoSlotTypes:
    """Stands for the types of the package ``rosidl_parser``, which HPRM does not have."""

    def __get__(self, _: object, kind: type) -> Any:
        raise AttributeError(
            f"{kind.__name__}.SLOT_TYPES consists of objects of rosidl_parser, which hprm.ros does "
            "not have; get_fields_and_field_types() tells the types of fields as text"
        )
