"""Talker or listener with Cyclone DDS' binding: what `pair.py` does, with its types and calls."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "peers" / "worker"))

# It has the configuration for loopback, which the library reads when it is first used.
from transports.cyclonedds import NEVER, QOS, waiter_of  # isort: skip

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


def main() -> None:
    """Be the one or the other: role, size, count, period, number of the domain."""
    role, size, count, period = sys.argv[1], *map(int, sys.argv[2:4]), float(sys.argv[4])

    @dataclass
    class Image(IdlStruct, typename="Image"):
        data: array[uint8, size]

    participant = DomainParticipant(int(sys.argv[5]))
    topic = Topic(participant, "image", Image, qos=QOS)
    if role == "talker":
        talk(DataWriter(participant, topic, qos=QOS), Image, size, count, period)
        return
    reader = DataReader(participant, topic, qos=QOS)
    waiter, took = waiter_of(participant, [reader]), []
    while len(took) < count:
        waiter.wait(NEVER)
        for image in reader.take(64):
            if hasattr(image, "data"):
                now = time.monotonic_ns()
                took.append(now - int.from_bytes(bytes(image.data[:8]), "little"))
    print(*took, flush=True)


def talk(writer: DataWriter, kind: type, size: int, count: int, period: float) -> None:
    """Publish when there is a listener."""
    while not writer.get_matched_subscriptions():
        time.sleep(0.01)
    rest = bytes(size - 8)
    for _ in range(count):
        time.sleep(period)
        writer.write(kind(data=time.monotonic_ns().to_bytes(8, "little") + rest))
    writer.wait_for_acks(NEVER)
    # Until the listener has taken the last one.
    while writer.get_matched_subscriptions():
        time.sleep(0.01)


main()
