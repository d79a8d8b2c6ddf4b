"""Bodies that Python runs without complaint, and that do not do what they seem to.

A value that a reaction returns goes nowhere, which is an error: found in the text of the body, or
when it has run. A coroutine that sleeps without awaiting stops all others of its federate, which
is a warning.
"""

from __future__ import annotations

import ast
import inspect
import reprlib
import time
from collections.abc import Callable, Iterator
from types import FunctionType
from typing import NoReturn, cast

from hprm import _places, _trees
from hprm._mistakes import ProgramError, warn
from hprm._parts import Output
from hprm._places import Place
from hprm._reactions import Reaction

_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.ClassDef)


def check_returns(reaction: Reaction, body: FunctionType) -> None:
    """Refuse a body that returns a value.

    What a call returns is not known. What another decorator wraps may give its value to that.
    """
    handlers = (reaction.late, reaction.tardy)
    names = {reaction.name, *(getattr(it, "__name__", it) for it in handlers)}
    tree = None if hasattr(body, "__wrapped__") else _trees.of(body)
    if tree is None or tree.name not in names:
        return
    for node in _own(tree):
        if isinstance(node, ast.Return) and _is_value(node.value):
            outputs = [part.name for part in reaction.effects if isinstance(part, Output)]
            example = f"self.{outputs[0]}.set(...)" if outputs else "self.NAME.set(...)"
            what = "reaction" if tree.name == reaction.name else "handler"
            raise ProgramError(
                f"{what} {tree.name} returns a value, which goes nowhere",
                _place(node, body),
                f"set an output: {example}; `return` alone ends the {what}",
            )


def refuse_returned(body: Callable[..., object], value: object) -> NoReturn:
    """Refuse what a body has returned when it ran."""
    function = inspect.unwrap(body)
    name = getattr(function, "__name__", "the body")
    place = None
    if isinstance(function, FunctionType):
        tree = _trees.of(function)
        place = _places.of_function(function) if tree is None else _place(tree, function)
    if inspect.iscoroutine(value):
        # It was never to run: Python need not say so, too.
        value.close()
        raise ProgramError(
            f"{name} has returned a coroutine, {value.__name__}, which nothing awaits",
            place,
            f"write async def {name}, and await self.{value.__name__}(...) in it",
        )
    raise ProgramError(
        f"{name} has returned {reprlib.repr(value)}, which goes nowhere",
        place,
        "set an output: self.NAME.set(...); `return` alone ends the body",
    )


def _is_value(value: ast.expr | None) -> bool:
    """Whether an expression has a value that is not None, whatever it calls."""
    match value:
        case None | ast.Constant(value=None) | ast.Call() | ast.Await():
            return False
        case ast.IfExp(body=one, orelse=other):
            return _is_value(one) or _is_value(other)
    return True


def check_waits(cls: type) -> None:
    """Warn about coroutines of a class that sleep without awaiting."""
    for value in list(vars(cls).values()):
        function = inspect.unwrap(value) if isinstance(value, FunctionType) else None
        if function is None or not inspect.iscoroutinefunction(function):
            continue
        function = cast(FunctionType, function)
        tree = _trees.of(function)
        for node in () if tree is None else _own(tree):
            if isinstance(node, ast.Call) and _is_sleep(node.func, function.__globals__):
                warn(
                    f"time.sleep stops all coroutines of the federate until {function.__name__}"
                    " goes on",
                    _place(node, function),
                    "write await asyncio.sleep(...)",
                )


def _is_sleep(called: ast.expr, names: dict[str, object]) -> bool:
    match called:
        case ast.Attribute(value=ast.Name(id=module), attr="sleep"):
            return names.get(module, time if module == "time" else None) is time
        case ast.Name(id=name):
            return names.get(name) is time.sleep
    return False


def _own(tree: ast.AST) -> Iterator[ast.AST]:
    """Find the nodes of a function that are not those of functions inside."""
    pending = list(ast.iter_child_nodes(tree))
    while pending:
        node = pending.pop()
        if not isinstance(node, _FUNCTIONS):
            yield node
            pending.extend(ast.iter_child_nodes(node))


def _place(node: ast.stmt | ast.expr, function: FunctionType) -> Place:
    same = node.end_lineno == node.lineno and node.end_col_offset is not None
    end = cast(int, node.end_col_offset) if same else -1
    return Place(function.__code__.co_filename, node.lineno, node.col_offset, end)
