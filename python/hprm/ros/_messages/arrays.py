"""NumPy for fields of messages: it takes longer to import than all of `hprm.ros`.

So it is imported when the first array is made of what is no array yet, and scripts without arrays
start without it.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TypeGuard

if TYPE_CHECKING:
    import numpy

#: More bytes than a copy is cheap for: what NumPy has in the store while bodies run.
LARGE = 65_536


def is_array(value: object) -> TypeGuard[numpy.ndarray[Any, Any]]:
    """Return whether a value is an array of NumPy; there is none where nothing has imported it."""
    # Another thread may be importing it just now.
    kind = getattr(sys.modules.get("numpy"), "ndarray", ())
    return isinstance(value, kind)


def array(values: Any, dtype: str) -> Any:
    """Make an array."""
    import numpy

    return numpy.array(values, dtype)


def zeros(size: int, dtype: str) -> Any:
    """Make an array of zeros."""
    import numpy

    return numpy.zeros(size, dtype)
