"""Reactors as classes: the base class, and what it makes of class bodies and constructors."""

from __future__ import annotations

import inspect
import os
from abc import ABCMeta
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, TypeVar

from hprm import _class_body, _construction, _duration, _places, _restart, _uncaught
from hprm._arguments import checked
from hprm._construction import Construction
from hprm._duration import Time
from hprm._mistakes import ProgramError, one
from hprm._namespace import Namespace
from hprm._parts import Part
from hprm._places import Place
from hprm._reactions import Reaction
from hprm._restart import Condition, Restart
from hprm._running import Running

R = TypeVar("R", bound="Reactor")

#: The deepest nesting of reactors, as in the runtime.
_DEEPEST = 200


if TYPE_CHECKING:
    # Below ABCMeta, type checkers would not check the keywords of class statements.
    _Metaclass = type
else:
    # That of abstract classes, and more: so a reactor may extend protocols, too.
    _Metaclass = type(Protocol)


class _Constructed(_Metaclass):
    """Constructors of reactors note what they make; reactors may be abstract."""

    if not TYPE_CHECKING:

        @classmethod
        def __prepare__(cls, name, bases, **keywords):
            """Return what takes the names of a class body."""
            return Namespace()

        # A reactor is no protocol: it is made and asked as an abstract class is.
        __new__ = staticmethod(ABCMeta.__new__)
        __instancecheck__ = ABCMeta.__instancecheck__
        __subclasscheck__ = ABCMeta.__subclasscheck__

        def __call__(cls, *arguments, **keywords):
            """Make a reactor, with the structure that its constructor gives it."""
            place = _places.here()
            made = cls.__new__(cls)
            try:
                bound = inspect.signature(cls.__init__).bind(made, *arguments, **keywords)
            except TypeError as error:
                raise TypeError(f"{cls.__name__}(...): {error}") from None
            bound.apply_defaults()
            given = dict(list(bound.arguments.items())[1:])
            construction = Construction(given, (arguments, keywords), place)
            outer = _construction.current()
            if outer is not None:
                construction.mode_of_container = outer.mode
            vars(made)["_hprm_"] = construction
            stack = _construction.stack()
            if len(stack) >= _DEEPEST:
                raise ProgramError(
                    f"reactors are nested more than {_DEEPEST} deep",
                    place,
                    f"if {cls.__name__} contains one of its own class, then not always: the"
                    " constructor needs a condition",
                )
            stack.append(construction)
            try:
                made.__init__(*arguments, **keywords)
                _adopt(made, construction)
            except AttributeError as error:
                # Only a program with a mistake needs the module.
                from hprm import _meant

                _meant.refuse(error, made)
                raise
            finally:
                stack.pop()
            if outer is not None:
                outer.made.append(made)
            return made


class Reactor(Running, metaclass=_Constructed):
    """A reactor: subclasses declare ports and reactions, and what they contain.

    The constructor gives a reactor its parameters and its state, and makes and connects the
    reactors that it contains. It runs in every process of a federation, so it only declares: a
    reaction to ``hprm.startup`` opens devices and loads models.

    Other Parameters
    ----------------
    timeout : Time
        The last tag of the program, as a time after its start. This and the following are keywords
        of the class statement, ``class Main(hprm.Reactor, timeout="10 s")``, and count for the main
        reactor.
    fast : bool
        Whether logical time runs ahead of the clock. Not for decentralized federations, and not for
        programs with physical actions.
    keepalive : bool
        Whether the program goes on when nothing is left to do.
    workers : int
        How many reactions that do not depend on one another may run at the same time; 0 is as many
        as there are processors.
    coordination : {"centralized", "decentralized"}
        How the federates of a federation wait for one another.
    properties : dict
        Other target properties, by their names: ``properties={"store-limit": "2 GB"}``.
    executable : str, path or list
        For a class that declares ports only: the executable that is this federate, such as one in
        Rust, relative to the file of the class; a list has arguments behind the path. The arguments
        of the constructor are its parameters.

    Raises
    ------
    ProgramError
        If the class or its constructor declares what is no program. The text says what, where and
        what to do.

    Examples
    --------
    >>> import hprm
    >>> class Greeter(hprm.Reactor):
    ...     def __init__(self, name="world"):
    ...         self.name = name
    ...
    ...     @hprm.reaction(hprm.startup)
    ...     def greet(self):
    ...         print(f"Hello, {self.name}!")
    >>> hprm.run(Greeter("robot"))
    Hello, robot!

    """

    _hprm_parts_: ClassVar[dict[str, Part]] = {}
    _hprm_reactions_: ClassVar[list[Reaction]] = []
    _hprm_properties_: ClassVar[dict[str, tuple[Any, Place]]] = {}
    #: The path of the executable that declares the rest, and the arguments that it gets.
    _hprm_executable_: ClassVar[list[str]] = []
    _hprm_place_: ClassVar[Place] = Place("<hprm>", 1)

    def __init__(self) -> None:
        """Make a reactor without parameters."""

    if not TYPE_CHECKING:

        def __rshift__(self, other):
            """Refuse to connect a reactor: it is ports that are connected."""
            from hprm._connect import connect

            connect(self, other)

        def __rrshift__(self, other):
            """Refuse to connect a reactor: it is ports that are connected."""
            from hprm._connect import connect

            connect(other, self)

    def __init_subclass__(
        cls,
        *,
        coordination: Literal["centralized", "decentralized"] | None = None,
        timeout: Time | None = None,
        fast: bool | None = None,
        keepalive: bool | None = None,
        workers: int | None = None,
        properties: Mapping[str, object] | None = None,
        executable: str | os.PathLike[str] | Sequence[str] | None = None,
        **others: object,
    ) -> None:
        """Take what the class body declares."""
        super().__init_subclass__()
        place = cls._hprm_place_ = _places.here()
        if others:
            _refuse_keyword(next(iter(others)), place)
        stated = {
            "coordination": coordination,
            "timeout": timeout,
            "fast": fast,
            "keepalive": keepalive,
            "workers": workers,
            **(properties or {}),
        }
        given = {name: (value, place) for name, value in stated.items() if value is not None}
        cls._hprm_properties_ = cls._hprm_properties_ | given
        if executable is not None:
            cls._hprm_executable_ = _command(executable, place)
        cls._hprm_parts_ = _class_body.parts_of(cls)
        cls._hprm_reactions_ = _class_body.reactions_of(cls)
        for name, part in cls._hprm_parts_.items():
            if _is_of_all(name) or name == "_hprm_":
                raise ProgramError(
                    f"every reactor has an attribute `{name}` already",
                    part.place,
                    f"give the {part.kind} another name",
                )
        _class_body.check(cls)
        # What `help` and editors show of the constructor, which the metaclass calls.
        signature = inspect.signature(cls.__init__)
        parameters = list(signature.parameters.values())[1:]
        cls.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]


