"""The levels of all loggers: a tree by the dots of their names.

A logger without a level of its own has that of its nearest ancestor that has one; the root has the
default level. Nothing here writes a message.
"""

from hprm.ros.impl.logging_severity import LoggingSeverity

SEPARATOR = "."
_DEFAULT = LoggingSeverity.INFO


class Levels:
    """The levels that a program has set."""

    def __init__(self) -> None:
        """Begin with the default level of the root."""
        self._set: dict[str, LoggingSeverity] = {}
        # Effective levels that were looked up since a level was last set.
        self._known: dict[str, LoggingSeverity] = {}

    def set(self, name: str, level: LoggingSeverity | int) -> None:
        """Set the level of a logger; ``UNSET`` removes it.

        The empty name is the root, which inherits nothing: if it is ``UNSET``, all is written.
        """
        level = LoggingSeverity(level)
        self._known.clear()
        if name and level == LoggingSeverity.UNSET:
            self._set.pop(name, None)
        else:
            self._set[name] = level

    def own(self, name: str) -> LoggingSeverity:
        """Return the level that was set for a logger, or ``UNSET``; that of the root is known."""
        return self._set.get(name, LoggingSeverity.UNSET if name else _DEFAULT)

    def effective(self, name: str) -> LoggingSeverity:
        """Return the level from which on a logger writes messages."""
        level = self._known.get(name)
        if level is None:
            level = self._known[name] = self._find(name)
        return level

    def _find(self, name: str) -> LoggingSeverity:
        while name:
            if name in self._set:
                return self._set[name]
            name = name.rpartition(SEPARATOR)[0]
        return self._set.get("", _DEFAULT)

    def clear(self) -> None:
        """Forget all levels."""
        self._set.clear()
        self._known.clear()


#: The levels of this process.
levels = Levels()
