"""What clients and servers of an action agree on: hidden names, and the numbers of statuses."""

from __future__ import annotations

import inspect
from typing import Any

UNKNOWN, ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(7)
#: The statuses of goals that are not over.
ACTIVE = (ACCEPTED, EXECUTING, CANCELING)


def hidden(action: str, part: str) -> str:
    """Return the name of a service or topic of an action."""
    return f"{action}/_action/{part}"


async def awaited(value: Any) -> Any:
    """Return what a callback has returned, or what its coroutine gives."""
    return await value if inspect.isawaitable(value) else value