def _command(executable: object, place: Place) -> list[str]:
    """Return a path with arguments. The path is relative to the file that states it."""
    stated = executable
    if isinstance(stated, str | os.PathLike):
        stated = [os.fspath(stated)]
    if not isinstance(stated, list | tuple) or not stated:
        raise ProgramError(
            f"`executable` is a path, or a list of a path and arguments, not {executable!r}", place
        )
    command = [os.fspath(it) if isinstance(it, os.PathLike) else it for it in stated]
    if not all(isinstance(it, str) for it in command) or not command[0]:
        raise ProgramError(f"`executable` is a list of texts, not {executable!r}", place)
    if "/" in command[0]:
        # A class in another file may inherit it.
        command[0] = os.path.join(os.path.dirname(os.path.abspath(place.path)), command[0])
    return command


def _refuse_keyword(name: str, place: Place) -> None:
    # Only a program with this mistake needs the module.
    from difflib import get_close_matches

    known = (
        "coordination",
        "timeout",
        "fast",
        "keepalive",
        "workers",
        "properties",
        "executable",
    )
    hint = f'write properties={{"{name.replace("_", "-")}": ...}} if it is a target property'
    for near in get_close_matches(name, known, 1):
        hint = f"did you mean `{near}`?"
    raise ProgramError(f"a reactor class has no keyword `{name}`", place, hint)


# What `help` shows; subclasses have the signatures of their constructors.
Reactor.__signature__ = inspect.Signature()  # type: ignore[attr-defined]


class Federation(Reactor):
    """A main reactor whose contained reactors are federates: processes of their own.

    Each reactor that the constructor assigns to an attribute is a federate; each member of a list
    is one, too. A federation has no ports and no reactions of its own. Define it at the top level
    of a file, and call ``hprm.run`` below ``if __name__ == "__main__":``, because the processes
    import that file. Keywords of the class statement are those of ``Reactor``.

    Examples
    --------
    >>> import hprm
    >>> class Camera(hprm.Reactor):
    ...     image = hprm.Output(int)
    ...
    ...     @hprm.reaction(hprm.startup, effects=[image])
    ...     def capture(self):
    ...         self.image.set(7)
    >>> class Detector(hprm.Reactor):
    ...     image = hprm.Input(int)
    ...
    ...     @hprm.reaction(image)
    ...     def detect(self):
    ...         print(self.image.value)
    >>> class Vision(hprm.Federation, timeout="10 ms"):
    ...     def __init__(self):
    ...         self.camera, self.detector = Camera(), Detector()
    ...         hprm.connect(self.camera.image, self.detector.image)
    >>> hprm.run(Vision(), processes=False)
    7

    """


