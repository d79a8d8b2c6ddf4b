"""A program as the front end describes it, before any of its Python has run."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any, NamedTuple
else:
    from hprm._records import NamedTuple


class Code(NamedTuple):
    """A piece of Python at the left margin, and where it was."""

    text: str
    path: str
    line: int
    column: int


class Parameter(NamedTuple):
    """A value that is that of a parameter."""

    name: str


class ReactionSource(NamedTuple):
    """The bodies of a reaction; the arguments come after ``self``.

    ``kinds`` says of each argument what it is: the kind of a part (see ``ClassSource``), ``source``
    for an input that does not trigger, ``mutable`` for one that is copied. ``contained`` has the
    ports of contained reactors that the reaction names, as ``instance.port``.
    """

    arguments: list[str]
    kinds: list[str]
    contained: list[str]
    body: Code
    deadline: Code | None
    tardy: Code | None


class ClassSource(NamedTuple):
    """A reactor. Values are Python's, ``Code``, ``Parameter``, or lists and tuples of them.

    A method has a name, arguments after ``self``, defaults for the last of them, and a body. A part
    has a name, a kind (``input``, ``output``, ``action``, ``timer``, ``mode``, ``instance`` or
    ``bank``), and if it is one of the last two, its class and the ports of that with their kinds.
    """

    name: str
    preambles: list[Code]
    parameters: list[tuple[str, Any]]
    state: list[tuple[str, Any]]
    methods: list[tuple[str, list[str], list[Any], Code]]
    reactions: list[ReactionSource]
    parts: list[tuple[str, str, tuple[str, list[tuple[str, str]]] | None]]


class InstanceSource(NamedTuple):
    """An instance of a reactor; ``cls`` is an index into the program's classes."""

    reactor: int
    parent: int | None
    cls: int
    name: str
    bank_index: int | None
    assignments: list[tuple[str, Any]]


class ProgramSource(NamedTuple):
    """A program; of its instances, those that run here, containers before their contents.

    ``uses`` and ``protobufs`` are paths, each with the file that states it.
    """

    name: str
    path: str
    files: dict[str, str]
    uses: list[tuple[str, str]]
    protobufs: list[tuple[str, str]]
    tracing: bool
    preambles: list[Code]
    classes: list[ClassSource]
    instances: list[InstanceSource]
