"""Which names of a piece of Python come from outside of it."""

import symtable
from collections.abc import Iterator
from typing import NamedTuple

from hprm._source import Code


class Names(NamedTuple):
    """The names of one piece.

    ``free`` are read from the module, ``made`` are put there by ``global``; ``local`` belong to the
    outermost function, of which ``unread`` are only assigned.
    """

    free: set[str]
    made: set[str]
    local: set[str]
    unread: set[str]


def of_function(arguments: list[str], code: Code) -> Names:
    """Find the names of a body or a method."""
    text = code.text.replace("\n", "\n ")
    wrapped = f"def body({', '.join(['self', *arguments])}):\n {text}\n pass"
    table = _wrapper(wrapped, code.path)
    symbols = [symbol for symbol in table.get_symbols() if symbol.is_local()]
    local = {symbol.get_name() for symbol in symbols if not symbol.is_parameter()}
    inner = {
        symbol.get_name()
        for child in _all(table)
        for symbol in child.get_symbols()
        if symbol.is_free()
    }
    unread = {
        symbol.get_name()
        for symbol in symbols
        if symbol.is_assigned() and not symbol.is_referenced() and not symbol.is_imported()
    }
    return _names(_all(table), local, unread - inner)


def of_expression(code: Code) -> Names:
    """Find the names of a value."""
    wrapped = f"lambda self, bank_index: ({code.text}\n)"
    table = symtable.symtable(wrapped, code.path, "eval")
    return _names(_all(table), set(), set())


def of_preamble(code: Code, *, in_class: bool) -> tuple[Names, set[str]]:
    """Find the names of a preamble, and those that it defines."""
    if in_class:
        text = "class body:\n " + code.text.replace("\n", "\n ") + "\n pass"
        table = _wrapper(text, code.path)
    else:
        table = symtable.symtable(code.text, code.path, "exec")
    defined = {
        symbol.get_name()
        for symbol in table.get_symbols()
        if symbol.is_assigned() or symbol.is_imported() or symbol.is_namespace()
    }
    return _names(_all(table), set(), set()), defined


def _wrapper(text: str, path: str) -> symtable.SymbolTable:
    """Return the table of ``body``: since Python 3.14, one of its annotations is beside it."""
    children = symtable.symtable(text, path, "exec").get_children()
    return next(child for child in children if child.get_name() == "body")


def _all(table: symtable.SymbolTable) -> Iterator[symtable.SymbolTable]:
    pending = [table]
    while pending:
        here = pending.pop()
        yield here
        pending.extend(here.get_children())


def _names(tables: Iterator[symtable.SymbolTable], local: set[str], unread: set[str]) -> Names:
    free: set[str] = set()
    made: set[str] = set()
    for table in tables:
        for symbol in table.get_symbols():
            if table.get_type() == "module" and symbol.is_assigned():
                made.add(symbol.get_name())
            elif symbol.is_global() or table.get_type() == "module":
                (made if symbol.is_assigned() else free).add(symbol.get_name())
    return Names(free - made, made, local, unread)
