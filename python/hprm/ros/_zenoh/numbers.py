"""The numbers of messages that have come: which are missing."""

from __future__ import annotations


class Numbers:
    """The last number of each publisher, and how many messages are lost.

    What comes again, or late, as the earlier messages of a publisher do, is no loss.
    """

    def __init__(self) -> None:
        """Know no publisher yet."""
        self._last: dict[bytes, int] = {}
        self.lost = 0

    def note(self, gid: bytes, number: int) -> int:
        """Note the number of a message; return how many before it are missing."""
        last = self._last.get(gid)
        if last is not None and number <= last:
            return 0
        self._last[gid] = number
        missing = 0 if last is None else number - last - 1
        self.lost += missing
        return missing

    def forget(self, gid: bytes) -> None:
        """Forget a publisher that is gone."""
        self._last.pop(gid, None)
