"""Arrays in the memory of the federate's object store, which are published without a copy.

In a reaction NumPy's own functions make such arrays, too; these do so wherever the program runs.
Without a store, as in a program that is not federated, they are NumPy's functions.
"""

from __future__ import annotations

from hprm import _hprm

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    import numpy as np
    import numpy.typing as npt


def empty(
    shape: int | Sequence[int], dtype: npt.DTypeLike = float, order: str = "C"
) -> np.ndarray[Any, Any]:
    """Return a new array, with anything in it, that a port can be set to without a copy.

    It is an array as any other until it is published: when a port was set to it and nothing else
    refers to it at the end of the tag. If something does, a copy is published instead.

    One whose elements have fields begins with zeros, because writing the fields does not write the
    bytes between them.

    Parameters
    ----------
    shape : int or sequence of int
        The number of elements in each dimension.
    dtype : data-type, default float
        The type of the elements.
    order : {"C", "F"}, default "C"
        Whether the last or the first index changes fastest in memory.

    Returns
    -------
    numpy.ndarray
        An array of that shape; of a federate, in its object store.

    """
    import numpy as np

    return _without_remains(_hprm.in_store(np.empty, shape, dtype, order))


def empty_like(
    prototype: npt.ArrayLike,
    dtype: npt.DTypeLike | None = None,
    order: str = "K",
    shape: int | Sequence[int] | None = None,
) -> np.ndarray[Any, Any]:
    """Return a new array like another one, as ``empty`` does.

    Parameters
    ----------
    prototype : array_like
        What has the shape and the type of elements.
    dtype : data-type, optional
        Another type of elements.
    order : {"C", "F", "A", "K"}, default "K"
        The order of elements in memory, as of ``numpy.empty_like``.
    shape : int or sequence of int, optional
        Another shape.

    Returns
    -------
    numpy.ndarray
        The array, never of a subclass.

    """
    import numpy as np

    # An array of a subclass has a state of its own, and is copied.
    made = _hprm.in_store(np.empty_like, prototype, dtype, order, subok=False, shape=shape)
    return _without_remains(made)


def _without_remains(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Clear an array of elements with fields, of which a program fills only the fields."""
    if array.dtype.names is not None and not array.dtype.hasobject:
        elements = array.view(f"V{array.dtype.itemsize}")
        elements[...] = bytes(array.dtype.itemsize)
    return array
