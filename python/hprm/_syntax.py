"""Mistakes in the Python of programs, found without running any of it."""

import json
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from hprm import _compile, _findings, _hprm, _lint
from hprm._findings import Finding
from hprm._source import ClassSource, Code, ProgramSource

Check = Callable[[Code], object]
Look = Callable[[Code, _lint.Module], Iterator[Finding]]


class _Piece(NamedTuple):
    """Some Python, what compiles it as when the program is run, and what looks at its names."""

    code: Code
    check: Check
    look: Look


def report(paths: list[str]) -> None:
    """Print the mistakes of programs, each as a line of JSON."""
    warnings.simplefilter("ignore")
    for path in paths:
        source = _hprm.describe_program(path, all=True)
        _compile.register(source.files)
        said = set()
        for finding in _findings_of(source):
            # Several classes may inherit a body, and several instances have a value.
            if finding not in said:
                said.add(finding)
                print(json.dumps({"program": path, **finding._asdict()}))


def _findings_of(source: ProgramSource) -> Iterator[Finding]:
    pieces = list(_pieces(source))
    mistakes = {piece.code: error for piece in pieces if (error := _mistake(piece))}
    yield from (_findings.of_syntax_error(error, code) for code, error in mistakes.items())
    if not mistakes:
        module = _lint.Module(source)
        for piece in pieces:
            yield from piece.look(piece.code, module)


def _mistake(piece: _Piece) -> SyntaxError | None:
    try:
        piece.check(piece.code)
    except SyntaxError as error:
        return error
    return None


def _pieces(source: ProgramSource) -> Iterator[_Piece]:
    """Find all Python in a program."""
    for code in source.preambles:
        yield _Piece(code, _preamble, partial(_lint.preamble, cls=None))
    for cls in source.classes:
        yield from _class_pieces(cls)
    for instance in source.instances:
        # The container gives these their meaning.
        yield from _expressions([value for _, value in instance.assignments], None)


def _class_pieces(cls: ClassSource) -> Iterator[_Piece]:
    for code in cls.preambles:
        yield _Piece(code, _preamble, partial(_lint.preamble, cls=cls))
    yield from _expressions([value for _, value in [*cls.parameters, *cls.state]], cls)
    for name, arguments, defaults, code in cls.methods:
        yield from _expressions(defaults, cls)
        look = partial(_lint.method, arguments=arguments, cls=cls)
        yield _Piece(code, partial(_method, name, arguments), _swapped(look))
    for reaction in cls.reactions:
        look = partial(_lint.body, reaction=reaction, cls=cls)
        for handler in (reaction.body, reaction.deadline, reaction.tardy):
            if handler is not None:
                yield _Piece(handler, partial(_body, reaction.arguments), _swapped(look))


def _swapped(look: Callable[..., Iterator[Finding]]) -> Look:
    return lambda code, module: look(code, module=module)


def _expressions(value: Any, cls: ClassSource | None) -> Iterator[_Piece]:
    match value:
        case Code():
            yield _Piece(value, _expression, partial(_lint.expression, cls=cls))
        case list() | tuple():
            for entry in value:
                yield from _expressions(entry, cls)


def _expression(code: Code) -> None:
    if not _compiles(f"({code.text}\n)", "eval"):
        _compile.expression(code, {})


def _preamble(code: Code) -> None:
    if not _compiles(code.text, "exec"):
        _compile.statements(code)


def _method(name: str, arguments: list[str], code: Code) -> None:
    if not _compiles(_as_function(arguments, code), "exec"):
        _compile.function(code, name, ["self", *arguments], {})


def _body(arguments: list[str], code: Code) -> None:
    if "yield" in code.text or not _compiles(_as_function(arguments, code), "exec"):
        _compile.body(code, "body", ["self", *arguments], {})


def _as_function(arguments: list[str], code: Code) -> str:
    text = code.text.replace("\n", "\n ")
    return f"def body({', '.join(['self', *arguments])}):\n {text}\n pass"


def _compiles(text: str, mode: str) -> bool:
    """Tell at once that a text is well. What is wrong with another one, and where, takes longer."""
    try:
        compile(text, "", mode, dont_inherit=True)
    except (SyntaxError, ValueError, OverflowError, RecursionError, MemoryError):
        return False
    return True
