"""Arrays in the memory of the federate's object store, which are published without a copy.

In a reaction NumPy's own functions make such arrays, too; these do so wherever the program runs.
Without a store, as in a program that is not federated, they are NumPy's functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hprm import _hprm

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt


def empty(
    shape: int | Sequence[int], dtype: npt.DTypeLike = float, order: str = "C"
) -> np.ndarray[Any, Any]:
    """Return a new array, with anything in it, that a port can be set to without a copy.

    It is an array as any other until it is published: when a port was set to it and nothing else
    refers to it at the end of the tag. If something does, a copy is published instead.
    """
    import numpy as np

    return _hprm.in_store(np.empty, shape, dtype, order)


def empty_like(
    prototype: npt.ArrayLike,
    dtype: npt.DTypeLike = None,
    order: str = "K",
    shape: int | Sequence[int] | None = None,
) -> np.ndarray[Any, Any]:
    """Return a new array like another one, as ``empty`` does."""
    import numpy as np

    # An array of a subclass has a state of its own, and is copied.
    return _hprm.in_store(np.empty_like, prototype, dtype, order, subok=False, shape=shape)
