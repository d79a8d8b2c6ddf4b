"""Finds names and attributes in bodies that cannot be right, without running any body.

``hprm check`` has this module check whole programs. Before a program runs, ``hprm._suspects`` has
it check only the bodies whose compiled code looks suspicious, and refuses only what is certainly
wrong.
"""

import ast
import builtins
import linecache
import re
from collections.abc import Callable, Container, Iterator
from functools import cache

from hprm import _compile, _findings, _lf, _main, _names, _scopes
from hprm._classes import ReactorBase
from hprm._findings import Finding
from hprm._hprm import action_capsule_t, port_capsule
from hprm._source import ClassSource, Code, ProgramSource, ReactionSource

# Code with these words may define names that its text does not show.
_UNCERTAIN = re.compile(r"\b(globals|exec|vars|__main__|__dict__)\b|\bimport\s+\*")

# Names that Python itself defines.
_GIVEN = frozenset(dir(builtins)) | {
    *("__name__", "__file__", "__spec__", "__doc__", "__builtins__", "__package__"),
    *("__class__", "__annotations__", "__loader__", "__path__"),
}


class Module:
    """The names that all bodies of a program see."""

    def __init__(self, source: ProgramSource) -> None:
        """Collect the names that preambles define, and the global ones that bodies assign."""
        texts = [code.text for code in _all_code(source)]
        self.is_certain = not any(_UNCERTAIN.search(text) for text in texts)
        self.names = set(_GIVEN | _main.NAMES | {f"_{cls.name}" for cls in source.classes})
        paths = [path for path, _ in source.protobufs]
        self.names |= {re.sub(r".*/|\.proto$", "", path) + "_pb2" for path in paths}
        for code in source.preambles:
            names, defined = _scopes.of_preamble(code, in_class=False)
            self.names |= names.made | defined
        globals_ = [code for code in _all_code(source) if "global " in code.text]
        for code in globals_:
            self.names |= {
                name.strip()
                for line in re.findall(r"\bglobal ([^\n;#]*)", code.text)
                for name in line.split(",")
            }
        # Attributes that some code assigns to any object; and strings, which may be for `setattr`.
        self.attributes = {
            name for code in _all_code(source) for name in _possible_attributes(code)
        }


def _possible_attributes(code: Code) -> Iterator[str]:
    for node in ast.walk(_compile.parsed(code)):
        match node:
            case ast.Attribute(attr=name, ctx=ast.Store()):
                yield name
            case ast.Constant(value=str(name)) if name.isidentifier():
                yield name


def preamble(code: Code, module: Module, cls: ClassSource | None) -> Iterator[Finding]:
    """Check a preamble: of reactor class ``cls``, or of a file."""
    names, _ = _scopes.of_preamble(code, in_class=cls is not None)
    yield from _undefined(code, _compile.parsed(code), names.free - module.names, module)


def expression(code: Code, module: Module, cls: ClassSource | None) -> Iterator[Finding]:
    """Check an expression: in reactor class ``cls``, or outside of all classes."""
    names = _scopes.of_expression(code)
    tree = _compile.parsed_expression(code)
    unknown = names.free - module.names
    if cls is not None:
        yield from _unnamed(code, tree, (unknown, module), lambda n, _: _reactor_hint(cls, None, n))
        unknown -= {name for name in unknown if _reactor_hint(cls, None, name)}
    yield from _undefined(code, tree, unknown, module)


def method(code: Code, arguments: list[str], module: Module, cls: ClassSource) -> Iterator[Finding]:
    """Check a method."""
    yield from _function(code, (arguments, None), module, cls)


def body(
    code: Code, reaction: ReactionSource, module: Module, cls: ClassSource
) -> Iterator[Finding]:
    """Check a body of a reaction."""
    yield from _function(code, (reaction.arguments, reaction), module, cls)


def refuse(code: Code, reaction: ReactionSource, cls: ClassSource, known: Container[str]) -> None:
    """Raise a ``SyntaxError`` if a body uses a part that its reaction does not name.

    The error has the place and a hint. A part may have the same name as something in the module:
    ``known`` are the names of the module.
    """
    unknown = _scopes.of_function(reaction.arguments, code).free
    tree = _compile.parsed(code)

    def hint_for(name: str, port: str) -> str | None:
        return _reactor_hint(cls, reaction, name, port)

    for name in sorted(name for name in unknown if name not in known and name not in _GIVEN):
        for found in _one_unnamed(code, tree, (name, "error"), hint_for):
            text = linecache.getline(found.file, found.line)
            error = SyntaxError(found.message, (found.file, found.line, found.column, text))
            error.hint = found.hint  # type: ignore[attr-defined]
            error.diagnostic = found.code  # type: ignore[attr-defined]
            raise error


