"""When a federate that has ended is started again, in the words of systemd."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from hprm import _duration, _places
from hprm._duration import Time
from hprm._mistakes import ProgramError
from hprm._places import Place

#: After which ends a federate is started again.
Condition: TypeAlias = Literal["no", "on-failure", "on-abnormal", "always"]


class Restart:
    """When ``hprm run`` starts a transient federate again.

    ``hprm.federate(Viewer(), transient=True, restart=hprm.Restart("on-failure", sec="1 s"))``

    Parameters
    ----------
    condition : str
        After which ends: ``"on-failure"`` (an exit code that is not zero, a signal, silence for
        longer than ``--hang-timeout``), ``"on-abnormal"`` (a signal, silence), ``"always"``, or
        ``"no"``.
    sec : Time, optional
        How long after the end; 100 ms, if it is left out.
    burst : int, optional
        How often it may be started within ``interval``, the first time included; 5, if it is left
        out.
    interval : Time, optional
        See ``burst``; 10 s, if it is left out. With zero, there is no limit.

    Raises
    ------
    ProgramError
        If an argument is of another type.

    """

    __slots__ = ("burst", "condition", "interval", "sec")

    def __init__(
        self,
        condition: Condition,
        *,
        sec: Time | None = None,
        burst: int | None = None,
        interval: Time | None = None,
    ) -> None:
        """Note what is stated; the model checks it."""
        place = _places.here()
        if not isinstance(condition, str):
            message = f'`restart=` needs a condition, as "on-failure", not {condition!r}'
            raise ProgramError(message, place)
        if burst is not None and (not isinstance(burst, int) or isinstance(burst, bool)):
            raise ProgramError(f"`burst` is a whole number, not {burst!r}", place)
        self.condition = condition
        self.burst = burst
        self.sec = _duration.stated("sec", sec, place)
        self.interval = _duration.stated("interval", interval, place)

    def __repr__(self) -> str:
        """Show it as it could be written."""
        others = {name: getattr(self, name) for name in ("sec", "burst", "interval")}
        stated = [f"{name}={value!r}" for name, value in others.items() if value is not None]
        return f"Restart({', '.join([repr(self.condition), *stated])})"


def stated(restart: Restart | str | None, place: Place) -> dict[str, Any] | None:
    """Return what a program states for a federate, as the model reads it."""
    if restart is None:
        return None
    if isinstance(restart, str):
        return {"condition": restart}
    if not isinstance(restart, Restart):
        message = f"`restart` is a condition or an `hprm.Restart`, not {restart!r}"
        raise ProgramError(message, place)
    return {name: getattr(restart, name) for name in ("condition", "sec", "burst", "interval")}
