"""The names of a reactor's class body, where a name is declared once.

Python lets a later statement replace an earlier one without a word; a port or a reaction would be
lost. What is found here is known at the statement itself, so that is the place of the message.
"""

from __future__ import annotations

import linecache
import re
import sys
from typing import Any

from hprm import _findings, _places
from hprm._mistakes import ProgramError
from hprm._parts import Action, Input, Mode, Output, Part, PhysicalAction, Timer
from hprm._reactions import MARK

_KINDS = (Input, Output, Timer, Action, PhysicalAction, Mode)


class Namespace(dict[str, Any]):
    """What a class body has declared so far."""

    def __setitem__(self, name: str, value: Any) -> None:
        """Declare a name, unless that would lose a part or a reaction."""
        if isinstance(value, type) and value in _KINDS:
            raise ProgramError(
                f"`{name}` is the class hprm.{value.__name__}, not one of its objects",
                _places.here(),
                f"write {name} = hprm.{value.__name__}(...), with parentheses",
            )
        _refuse_to_lose(name, self.get(name), value)
        super().__setitem__(name, value)

    def __missing__(self, name: str) -> Any:
        """Refuse ``self``, which a class body does not have; other names are looked for elsewhere.

        Below ``def`` there is one, and a class in a function may use that of the function.
        """
        frame = sys._getframe(1)
        if name == "self" and not (name in frame.f_globals or name in frame.f_code.co_freevars):
            place = _places.here()
            line = linecache.getline(place.path, place.line).encode()[place.column :]
            found = re.match(rb"self\.(\w+)", line)
            port = found[1].decode() if found else "NAME"
            raise ProgramError(
                "the body of a class has no `self`; only its methods have one",
                place,
                f"write `{port}`, without `self.`; a port of a contained reactor is a function:"
                " lambda self: self.camera.image",
            )
        raise KeyError(name)


def _refuse_to_lose(name: str, earlier: Any, value: Any) -> None:
    reaction = getattr(earlier, MARK, None)
    if isinstance(earlier, Part) and earlier is not value:
        what, place = f"{earlier.kind} `{name}`", earlier.place
    elif reaction is not None and getattr(value, MARK, None) is not reaction:
        what, place = f"reaction `{name}`", reaction.place
    else:
        return
    raise ProgramError(
        f"this replaces the {what}, which line {place.line} declares",
        _places.here(),
        "give one of them another name",
        _findings.TAKEN,
    )
