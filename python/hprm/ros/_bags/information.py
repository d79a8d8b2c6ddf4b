"""What a bag has in it, as data and as text."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import Any

_SECOND = 1_000_000_000


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    name: str
    type: str
    count: int
    serialization_format: str = "cdr"


@dataclass(frozen=True)
class BagInfo:
    """What a bag has in it; times are nanoseconds, since 1970.

    ``start`` is None if there are no messages.
    """

    path: str
    files: list[str]
    size: int
    storage: str
    count: int
    start: int | None
    duration: int
    topics: list[Topic]
    #: Of each topic, how many messages the recorder has lost, if it has lost any.
    lost: dict[str, int] = field(default_factory=dict)

    def text(self) -> str:
        """Return it for people, in the form of ``ros2 bag info``."""
        rows = [
            ("Files", "\n".join(self.files)),
            ("Bag size", _size(self.size)),
            ("Storage id", self.storage),
            ("Duration", f"{_seconds(self.duration)}s"),
            ("Start", "-" if self.start is None else _moment(self.start)),
            ("End", "-" if self.start is None else _moment(self.start + self.duration)),
            ("Messages", str(self.count)),
            ("Topic information", "\n".join(map(_topic, self.topics))),
        ]
        if self.lost:
            lost = (f"{count} of {topic}" for topic, count in sorted(self.lost.items()))
            rows.append(("Lost", "\n".join(lost)))
        return "\n".join(_row(*row) for row in rows)

    def json(self) -> str:
        """Return it for programs, as one line."""
        described: dict[str, Any] = asdict(self)
        return json.dumps(described)


_WIDTH = 19


def _row(name: str, text: str) -> str:
    lines = text.split("\n")
    return ("\n" + " " * _WIDTH).join([f"{name + ':':<{_WIDTH}}{lines[0]}".rstrip(), *lines[1:]])


def _topic(it: Topic) -> str:
    return (
        f"Topic: {it.name} | Type: {it.type} | Count: {it.count} | "
        f"Serialization Format: {it.serialization_format}"
    )


def _size(size: int) -> str:
    if size < 1024:
        return f"{size} B"
    shown, units = float(size), ["KiB", "MiB", "GiB", "TiB"]
    while (shown := shown / 1024) >= 1024 and len(units) > 1:
        units.pop(0)
    return f"{shown:.1f} {units[0]}"


def _seconds(time: int) -> str:
    return f"{time // _SECOND}.{time % _SECOND:09d}"


def _moment(time: int) -> str:
    shown = datetime.fromtimestamp(time // _SECOND).strftime("%b %e %Y %H:%M:%S")
    return f"{shown}.{time % _SECOND:09d} ({_seconds(time)})"
