"""What can be wrong with a bag, as one error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hprm.ros._messages.cdr import SerializationError


class BagError(Exception):
    """A bag that cannot be read or written; the text names it and says why."""


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Make one error of whatever damaged bytes make the code that reads them do."""
    try:
        yield
    except BagError:
        raise
    except SerializationError as error:
        raise BagError(f"{path}: {error}") from error
    except OSError as error:
        raise BagError(f"{path} cannot be read: {error.strerror or error}") from error
    # Lengths and texts in a damaged file are arbitrary, so any step of a reader may fail.
    except Exception as error:
        why = str(error).rstrip(".") or type(error).__name__
        raise BagError(f"{path} is damaged, cut off, or no bag of ROS 2: {why}") from error