def _function(
    code: Code,
    called: tuple[list[str], ReactionSource | None],
    module: Module,
    cls: ClassSource,
) -> Iterator[Finding]:
    arguments, reaction = called
    names = _scopes.of_function(arguments, code)
    tree = _compile.parsed(code)
    unknown = names.free - module.names

    def hint_for(name: str, port: str) -> str | None:
        return _reactor_hint(cls, reaction, name, port)

    yield from _unnamed(code, tree, (unknown, module), hint_for)
    unknown -= {name for name in unknown if hint_for(name, "")}
    yield from _undefined(code, tree, unknown, module)
    yield from _hidden(code, tree, names, (cls, reaction))
    yield from _assigned(code, tree, names, (cls, reaction))
    kinds = {} if reaction is None else dict(zip(reaction.arguments, reaction.kinds, strict=True))
    bound = _bound(tree)
    kinds = {name: kind for name, kind in kinds.items() if name not in bound}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            yield from _attribute(code, node, (kinds, reaction), (module, cls))
        elif isinstance(node, ast.Call):
            yield from _call(code, node, kinds)


def _reactor_hint(
    cls: ClassSource, reaction: ReactionSource | None, name: str, port: str = ""
) -> str | None:
    """Return what to write instead, if ``name`` is something of the reactor."""
    if name in _preamble_names(cls):
        return f"`{name}` is defined in a preamble of this reactor: write `self.{name}`"
    return _names.of_reactor(name, cls, reaction, port)


def _preamble_names(cls: ClassSource) -> set[str]:
    return {name for code in cls.preambles for name in _defined(code)}


@cache
def _defined(code: Code) -> frozenset[str]:
    return frozenset(_scopes.of_preamble(code, in_class=True)[1])


# The hint for a name, and for the attribute that the body uses of it.
HintFor = Callable[[str, str], str | None]


def _unnamed(
    code: Code, tree: ast.AST, which: tuple[set[str], Module], hint_for: HintFor
) -> Iterator[Finding]:
    """Find the parts that a body uses although its reaction does not name them."""
    unknown, module = which
    severity = "error" if module.is_certain else "warning"
    for name in sorted(unknown):
        yield from _one_unnamed(code, tree, (name, severity), hint_for)


def _one_unnamed(
    code: Code, tree: ast.AST, which: tuple[str, str], hint_for: HintFor
) -> Iterator[Finding]:
    name, severity = which
    node = _findings.first(tree, name)
    if node is None:
        return
    attribute = next((a.attr for a in _attributes_of(tree, name)), "")
    hint = hint_for(name, attribute)
    if hint is not None:
        message = f"`{name}` is not defined in this body"
        yield _findings.at(node, code, (_findings.UNNAMED, severity, message, hint))


def _attributes_of(tree: ast.AST, name: str) -> Iterator[ast.Attribute]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            value = node.value
            if isinstance(value, ast.Subscript):
                value = value.value
            if isinstance(value, ast.Name) and value.id == name:
                yield node


def _undefined(code: Code, tree: ast.AST, names: set[str], module: Module) -> Iterator[Finding]:
    if not module.is_certain:
        return
    for name in sorted(names):
        node = _findings.first(tree, name)
        if node is not None:
            hint = _names.elsewhere(name, module.names - _GIVEN)
            what = (_findings.UNDEFINED, "warning", f"`{name}` is not defined", hint)
            yield _findings.at(node, code, what)


def _hidden(
    code: Code,
    tree: ast.AST,
    names: _scopes.Names,
    where: tuple[ClassSource, ReactionSource | None],
) -> Iterator[Finding]:
    """Find uses of a part that is not named, and whose name is that of a built-in function."""
    cls, reaction = where
    parts = {name for name, kind, _ in cls.parts if kind in ("input", "output", "action")}
    for name in sorted(names.free & parts & set(dir(builtins))):
        for node in _attributes_of(tree, name):
            if node.attr in ("set", "schedule", "value", "is_present"):
                message = f"`{name}` is Python's own in this body"
                hint = _reactor_hint(cls, reaction, name)
                yield _findings.at(node, code, (_findings.UNNAMED, "error", message, hint))
                break


