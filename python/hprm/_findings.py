"""What can be wrong with the Python of a program, as data: a code, a place, a message, a hint."""

from __future__ import annotations

import linecache

from hprm._source import Code

TYPE_CHECKING = False
if TYPE_CHECKING:
    import ast
    from typing import Any, NamedTuple
else:
    from hprm._records import NamedTuple

#: Python cannot compile it.
SYNTAX = "LF1001"
#: A name of something that the reactor has and the body does not get.
UNNAMED = "LF1003"
#: A name that nothing has.
UNDEFINED = "LF1004"
#: An attribute that a port, an action, or another thing of the runtime does not have.
ATTRIBUTE = "LF1005"
#: An assignment that sets nothing.
NOT_SET = "LF1006"
#: An assignment or a call that is refused.
REFUSED = "LF1007"

#: A declaration of a class, or of a constructor, that cannot be.
DECLARED = "LF1008"
#: What ends the loading of a program.
LOADING = "LF1009"
#: A parameter that an executable cannot be given.
NOT_GIVEN = "LF1107"
#: What is declared has a code of its own, as in files of Lingua Franca.
TAKEN, NO_MAIN, SEVERAL_MAINS = "LF0201", "LF0206", "LF0205"
NO_REACTOR, NO_TIME, NO_WIDTH = "LF0301", "LF0403", "LF0405"


class Finding(NamedTuple):
    """One thing that is wrong; lines and columns count from one, columns in characters."""

    code: str
    severity: str
    message: str
    hint: str | None
    file: str
    line: int
    column: int
    end_line: int
    end_column: int


def at(node: Any, code: Code, what: tuple[str, str, str, str | None]) -> Finding:
    """Make a finding at a node of a tree that has the lines and columns of the file."""
    line, end_line = node.lineno, node.end_lineno or node.lineno
    start = _characters(code.path, line, node.col_offset)
    end = _characters(code.path, end_line, node.end_col_offset or node.col_offset)
    return Finding(*what, code.path, line, start, end_line, end)


def of_syntax_error(error: SyntaxError, code: Code) -> Finding:
    """Make a finding of what the compiler says."""
    line, column = error.lineno or code.line, error.offset or 1
    hint = getattr(error, "hint", None)
    file = error.filename or code.path
    return Finding(SYNTAX, "error", error.msg, hint, file, line, column, line, column)


def first(tree: ast.AST, name: str) -> ast.Name | None:
    """Find where a name is used first."""
    import ast

    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id == name]
    return min(nodes, key=lambda node: (node.lineno, node.col_offset), default=None)


def _characters(path: str, line: int, offset: int) -> int:
    text = linecache.getline(path, line).encode()[:offset]
    return len(text.decode(errors="replace")) + 1
