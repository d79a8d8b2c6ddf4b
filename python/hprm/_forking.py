"""Processes that bodies fork: they let go of the links of the federate.

Otherwise nobody would see the links end when the federate dies and such a process lives on.
"""

import os

from hprm import _hprm

# Those at the moment of the last fork: in the new process nobody could be asked.
_links: list[int] = []


def let_go_of_links() -> None:
    """Have each process that is forked from now on let go of the links."""
    os.register_at_fork(before=_note, after_in_child=_let_go)


def _note() -> None:
    _links[:] = _hprm.link_descriptors()


def _let_go() -> None:
    if not _links:
        return
    # The numbers stay taken: no file of the program gets one that is closed as a link later.
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in _links:
        os.dup2(nothing, descriptor, inheritable=False)
    os.close(nothing)