def _assigned(
    code: Code,
    tree: ast.AST,
    names: _scopes.Names,
    where: tuple[ClassSource, ReactionSource | None],
) -> Iterator[Finding]:
    """Find assignments that make a local variable with the name of a state variable or output."""
    cls, reaction = where
    kinds = {} if reaction is None else dict(zip(reaction.arguments, reaction.kinds, strict=True))
    state = {name for name, _ in cls.state}
    outputs = {name for name, kind, _ in cls.parts if kind == "output"}
    outputs |= {name for name, kind in kinds.items() if kind == "output"}
    for node in ast.walk(tree):
        targets = getattr(node, "targets", None) or [getattr(node, "target", None)]
        if not isinstance(node, ast.Assign | ast.AugAssign | ast.AnnAssign):
            continue
        for target in targets:
            if not isinstance(target, ast.Name):
                continue
            name = target.id
            reads = isinstance(node, ast.AugAssign) or (
                node.value is not None and _findings.first(node.value, name) is not None
            )
            first = _findings.first(tree, name)
            if name in state and name in names.local and reads and first is not None:
                if (first.lineno, first.col_offset) >= (node.lineno, node.col_offset):
                    message = f"`{name}` has no value yet: it is a variable of this body"
                    hint = f"`{name}` is a state variable of this reactor: write `self.{name}`"
                    yield _findings.at(target, code, (_findings.UNNAMED, "error", message, hint))
            elif name in outputs and not reads and (name in kinds or name in names.unread):
                message = f"this gives the name `{name}` another meaning, and sets no port"
                hint = f"write `{name}.set(value)`"
                if name not in kinds:
                    hint += f", and add `-> {name}` to the reaction"
                yield _findings.at(target, code, (_findings.NOT_SET, "warning", message, hint))
            elif name in state and name in names.unread:
                message = f"this assigns a variable of this body, which nothing reads: `{name}`"
                hint = f"`{name}` is a state variable of this reactor: write `self.{name}`"
                yield _findings.at(target, code, (_findings.NOT_SET, "warning", message, hint))


def _bound(tree: ast.AST) -> set[str]:
    """Find the names that a piece of code binds, so that they may not be arguments any more."""
    bound: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()):
                bound.add(name)
            case ast.arg(arg=name) | ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                bound.add(name)
            case ast.alias(name=name, asname=other):
                bound.add(other or name.partition(".")[0])
            case ast.ExceptHandler(name=str(name)) | ast.MatchAs(name=str(name)):
                bound.add(name)
    return bound


_PORT = frozenset(dir(port_capsule))
_ACTION = frozenset(dir(action_capsule_t))
_OWN = frozenset(dir(ReactorBase))


def _attribute(
    code: Code,
    node: ast.Attribute,
    what: tuple[dict[str, str], ReactionSource | None],
    where: tuple[Module, ClassSource],
) -> Iterator[Finding]:
    kinds, reaction = what
    match node.value:
        case ast.Name(id="self"):
            yield from _of_self(code, node, reaction, where)
        case ast.Name(id="lf") if node.attr not in _lf.NAMES:
            hint = _names.did_you_mean(node.attr, _lf.NAMES)
            if node.attr.removeprefix("time_") in _lf.TIMES:
                hint = f"did you mean `lf.time.{node.attr.removeprefix('time_')}`?"
            message = f"the module `lf` has no `{node.attr}`"
            yield _findings.at(node, code, (_findings.ATTRIBUTE, "error", message, hint))
        case ast.Attribute(value=ast.Name(id="lf"), attr="time") if node.attr not in _lf.TIMES:
            hint = _names.did_you_mean(node.attr, _lf.TIMES)
            hint = hint or "it has " + ", ".join(f"`{name}`" for name in sorted(_lf.TIMES))
            message = f"`lf.time` has no `{node.attr}`"
            yield _findings.at(node, code, (_findings.ATTRIBUTE, "error", message, hint))
        case ast.Name(id=name) if name in kinds and reaction is not None:
            yield from _of_argument(code, node, (name, kinds[name]), (reaction, where[1]))


