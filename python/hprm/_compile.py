"""Compiling the Python in a program, so that tracebacks show the lines of the ``.lf`` file.

Text is parsed where it stands at the left margin, and the tree is moved to where it came from.
"""

import ast
import linecache
import re
from collections.abc import Callable, Iterator
from types import CodeType
from typing import Any

from hprm._source import Code

Namespace = dict[str, Any]

# A time as the language writes it, which Python does not understand.
_TIME = re.compile(r"\b\d+ ?(?:[num]?s|[num]?secs?|seconds?|min|minutes?|hours?)\b")


def register(files: dict[str, str]) -> None:
    """Let tracebacks show lines of these files, whatever becomes of them on disk."""
    for path, text in files.items():
        linecache.cache[path] = (len(text), None, text.splitlines(keepends=True), path)


def statements(code: Code) -> CodeType:
    """Compile a preamble."""
    return _compiled(parsed(code), code)


def function(
    code: Code, name: str, arguments: list[str], namespace: Namespace
) -> Callable[..., Any]:
    """Make a function with that body."""
    return _function(code, name, arguments, parsed(code).body, namespace)


def body(code: Code, name: str, arguments: list[str], namespace: Namespace) -> Callable[..., Any]:
    """Make a function that runs to its end when it is called, which a generator does not."""
    tree = parsed(code)
    for node in _own_nodes(tree):
        if isinstance(node, ast.Yield | ast.YieldFrom):
            text = linecache.getline(code.path, node.lineno)
            where = (code.path, node.lineno, node.col_offset + 1, text)
            raise SyntaxError(
                "`yield` makes a generator of this body, which then never runs", where
            )
    return _function(code, name, arguments, tree.body, namespace)


def expression(code: Code, namespace: Namespace) -> Callable[..., Any]:
    """Make a function of ``self`` and ``bank_index`` that evaluates an expression."""
    match parsed_expression(code).body:
        case [ast.Expr(value)]:
            returned = ast.copy_location(ast.Return(value), value)
            return _function(code, "value", ["self", "bank_index"], [returned], namespace)
    raise _located(SyntaxError("a value must be an expression"), code)


def _function(
    code: Code, name: str, arguments: list[str], body: list[ast.stmt], namespace: Namespace
) -> Callable[..., Any]:
    # What a template has besides its body differs from one version of Python to the next.
    tree = ast.parse(f"def {name}({', '.join(arguments)}): pass")
    for node in _located_nodes(tree):
        node.lineno = node.end_lineno = code.line
        node.col_offset = node.end_col_offset = 0
    definition = tree.body[0]
    assert isinstance(definition, ast.FunctionDef)
    definition.body = body or definition.body
    made: dict[str, Callable[..., Any]] = {}
    exec(_compiled(tree, code), namespace, made)
    return made[name]


def parsed(code: Code, original: Code | None = None) -> ast.Module:
    """Parse a piece, and move the tree to where the piece came from."""
    original = original or code
    try:
        tree = ast.parse(code.text, code.path)
    except SyntaxError as error:
        raise _located(error, original) from None
    except (ValueError, OverflowError, RecursionError, MemoryError) as error:
        raise _refused(error, original) from None
    shifts = _shifts(code)
    for node in _located_nodes(tree):
        node.col_offset += shifts(node.lineno)
        node.end_col_offset += shifts(node.end_lineno)
        node.lineno += code.line - 1
        node.end_lineno += code.line - 1
    return tree


def parsed_expression(code: Code) -> ast.Module:
    """Parse a value."""
    # Parentheses let it span lines, and the newline ends a comment behind it.
    wrapped = code._replace(text=f"({code.text}\n)", column=code.column - 1)
    return parsed(wrapped, original=code)


def _refused(error: Exception, code: Code) -> SyntaxError:
    """Say what the compiler cannot take; it says that in few words, and without a place."""
    reason = str(error).strip()
    hint = None
    if "null byte" in reason:
        reason = "there is a null byte in it"
    elif isinstance(error, RecursionError | MemoryError):
        reason = "its expressions or blocks are nested too deeply"
        hint = "assign parts of it to variables"
    message = f"Python cannot compile this: {reason or type(error).__name__}"
    place = (code.path, code.line, code.column + 1, linecache.getline(code.path, code.line))
    refused = SyntaxError(message, place)
    refused.hint = hint  # type: ignore[attr-defined]
    return refused


def _located_nodes(tree: ast.AST) -> Iterator[Any]:
    return (node for node in ast.walk(tree) if hasattr(node, "lineno"))


def _own_nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """Find what belongs to no function inside."""
    pending = [tree]
    while pending:
        node = pending.pop()
        yield node
        inner = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
        pending.extend(
            child for child in ast.iter_child_nodes(node) if not isinstance(child, inner)
        )


def _compiled(tree: ast.Module, code: Code) -> CodeType:
    try:
        return compile(tree, code.path, "exec", dont_inherit=True)
    except SyntaxError as error:
        # Its line is that of the file already.
        error.text = linecache.getline(code.path, error.lineno or code.line)
        raise
    except (ValueError, OverflowError, RecursionError, MemoryError) as error:
        raise _refused(error, code) from None


def _shifts(code: Code) -> Callable[[int], int]:
    """Find by how many bytes each line of the text has moved."""
    moved = [code.column]
    for number, line in enumerate(code.text.split("\n")[1:], start=code.line + 1):
        original = linecache.getline(code.path, number)
        moved.append(max(original.encode().find(line.rstrip().encode()), 0))
    return lambda line: moved[line - 1] if line <= len(moved) else 0


def _located(error: SyntaxError, code: Code) -> SyntaxError:
    """Move an error that was found in the text to its place in the file."""
    line = min(error.lineno or 1, code.text.count("\n") + 1)
    shift = _shifts(code)(line)
    beside = b"{=" in linecache.getline(code.path, code.line).encode()[: code.column]
    if line > 1 and beside and error.msg == "unexpected indent":
        error.msg += ": the first line stands beside `{=`; put it on a line of its own"
    # "after 'if' statement on line 1".
    error.msg = re.sub(
        r"\bon line (\d+)", lambda at: f"on line {int(at[1]) + code.line - 1}", error.msg
    )
    at = (error.offset or 1) - 1
    if any(it.start() <= at <= it.end() for it in _TIME.finditer(code.text.split("\n")[line - 1])):
        hint = (
            "in Python, a time is written as `MSEC(100)`, with one of NSEC, USEC, MSEC, SEC, MINUTE"
        )
        error.hint = hint  # type: ignore[attr-defined]
    error.filename = code.path
    error.lineno = code.line + line - 1
    error.text = linecache.getline(code.path, error.lineno)
    error.offset = (error.offset or 1) + shift
    error.end_lineno = error.end_offset = None
    return error