@checked("federate")
def federate(
    reactor: R,
    *,
    host: str | None = None,
    maxwait: Time | None = None,
    transient: bool = False,
    restart: Restart | Condition | None = None,
) -> R:
    """State something about a reactor of a federation as a federate.

    ``self.camera = hprm.federate(Camera(), maxwait="10 ms")``

    Parameters
    ----------
    reactor : Reactor
        The reactor.
    host : str, optional
        The host on which it is to run, as ``name``, ``user@name:port``, or an address. ``hprm run``
        starts it there, through agents; without them, another host than this one is an error.
    maxwait : Time, optional
        How long the beginning of a tag waits for messages of earlier ones, under decentralized
        coordination; as long as it takes, if it is left out.
    transient : bool, default False
        Whether it may join late, leave, fail and come back while the federation runs.
    restart : Restart or str, optional
        When ``hprm run`` starts it again, if it is transient: an ``hprm.Restart``, or only its
        condition, as ``"on-failure"``.

    Returns
    -------
    Reactor
        The same reactor.

    Raises
    ------
    ProgramError
        If an argument is of another type.

    """
    place = _places.here()
    if not isinstance(reactor, Reactor):
        raise ProgramError(f"a federate is a reactor, not {one(type(reactor).__name__)}", place)
    if host is not None and not isinstance(host, str):
        raise ProgramError(f"`host` is the name of a host, not {host!r}", place)
    wait = _duration.stated("maxwait", maxwait, place)
    again = _restart.stated(restart, place)
    facts = {"host": host, "maxwait": wait, "transient": bool(transient), "restart": again}
    _construction.of(reactor).federate = facts
    return reactor


def _adopt(reactor: Reactor, construction: Construction) -> None:
    """Find what a reactor contains: the reactors that are its attributes."""
    for name, value in vars(reactor).items():
        if _is_of_all(name):
            _refuse_name(reactor, construction, name)
        if name in type(reactor)._hprm_parts_:
            part = type(reactor)._hprm_parts_[name]
            raise ProgramError(
                f"the constructor of {type(reactor).__name__} assigns to the {part.kind} `{name}`",
                _assigned_at(reactor, construction, name),
                "a part is declared by the class and cannot be assigned; give one of them another"
                " name",
                "LF1007",
            )
        if isinstance(value, Part):
            raise ProgramError(
                f"the constructor of {type(reactor).__name__} declares the {value.kind} `{name}`",
                value.place,
                f"declare it in the class body: {name} = hprm.{type(value).__name__}(...)",
            )
        if isinstance(value, Reactor):
            _adopt_one(reactor, value, (name, None))
            construction.children[name] = value
        elif isinstance(value, list | tuple) and any(isinstance(it, Reactor) for it in value):
            classes = {type(member) for member in value}
            if len(classes) > 1:
                names = ", ".join(sorted(cls.__name__ for cls in classes))
                raise ProgramError(
                    f"the members of the bank {name} are of several classes: {names}",
                    construction.place,
                    "a bank has members of one class; give others attributes of their own",
                )
            for index, member in enumerate(value):
                _adopt_one(reactor, member, (name, index))
            construction.children[name] = list(value)
        elif isinstance(value, dict) and any(isinstance(it, Reactor) for it in value.values()):
            raise ProgramError(
                f"{type(reactor).__name__}.{name} is a dictionary of reactors",
                construction.place,
                "a reactor contains those that are attributes, or members of a list",
            )
    for child in construction.made:
        inner = _construction.of(child)
        if inner.container is None:
            raise ProgramError(
                f"{type(reactor).__name__} makes this {type(child).__name__} and does not contain"
                " it, so it would never run",
                inner.place,
                "assign it to an attribute of self, or to a list of reactors of its class",
            )


def _is_of_all(name: str) -> bool:
    """Whether every reactor has an attribute of that name, such as ``elapsed``."""
    return any(name in vars(cls) for cls in Reactor.__mro__)


def _assigned_at(reactor: Reactor, construction: Construction, name: str) -> Place:
    """Return where a constructor assigns to an attribute, or else where the reactor is made."""
    constructors = [vars(cls).get("__init__") for cls in type(reactor).__mro__]
    return _places.of_assignment(constructors, name) or construction.place


def _refuse_name(reactor: Reactor, construction: Construction, name: str) -> None:
    raise ProgramError(
        f"the constructor of {type(reactor).__name__} assigns to `{name}`, which every reactor has"
        " already",
        _assigned_at(reactor, construction, name),
        "give the attribute another name",
    )


def _adopt_one(container: Reactor, child: Reactor, called: tuple[str, int | None]) -> None:
    construction = _construction.of(child)
    name, member = called
    if construction.container is not None or child is container:
        raise ProgramError(
            f"the {type(child).__name__} of {type(container).__name__}.{name} is contained in"
            f" {type(construction.container or container).__name__} already",
            construction.place,
            "make another one: a reactor is in one place",
        )
    construction.container = container
    construction.name, construction.member = name, member


# When classes of a program can be made, and not while one runs: that leaves the process as it was.
_uncaught.show_mistakes()