def _of_self(
    code: Code,
    node: ast.Attribute,
    reaction: ReactionSource | None,
    where: tuple[Module, ClassSource],
) -> Iterator[Finding]:
    module, cls = where
    name = node.attr
    if isinstance(node.ctx, ast.Store):
        if name in {parameter for parameter, _ in cls.parameters}:
            message = f"the parameter `{name}` cannot be assigned"
            hint = f"keep what changes in a state variable: `state current_{name} = {name}`"
            yield _findings.at(node, code, (_findings.REFUSED, "error", message, hint))
        return
    known = {name for name, _ in [*cls.parameters, *cls.state]} | _preamble_names(cls)
    known |= {method[0] for method in cls.methods}
    if name in known or name in _OWN or name in module.attributes or name.startswith("__"):
        return
    part = next((kind for part, kind, _ in cls.parts if part == name), None)
    if part is not None and part != "timer":
        message = f"`self` has no `{name}`"
        hint = f"write `{name}`: a body gets what its reaction names"
        if reaction is None:
            hint = _names.of_reactor(name, cls, None) or hint
        elif name not in reaction.arguments:
            hint = f"write `{name}`; " + (_names.of_reactor(name, cls, reaction) or "")
        yield _findings.at(node, code, (_findings.ATTRIBUTE, "error", message, hint))
        return
    like = _names.did_you_mean(name, known | module.attributes)
    if like is not None:
        what = (_findings.ATTRIBUTE, "warning", f"`self` has no `{name}`", like)
        yield _findings.at(node, code, what)


def _of_argument(
    code: Code,
    node: ast.Attribute,
    argument: tuple[str, str],
    where: tuple[ReactionSource, ClassSource],
) -> Iterator[Finding]:
    (name, kind), (reaction, cls) = argument, where
    if kind in ("input", "source", "output"):
        yield from _of_port(code, node, name, kind)
    elif kind == "action" and node.attr not in _ACTION:
        hint = _names.did_you_mean(node.attr, _ACTION)
        if node.attr == "set":
            hint = f"an action is scheduled: `{name}.schedule(0, value)`"
        hint = hint or f"the value of the action is `{name}.value`"
        message = f"an action has no `{node.attr}`"
        yield _findings.at(node, code, (_findings.ATTRIBUTE, "error", message, hint))
    elif kind == "instance":
        contained = next((more for part, _, more in cls.parts if part == name), None)
        if contained is None or f"{name}.{node.attr}" in reaction.contained:
            return
        found = dict(contained[1]).get(node.attr)
        if found is None:
            message = f"`{contained[0]}` has no port `{node.attr}`"
            hint = _names.missing_port(name, node.attr, contained)
            yield _findings.at(node, code, (_findings.ATTRIBUTE, "error", message, hint))
        else:
            message = f"this reaction does not name `{name}.{node.attr}`"
            hint = _names.contained_port(name, node.attr, found)
            yield _findings.at(node, code, (_findings.UNNAMED, "error", message, hint))


def _of_port(code: Code, node: ast.Attribute, name: str, kind: str) -> Iterator[Finding]:
    if node.attr not in _PORT:
        message = f"a port has no `{node.attr}`"
        hint = _names.did_you_mean(node.attr, _PORT)
        if kind == "output":
            hint = hint or f"a port is set by its method: `{name}.set(value)`"
        hint = hint or f"`{name}` is the port, and its value is `{name}.value`"
        yield _findings.at(node, code, (_findings.ATTRIBUTE, "error", message, hint))
    elif isinstance(node.ctx, ast.Store) and node.attr == "value":
        message = "a port cannot be set by an assignment"
        hint = f"write `{name}.set(value)`"
        if kind != "output":
            hint = f"`{name}` is an input, and only its sender sets it"
        yield _findings.at(node, code, (_findings.REFUSED, "error", message, hint))


def _call(code: Code, node: ast.Call, kinds: dict[str, str]) -> Iterator[Finding]:
    match node.func:
        case ast.Attribute(value=ast.Name(id=name), attr="set") if kinds.get(name) == "input":
            message = f"`{name}` cannot be set here: this reaction reads it"
            hint = "a reaction sets the outputs of its reactor, and inputs of contained ones"
            yield _findings.at(node.func, code, (_findings.REFUSED, "error", message, hint))


def _all_code(source: ProgramSource) -> Iterator[Code]:
    yield from source.preambles
    for cls in source.classes:
        yield from cls.preambles
        yield from (method[3] for method in cls.methods)
        for reaction in cls.reactions:
            handlers = (reaction.body, reaction.deadline, reaction.tardy)
            yield from (code for code in handlers if code is not None)
