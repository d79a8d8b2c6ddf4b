"""What a class body declares: parts and reactions, and that bodies use only what they declare.

The model of the program is checked by the rules of the language before it runs; here is what only
the Python of a class shows.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from types import FunctionType
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from hprm import _findings, _places, _slips, _trees
from hprm._mistakes import ProgramError, one
from hprm._parts import History, Mode, Part
from hprm._places import Place
from hprm._reactions import MARK, Event, Reaction

if TYPE_CHECKING:
    from hprm._reactor import Reactor


def parts_of(cls: type) -> dict[str, Part]:
    """Collect the parts of a class, those of base classes first; a subclass may replace them."""
    found: dict[str, Part] = {}
    for base in reversed(cls.__mro__):
        for name, value in vars(base).items():
            if isinstance(value, Part):
                found[name] = value
            else:
                found.pop(name, None)
    return found


def reactions_of(cls: type) -> list[Reaction]:
    """Collect the reactions of a class, those of base classes first.

    A subclass may replace one. A method of its name is another body of it.
    """
    found: dict[str, Reaction] = {}
    for base in reversed(cls.__mro__):
        for name, value in vars(base).items():
            # Of a static method or a class method, the function is inside.
            marked = getattr(value, "__func__", value)
            reaction: Reaction | None = getattr(marked, MARK, None)
            if isinstance(value, FunctionType) and reaction is not None:
                # Another decorator may have wrapped the function above `@hprm.reaction`.
                found[name] = reaction._replace(name=name, function=value)
            elif isinstance(value, FunctionType) and name in found:
                place = _places.of_function(value)
                found[name] = found[name]._replace(function=value, place=place)
            elif reaction is not None:
                raise ProgramError(
                    f"reaction {name} is {one(type(value).__name__)}, not a method",
                    reaction.place,
                    "a decorator above @hprm.reaction(...) has to make a function",
                )
            else:
                found.pop(name, None)
    return list(found.values())


def check(cls: type[Reactor]) -> None:
    """Raise ``ProgramError`` if something is wrong with the reactions of a class."""
    _check_names(cls)
    for reaction in cls._hprm_reactions_:
        _check_function(reaction)
        _check_mode(cls, reaction.mode, reaction.place)
        for part in (*reaction.triggers, *reaction.sources, *reaction.effects):
            _check_part(cls, reaction, part)
        for body in bodies(cls, reaction):
            _check_uses(cls, reaction, body)
            _slips.check_returns(reaction, body)
    _slips.check_waits(cls)


def _check_names(cls: type[Reactor]) -> None:
    """Refuse parts with two names, or with none because they are in a list."""
    for name, value in vars(cls).items():
        if isinstance(value, Part) and value.name != name:
            raise ProgramError(
                f"this {value.kind} has two names, {value.name} and {name}",
                value.place,
                "declare another one",
            )
        for it in value if isinstance(value, list | tuple) else ():
            if isinstance(it, Part) and not it.name:
                raise ProgramError(
                    f"this {it.kind} is in the list `{name}`, and has no name of its own",
                    it.place,
                    "assign it to a name in the class; several ports of one name are a multiport:"
                    " hprm.Input(int, width=2)",
                )
    for part in cls._hprm_parts_.values():
        _check_mode(cls, getattr(part, "mode", None), part.place)


def _check_mode(cls: type[Reactor], mode: Mode | None, place: Place) -> None:
    if mode is not None and not isinstance(cls._hprm_parts_.get(mode.name), Mode):
        raise ProgramError(
            f"the mode {mode.name or '?'} that `mode` names is not of {cls.__name__}",
            place,
            "declare it in this class, or in one that it extends",
        )


def bodies(cls: type[Reactor], reaction: Reaction) -> Iterator[FunctionType]:
    """Return the body of a reaction, and its deadline and tardy handlers, if it has them."""
    # For mypy, a function in a tuple is a method of it.
    yield cast(FunctionType, reaction.function)
    for handler in (reaction.late, reaction.tardy):
        function = handler_of(cls, reaction, handler)
        if function is not None:
            yield function


def handler_of(cls: type[Reactor], reaction: Reaction, handler: Any) -> FunctionType | None:
    """Return the function of a handler, which a reaction may name; none if there is none."""
    if isinstance(handler, str):
        found = inspect.getattr_static(cls, handler, None)
        if not isinstance(found, FunctionType):
            raise ProgramError(
                f"{cls.__name__} has no method `{handler}`, which reaction {reaction.name} names",
                reaction.place,
                f"write `def {handler}(self) -> None:` in {cls.__name__}",
            )
        return found
    return handler if isinstance(handler, FunctionType) else None


def _check_function(reaction: Reaction) -> None:
    function = reaction.function
    try:
        inspect.signature(function).bind(None)
    except TypeError:
        raise ProgramError(
            f"reaction {reaction.name} must have one parameter, `self`",
            reaction.place,
            "it reads and sets ports as attributes: self.image.value, self.boxes.set(...)",
        ) from None
    if inspect.isgeneratorfunction(function) or inspect.isasyncgenfunction(function):
        raise ProgramError(
            "`yield` makes a generator of this body, which then never runs",
            reaction.place,
            code=_findings.SYNTAX,
        )


def _check_part(cls: type[Reactor], reaction: Reaction, named: Any) -> None:
    """Refuse what is no part of the class, where the reaction names it."""
    part = named.mode if isinstance(named, History) else named
    if isinstance(part, Part):
        if part.name in cls._hprm_parts_ and type(cls._hprm_parts_[part.name]) is type(part):
            return
        raise ProgramError(
            f"the {part.kind} {part.name or '?'} that reaction {reaction.name} names is not of"
            f" {cls.__name__}",
            reaction.place,
            "name a part of the class; a port of a contained reactor is a function:"
            " lambda self: self.camera.image",
        )
    if not isinstance(part, Event) and not callable(part):
        raise ProgramError(
            f"reaction {reaction.name} names {part!r}, which is no part of a reactor",
            reaction.place,
            "name an input, an action, a timer, hprm.startup, or another part of the class",
        )


class _Use(NamedTuple):
    """A place in a body where an attribute of ``self`` is used, and for what."""

    name: str
    #: The attribute that is used of it in turn, or an empty text.
    of_it: str
    assigns: bool
    #: Whether that attribute is assigned.
    assigns_of_it: bool
    node: ast.Attribute
    path: str

    @property
    def where(self) -> tuple[str, int, int]:
        """Its place, to sort by."""
        return (self.path, self.node.lineno, self.node.col_offset)


def _check_uses(cls: type[Reactor], reaction: Reaction, body: FunctionType) -> None:
    """Refuse a body that uses a part which its reaction does not declare."""
    read = {part.name for part in (*reaction.triggers, *reaction.sources) if _is_part(part)}
    effects = [it.mode if isinstance(it, History) else it for it in reaction.effects]
    written = {part.name for part in effects if _is_part(part)}
    missing: dict[str, tuple[_Use, Part, str]] = {}
    for use in sorted(_uses(cls, body, set()), key=lambda it: it.where):
        part = cls._hprm_parts_.get(use.name)
        if part is None or part.kind == "timer":
            continue
        if use.assigns or (use.assigns_of_it and use.of_it == "value"):
            _refuse_assignment(use, part)
        argument = _missing(part, use, read, written)
        if argument is not None:
            missing.setdefault(part.name, (use, part, argument))
    if missing:
        first = next(iter(missing.values()))[0]
        *others, last = (f"the {part.kind} `{name}`" for name, (_, part, _) in missing.items())
        names = f"{', '.join(others)} and {last}" if others else last
        raise ProgramError(
            f"reaction {reaction.name} uses {names}, which it does not declare",
            _place(first),
            f"write @hprm.reaction(..., {_arguments(missing)})",
            _findings.UNNAMED,
        )


def _arguments(missing: dict[str, tuple[_Use, Part, str]]) -> str:
    """Return the arguments that declare these parts."""
    lists: dict[str, list[str]] = {}
    for name, (_, _, argument) in missing.items():
        lists.setdefault(argument, []).append(name)
    return ", ".join(f"{argument}=[{', '.join(names)}]" for argument, names in lists.items())


def _is_part(named: object) -> bool:
    return isinstance(named, Part)


def _missing(part: Part, use: _Use, read: set[str], written: set[str]) -> str | None:
    """Return as what the reaction has to declare the part, if it does not."""
    match part.kind:
        case "input":
            return None if part.name in read else "sources"
        case "output" | "mode":
            return None if part.name in written else "effects"
    if use.of_it == "schedule":
        is_physical = getattr(part, "physical", False)
        return None if is_physical or part.name in written else "effects"
    return None if part.name in read | written else "sources"


def _refuse_assignment(use: _Use, part: Part) -> None:
    instead = {
        "output": f"self.{part.name}.set(...)",
        "action": f"self.{part.name}.schedule(...)",
        "mode": f"self.{part.name}.enter()",
    }
    raise ProgramError(
        f"the {part.kind} `{use.name}` cannot be assigned",
        _place(use),
        f"write {instead[part.kind]}" if part.kind in instead else "give the variable another name",
        _findings.REFUSED,
    )


def _place(use: _Use) -> Place:
    node = use.node
    same = node.end_lineno == node.lineno and node.end_col_offset is not None
    return Place(use.path, node.lineno, node.col_offset, node.end_col_offset if same else -1)  # type: ignore[arg-type]


def _uses(cls: type[Reactor], body: FunctionType, seen: set[FunctionType]) -> Iterator[_Use]:
    """Find the attributes of ``self`` that a body uses, and the methods that it calls in turn."""
    body = cast(FunctionType, inspect.unwrap(body))
    if body in seen:
        return
    seen.add(body)
    tree = _trees.of(body)
    if tree is None or not tree.args.args:
        return
    me, path = tree.args.args[0].arg, body.__code__.co_filename
    nodes = list(_trees.nodes(tree, me))
    parents = {child: node for node in nodes for child in ast.iter_child_nodes(node)}
    for node in nodes:
        match node:
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if name == me:
                method = inspect.getattr_static(cls, attribute, None)
                if isinstance(method, FunctionType) and not hasattr(method, MARK):
                    yield from _uses(cls, method, seen)
                above = parents.get(node)
                of_it = above.attr if isinstance(above, ast.Attribute) else ""
                assigns = isinstance(node.ctx, ast.Store | ast.Del)
                inner = isinstance(above, ast.Attribute) and not isinstance(above.ctx, ast.Load)
                yield _Use(attribute, of_it, assigns, inner, node, path)
