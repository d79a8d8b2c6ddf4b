"""What comes beside each message: its number, when it was sent, and by which endpoint.

The numbers are little-endian; texts and lists of bytes have their length before them. Versions of
the protocol before April 2025 have the name of each field before it, which is read as well.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

_GID = 16
_PLAIN = struct.Struct(f"<qqB{_GID}s")
_NAMES = (b"sequence_number", b"source_timestamp", b"source_gid")


class Attachment(NamedTuple):
    """What comes beside a message."""

    #: Counts the messages of an endpoint from 1.
    number: int
    #: In nanoseconds since 1970.
    time: int
    #: The identity of the endpoint.
    gid: bytes

    def pack(self) -> bytes:
        """Return the bytes, as today's versions of the protocol have them."""
        return _PLAIN.pack(self.number, self.time, _GID, self.gid)


def read(data: bytes) -> Attachment | None:
    """Read an attachment of either format; none if it is of neither."""
    if len(data) == _PLAIN.size:
        number, time, size, gid = _PLAIN.unpack(data)
        return Attachment(number, time, gid) if size == _GID else None
    return _read_named(data)


def _read_named(data: bytes) -> Attachment | None:
    fields = []
    for name, size in zip(_NAMES, (8, 8, 1 + _GID), strict=True):
        label = bytes([len(name)]) + name
        if not data.startswith(label) or len(data) < len(label) + size:
            return None
        fields.append(data[len(label) : len(label) + size])
        data = data[len(label) + size :]
    number, time, gid = fields
    if data or gid[0] != _GID:
        return None
    return Attachment(
        int.from_bytes(number, "little", signed=True),
        int.from_bytes(time, "little", signed=True),
        gid[1:],
    )
