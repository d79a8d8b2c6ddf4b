"""Cyclone DDS on loopback: a topic for each edge, reliable, everything kept.

Pixels are an array of bytes of their own length, which the binding copies at once; the rest of a
message is pickled into a sequence.
"""

from __future__ import annotations

import pickle
import time
from dataclasses import make_dataclass
from typing import Any

import numpy as np
from autopilot.simulator import BIRDVIEW, PICTURE
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, sequence, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from session import Session, until
from transports.cyclonedds import NEVER, QOS, waiter_of

from edges import arriving, joined, leaving, parted

_PIXELS = {"picture": PICTURE, "birdview": BIRDVIEW}


def _type_of(edge: str) -> Any:
    fields: list[tuple[str, Any]] = [("rest", sequence[uint8])]
    if edge in _PIXELS:
        fields.insert(0, ("pixels", array[uint8, int(np.prod(_PIXELS[edge]))]))
    return make_dataclass(edge.capitalize(), fields, bases=(IdlStruct,))


class Ends:
    """A writer for each edge that leaves, a reader for each that arrives."""

    def __init__(self, session: Session, role: str) -> None:
        """Waits until each writer has its reader, and each reader its writer."""
        participant = DomainParticipant(int(session.option("domain", 0)))
        prefix = session.name.replace("-", "_")
        self._types = {edge: _type_of(edge) for edge in {*arriving(role), *leaving(role)}}

        def topic(edge: str) -> Topic:
            return Topic(participant, f"{prefix}_{edge}", self._types[edge], qos=QOS)

        self._writers = {e: DataWriter(participant, topic(e), qos=QOS) for e in leaving(role)}
        self._readers = {e: DataReader(participant, topic(e), qos=QOS) for e in arriving(role)}
        self._waiters = {e: waiter_of(participant, [r]) for e, r in self._readers.items()}
        self._came: dict[str, list[Any]] = {edge: [] for edge in self._readers}
        for writer in self._writers.values():
            until("a reader of Cyclone DDS", writer.get_matched_subscriptions)
        for reader in self._readers.values():
            until("a writer of Cyclone DDS", reader.get_matched_publications)

    def send(self, edge: str, message: Any) -> None:
        """Writes a sample."""
        pixels, rest = parted(message)
        values: dict[str, Any] = {"rest": list(pickle.dumps(rest, protocol=5))}
        if edge in _PIXELS:
            # The last message has no pixels, but its type does.
            filled = bytes(int(np.prod(_PIXELS[edge]))) if pixels is None else pixels.tobytes()
            values["pixels"] = filled
        self._writers[edge].write(self._types[edge](**values))

    def receive(self, edge: str) -> Any:
        """Takes the next sample."""
        came = self._came[edge]
        while not came:
            came += [it for it in self._readers[edge].take(8) if hasattr(it, "rest")]
            if not came:
                self._waiters[edge].wait(NEVER)
        sample = came.pop(0)
        rest = pickle.loads(bytes(sample.rest))
        if rest is None or edge not in _PIXELS:
            return rest
        pixels = np.frombuffer(bytes(sample.pixels), np.uint8).reshape(_PIXELS[edge])
        return joined(pixels, rest)

    def close(self) -> None:
        """Waits until the neighbours have the last messages."""
        for writer in self._writers.values():
            writer.wait_for_acks(NEVER)
        time.sleep(0.2)
