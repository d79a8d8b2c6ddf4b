"""The Python side of a program: its module, the classes of its reactors, and their instances."""

from collections.abc import Callable
from functools import partial
from operator import attrgetter
from types import FunctionType, ModuleType
from typing import Any, NoReturn

from hprm import _compile, _lf, _main, _suspects, _thread_failures
from hprm._classes import ReactorBase
from hprm._hprm import Api
from hprm._source import ClassSource, Code, InstanceSource, Parameter, ProgramSource

Body = Callable[..., Any]
Bodies = tuple[Body, Body | None, Body | None]


class Program:
    """A program whose preambles have run and whose instances are made."""

    def __init__(self, source: ProgramSource, api: Api) -> None:
        """Load a program."""
        self._lf = _lf.make_module(api, source)
        # Before the preambles, which may set a hook of their own.
        _thread_failures.watch(api)
        self._module = _main.make_module(source)
        _main.prepare(source, self._lf, self._names)
        self._expressions: dict[Code, Body] = {}
        self._classes: dict[int, _Class] = {}
        for used in sorted({instance.cls for instance in source.instances}):
            made = _Class(source.classes[used], self)
            self._classes[used] = made
            self._names[made.cls.__name__] = made.cls
        for made in self._classes.values():
            _suspects.check(made.source, made.cls, made.reactions, self._names)
        self._instances: dict[int, tuple[_Class, ReactorBase]] = {}
        for instance in source.instances:
            self._make_instance(instance)

    def bodies(self, reactor: int, reaction: int) -> tuple[ReactorBase, Bodies] | None:
        """Return an instance and the bodies of one of its reactions, if it runs here."""
        if reactor not in self._instances:
            return None
        made, instance = self._instances[reactor]
        return instance, made.reactions[reaction]

    def reset(self, reactor: int, state: list[int]) -> tuple[ReactorBase, Bodies] | None:
        """Return an instance and what gives some of its state its first values again."""
        if reactor not in self._instances:
            return None
        made, instance = self._instances[reactor]
        variables = [made.source.state[index] for index in state]
        return instance, (partial(self._set_state, variables), None, None)

    def body(self, code: Code, name: str, arguments: list[str]) -> Body:
        """Compile what a reaction runs."""
        return _compile.body(code, name, arguments, self._names)

    def function(self, code: Code, name: str, arguments: list[str]) -> Body:
        """Compile a function that sees the names of the program."""
        return _compile.function(code, name, arguments, self._names)

    def preamble(self, code: Code, names: dict[str, Any]) -> None:
        """Run a preamble that adds to ``names``."""
        exec(_compile.statements(code), self._names, names)

    @property
    def lf(self) -> ModuleType:
        """The module ``lf``."""
        return self._lf

    @property
    def _names(self) -> dict[str, Any]:
        return vars(self._module)

    def _make_instance(self, source: InstanceSource) -> None:
        made = self._classes[source.cls]
        parent = None if source.parent is None else self._instances[source.parent][1]
        bank_index = source.bank_index or 0
        instance = made.cls()
        # A class may declare `bank_index` to have it assigned; its default is still the position.
        values = dict(made.source.parameters) | {"bank_index": bank_index}
        for name, value in (values | dict(source.assignments)).items():
            vars(instance)[f"_{name}"] = self.evaluate(value, parent, bank_index)
        self._set_state(made.source.state, instance)
        self._instances[source.reactor] = (made, instance)

    def _set_state(self, variables: list[tuple[str, Any]], instance: ReactorBase) -> None:
        for name, value in variables:
            setattr(instance, name, self.evaluate(value, instance, instance.bank_index))

    def evaluate(self, value: Any, owner: ReactorBase | None, bank_index: int) -> Any:
        """Compute a value in the context of ``owner``, afresh each time."""
        match value:
            case Code():
                if value not in self._expressions:
                    self._expressions[value] = _compile.expression(value, self._names)
                return self._expressions[value](owner, bank_index)
            case Parameter(name):
                return getattr(owner, name)
            case list():
                return [self.evaluate(entry, owner, bank_index) for entry in value]
            case tuple():
                return tuple(self.evaluate(entry, owner, bank_index) for entry in value)
        return value


class _Class:
    """The class of a reactor, and the bodies of its reactions."""

    def __init__(self, source: ClassSource, program: Program) -> None:
        self.source = source
        names: dict[str, Any] = {"__module__": "__main__", "_lf": program.lf, "_source": source}
        for preamble in source.preambles:
            program.preamble(preamble, names)
        for name, _ in source.parameters:
            names[name] = _parameter(name)
        for name, arguments, defaults, code in source.methods:
            method = program.function(code, name, ["self", *arguments])
            # As in Python, a default is evaluated once, where nothing of an instance is known.
            assert isinstance(method, FunctionType)
            method.__defaults__ = tuple(program.evaluate(value, None, 0) for value in defaults)
            names[name] = method

        def handler(code: Code | None, name: str, arguments: list[str]) -> Body | None:
            return None if code is None else program.body(code, name, arguments)

        self.reactions: list[Bodies] = []
        for number, reaction in enumerate(source.reactions):
            arguments = ["self", *reaction.arguments]
            self.reactions.append(
                (
                    program.body(reaction.body, f"reaction_function_{number}", arguments),
                    handler(reaction.deadline, f"deadline_function_{number}", arguments),
                    handler(reaction.tardy, f"STP_function_{number}", arguments),
                )
            )
        self.cls: type[ReactorBase] = type(f"_{source.name}", (ReactorBase,), names)


def _parameter(name: str) -> property:
    """Make the attribute for a parameter, which only the program's text sets."""

    def refuse(instance: object, value: object) -> NoReturn:
        raise AttributeError(
            f"the parameter {name} cannot be assigned; keep what changes in a state variable"
        )

    return property(attrgetter(f"_{name}"), refuse)


def load(source: ProgramSource, api: Api) -> Program:
    """Load a program."""
    return Program(source, api)
