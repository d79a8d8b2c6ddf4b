"""Cyclone DDS on loopback: reliable, everything kept, an array of bytes of the message's length.

An array is what its binding copies at once, rather than element by element. Its length belongs to
the type, so there is a topic for each length, and order holds within a topic only.
"""

import os
import time
from dataclasses import dataclass
from typing import Any

from session import Session, until

os.environ["CYCLONEDDS_URI"] = """
<CycloneDDS><Domain id="any">
  <General>
    <Interfaces><NetworkInterface name="lo"/></Interfaces>
    <AllowMulticast>false</AllowMulticast>
    <MaxMessageSize>65500B</MaxMessageSize>
  </General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers><Peer address="localhost"/></Peers>
  </Discovery>
  <Internal>
    <Watermarks><WhcHigh>8MB</WhcHigh></Watermarks>
    <SocketReceiveBufferSize min="default" max="4MB"/>
  </Internal>
</Domain></CycloneDDS>
"""

# Only now: the library reads its configuration when it is first used.
from cyclonedds.core import InstanceState as State  # noqa: E402
from cyclonedds.core import Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.idl import IdlStruct  # noqa: E402
from cyclonedds.idl.types import array, uint8  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402

_HEADER = 16
NEVER = 5_000_000_000
QOS = Qos(
    Policy.Reliability.Reliable(max_blocking_time=60_000_000_000),
    Policy.History.KeepAll,
)


def waiter_of(participant: DomainParticipant, readers: list[DataReader]) -> WaitSet:
    """Waits for samples of any of these readers."""
    waiter = WaitSet(participant)
    for reader in readers:
        mask = SampleState.Any | ViewState.Any | State.Any
        waiter.attach(ReadCondition(reader, mask))
    return waiter


def _type_of(length: int) -> type:
    @dataclass
    class Message(IdlStruct, typename=f"Message{length}"):
        data: array[uint8, length]

    return Message


class _Ends:
    """The topics of a session: one for each way and length."""

    def __init__(self, session: Session) -> None:
        # A domain of its own keeps sessions apart whose ends are still closing.
        self._participant = DomainParticipant(int(session.option("domain", 0)))
        self._name = session.name.replace("-", "_")
        self.lengths = sorted({_HEADER, *(cell["size"] for cell in session.plan)})
        self._types = {length: _type_of(length) for length in self.lengths}

    def topic(self, way: str, length: int) -> Topic:
        name = f"{self._name}_{way}_{length}"
        return Topic(self._participant, name, self._types[length], qos=QOS)

    def message(self, length: int, data: bytes) -> Any:
        return self._types[length](data=data)

    def writer(self, topic: Topic) -> DataWriter:
        return DataWriter(self._participant, topic, qos=QOS)

    def reader(self, topic: Topic) -> DataReader:
        return DataReader(self._participant, topic, qos=QOS)

    def waiter(self, readers: list[DataReader]) -> WaitSet:
        return waiter_of(self._participant, readers)


class _Writer:
    def __init__(self, ends: _Ends, way: str) -> None:
        self._ends = ends
        self._writers = {length: ends.writer(ends.topic(way, length)) for length in ends.lengths}

    def wait_for(self, readers: int) -> None:
        for writer in self._writers.values():
            until(
                "readers of Cyclone DDS",
                lambda writer=writer: len(writer.get_matched_subscriptions()) >= readers,
            )

    def write(self, message: Any) -> None:
        data = bytes(memoryview(message).cast("B"))
        self._writers[len(data)].write(self._ends.message(len(data), data))

    def drain(self) -> None:
        for writer in self._writers.values():
            writer.wait_for_acks(NEVER)


class _Reader:
    """Messages of all lengths; the length that came last is looked for first."""

    def __init__(self, ends: _Ends, way: str) -> None:
        self._readers = [ends.reader(ends.topic(way, length)) for length in ends.lengths]
        self._waiter = ends.waiter(self._readers)
        self._taken: list[Any] = []

    def wait_for_writer(self) -> None:
        for reader in self._readers:
            until(
                "a writer of Cyclone DDS",
                lambda reader=reader: len(reader.get_matched_publications()) >= 1,
            )

    def read(self) -> Any:
        while not self._taken:
            for place, reader in enumerate(self._readers):
                taken = [sample for sample in reader.take(64) if hasattr(sample, "data")]
                if taken:
                    self._taken = taken[::-1]
                    self._readers.insert(0, self._readers.pop(place))
                    break
            else:
                self._waiter.wait(NEVER)
        return self._taken.pop().data


class Hub:
    """Writers for all nodes, readers for each."""

    def __init__(self, session: Session) -> None:
        """Waits for the nodes."""
        ends = _Ends(session)
        self._readers = [_Reader(ends, f"up{index}") for index in range(session.nodes)]
        self._writer = _Writer(ends, "down")
        self._writer.wait_for(session.nodes)
        for reader in self._readers:
            reader.wait_for_writer()
            reader.read()

    def send(self, message: Any) -> None:
        """To every node."""
        self._writer.write(message)

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return [reader.read() for reader in self._readers]

    def close(self) -> None:
        """Waits until the nodes have the last message."""
        self._writer.drain()
        time.sleep(0.1)


class Node:
    """Readers of what the hub writes, and writers of replies."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        ends = _Ends(session)
        self._reader = _Reader(ends, "down")
        self._writer = _Writer(ends, f"up{index}")
        self._writer.wait_for(1)
        self._reader.wait_for_writer()
        self._writer.write(bytes(_HEADER))

    def receive(self) -> Any:
        """The next message."""
        return self._reader.read()

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._writer.write(message)

    def close(self) -> None:
        """Nothing is left to do."""
