"""Watching a running federation, from a process that is no part of it."""

from __future__ import annotations

from hprm import _hprm
from hprm._duration import Time
from hprm._hprm import Watch


class WatchError(Exception):
    """A federation cannot be watched, or a value of it cannot be seen.

    Attributes
    ----------
    message
        What is wrong.
    hint
        What to do about it, or None.

    """

    def __init__(self, message: str, hint: str | None = None) -> None:
        """Say what is wrong, and what to do about it."""
        self.message = message
        self.hint = hint
        super().__init__(message)

    def __str__(self) -> str:
        """Return the message and the hint."""
        return f"{self.message}\n  hint: {self.hint}" if self.hint else self.message


WatchError.__module__ = "hprm"


def watch(*ports: str, of: str | int | None = None, wait: Time = 0, pickles: bool = False) -> Watch:
    """Watch what federates of a running federation send, from now on.

    The result is an iterator over messages, which ends when the federates have ended:

    >>> import hprm
    >>> for message in hprm.watch("camera.image", wait="10 s"):  # doctest: +SKIP
    ...     print(message.tag, message.value.mean())

    A message has

    ``port``
        where it is seen: ``"camera.image"``
    ``tag``
        its tag there, or None at the input of a physical connection; ``elapsed`` is the time of
        the tag since the start, in nanoseconds
    ``value``
        the value, which is made when it is asked for; an object of a class that this program has
        not imported is a ``types.SimpleNamespace`` of its attributes
    ``sent``
        the physical time at which it was sent, in nanoseconds since the Unix epoch
    ``size``
        how many bytes the value has
    ``missed``
        how many messages were missed before it

    The federation does not wait for this, and does the same as without it: a program that reads
    too slowly misses messages. Arrays are copies, and read-only. A large one is copied when
    ``value`` is asked for, which must be before the next message.

    Parameters
    ----------
    ports
        Federates and their outputs or inputs; without an index, all members of a bank or channels
        of a multiport. None stands for all connections between federates.
    of
        The federation, if several run: the name of its program, or the number of a process.
    wait
        How long to wait until it runs.
    pickles
        Whether to read values that are pickles, and to import what they and other values name. Then
        the program that is watched can run any code in this process.

    Raises
    ------
    WatchError
        If there is no such federation or port; or, by ``value``, if a value cannot be seen.

    """
    limit = _hprm.nanoseconds(wait)
    federation = None if of is None else str(of)
    for port in ports:
        if not isinstance(port, str):
            raise TypeError(f'a port is a text such as "camera.image", and this is {port!r}')
    return _hprm.watch_ports(list(ports), federation, limit, pickles)
