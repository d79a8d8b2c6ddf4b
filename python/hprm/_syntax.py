"""Mistakes in the Python of programs, found without running any of it."""

import json
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from hprm import _compile, _hprm
from hprm._source import ClassSource, Code, ProgramSource

Check = Callable[[Code], object]


def report(paths: list[str]) -> None:
    """Print the mistakes of programs, each as a line of JSON."""
    warnings.simplefilter("ignore")
    # Programs may share files.
    known: dict[Code, SyntaxError | None] = {}
    for path in paths:
        source = _hprm.describe_program(path, all=True)
        _compile.register(source.files)
        for code, check in _pieces(source):
            if code not in known:
                known[code] = _mistake(code, check)
            error = known[code]
            if error is not None:
                place = {"file": error.filename, "line": error.lineno, "column": error.offset}
                print(json.dumps({"program": path, "message": error.msg, **place}))


def _mistake(code: Code, check: Check) -> SyntaxError | None:
    try:
        check(code)
    except SyntaxError as error:
        return error
    except (ValueError, OverflowError, RecursionError, MemoryError) as error:
        # What the compiler itself cannot take: a zero in the text, or too deep a nesting.
        message = f"Python cannot compile this: {error or type(error).__name__}"
        return SyntaxError(message, (code.path, code.line, code.column + 1, None))
    return None


def _pieces(source: ProgramSource) -> Iterator[tuple[Code, Check]]:
    """Find all Python in a program, each with what compiles it as when the program is run."""
    yield from ((code, _preamble) for code in source.preambles)
    for cls in source.classes:
        yield from _class_pieces(cls)
    for instance in source.instances:
        yield from _expressions([value for _, value in instance.assignments])


def _class_pieces(cls: ClassSource) -> Iterator[tuple[Code, Check]]:
    yield from ((code, _preamble) for code in cls.preambles)
    yield from _expressions([value for _, value in [*cls.parameters, *cls.state]])
    for name, arguments, defaults, code in cls.methods:
        yield from _expressions(defaults)
        yield code, partial(_method, name, arguments)
    for reaction in cls.reactions:
        for handler in (reaction.body, reaction.deadline, reaction.tardy):
            if handler is not None:
                yield handler, partial(_body, reaction.arguments)


def _expressions(value: Any) -> Iterator[tuple[Code, Check]]:
    match value:
        case Code():
            yield value, _expression
        case list() | tuple():
            for entry in value:
                yield from _expressions(entry)


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
