"""The syntax trees of functions, as far as their text is known."""

from __future__ import annotations

import ast
import linecache
from collections.abc import Iterator
from functools import lru_cache
from types import FunctionType


def nodes(tree: ast.AST, me: str) -> Iterator[ast.AST]:
    """Find all nodes of a function, but those of functions inside that have another ``self``."""
    pending = list(ast.iter_child_nodes(tree))
    while pending:
        node = pending.pop()
        match node:
            case (
                ast.FunctionDef(args=inner)
                | ast.AsyncFunctionDef(args=inner)
                | ast.Lambda(args=inner)
            ):
                if any(argument.arg == me for argument in inner.args):
                    continue
        yield node
        pending.extend(ast.iter_child_nodes(node))


def of(function: FunctionType) -> ast.FunctionDef | ast.AsyncFunctionDef | None:
    """Return the tree of a function; none if its text is not known, as of ``python -c``."""
    code = function.__code__
    text = "".join(linecache.getlines(code.co_filename))
    return _functions(text).get((code.co_name, code.co_firstlineno)) if text else None


@lru_cache(maxsize=64)
def _functions(
    text: str,
) -> dict[tuple[str, int], ast.FunctionDef | ast.AsyncFunctionDef]:
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):
        return {}
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = [decorator.lineno for decorator in node.decorator_list]
            found[node.name, min([node.lineno, *lines])] = node
    return found
