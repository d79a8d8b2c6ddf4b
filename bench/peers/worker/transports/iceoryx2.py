"""iceoryx2: samples from a pool, written with one copy; an event, or a busy loop, to wake.

Nothing is discarded: a full queue makes its writer wait. A reader holds its sample until it takes
the next one.
"""

from __future__ import annotations

import ctypes
import time
from typing import Any

import iceoryx2 as iox
import numpy as np
from session import Session, until

iox.set_log_level(iox.LogLevel.Error)

_SMALL_UP_TO = 65_536
_MANY, _FEW = 256, 2
"""How many messages may wait for a reader. A publisher reserves room for all of them."""


class _Ports:
    """What a process needs of iceoryx2: its node and the ways to open services."""

    def __init__(self, session: Session) -> None:
        self._session = session
        # Python sees Ctrl-C, and the harness ends processes by their ids.
        builder = iox.NodeBuilder.new().signal_handling_mode(iox.SignalHandlingMode.Disabled)
        # Files of a name that the harness finds, should a process be killed.
        config = iox.config.default()
        config.global_cfg.prefix = iox.FileName.new(f"{session.name}_")
        config.global_cfg.root_path = iox.Path.new(session.directory)
        self._node = builder.config(config).create(iox.ServiceType.Ipc)
        self.polls = bool(session.option("polls"))
        self._queue = _MANY if session.largest <= _SMALL_UP_TO else _FEW

    def data(self, way: str) -> Any:
        name = iox.ServiceName.new(f"{self._session.name}/{way}")
        builder = self._node.service_builder(name).publish_subscribe(iox.Slice[ctypes.c_uint8])
        builder = builder.enable_safe_overflow(False).history_size(0)
        builder = builder.subscriber_max_buffer_size(self._queue)
        builder = builder.max_subscribers(self._session.nodes).max_publishers(1)
        return builder.payload_alignment(iox.Alignment.new(64)).open_or_create()

    def event(self, way: str) -> Any:
        name = iox.ServiceName.new(f"{self._session.name}/{way}/event")
        return self._node.service_builder(name).event().open_or_create()

    def publisher(self, service: Any) -> Any:
        builder = service.publisher_builder().initial_max_slice_len(self._session.largest)
        strategy = iox.BackpressureStrategy.RetryUntilDelivered
        return builder.backpressure_strategy(strategy).create()

    def subscriber(self, service: Any) -> Any:
        return service.subscriber_builder().buffer_size(self._queue).create()


class _Writer:
    """One direction, from here."""

    def __init__(self, ports: _Ports, way: str, events: list[str]) -> None:
        self.service = ports.data(way)
        self._publisher = ports.publisher(self.service)
        self._polls = ports.polls
        self._event_services = [] if ports.polls else [ports.event(event) for event in events]
        self._notifiers = [event.notifier_builder().create() for event in self._event_services]

    def wait_for(self, readers: int) -> None:
        """Until so many are there, each with a listener."""

        def met() -> bool:
            return self.service.dynamic_config.number_of_subscribers >= readers and all(
                event.dynamic_config.number_of_listeners >= 1 for event in self._event_services
            )

        until("readers of iceoryx2", met)
        # A sample goes to those whom the publisher is connected to when it sends.
        self._publisher.update_connections()

    def write(self, message: Any) -> None:
        data = np.frombuffer(message, np.uint8)
        sample = self._publisher.loan_slice_uninit(len(data))
        pointer = sample.payload_ptr
        place = (ctypes.c_uint8 * len(data)).from_address(pointer)
        np.copyto(np.frombuffer(place, np.uint8), data)
        sample.assume_init().send()
        for notifier in self._notifiers:
            notifier.notify()


class _Reader:
    """One direction, to here."""

    def __init__(self, ports: _Ports, way: str, event: str) -> None:
        self._service = ports.data(way)
        self._subscriber = ports.subscriber(self._service)
        self._listener = None if ports.polls else ports.event(event).listener_builder().create()
        self._sample: Any = None
        self._far = iox.Duration.from_secs(5)

    def wait_for_writer(self) -> None:
        """Opens this end of the connection; until then its writer discards what is too much."""
        until(
            "a writer of iceoryx2",
            lambda: self._service.dynamic_config.number_of_publishers >= 1,
        )
        self._subscriber.has_samples()

    def read(self) -> Any:
        self._sample = None
        sample = self._subscriber.receive()
        while sample is None:
            if self._listener is not None:
                self._listener.timed_wait(self._far)
            sample = self._subscriber.receive()
        self._sample = sample
        payload = sample.payload()
        array = (ctypes.c_uint8 * payload.len()).from_address(payload.as_ptr())
        return np.frombuffer(array, np.uint8)


class Hub:
    """One publisher for all nodes, one reader for each."""

    def __init__(self, session: Session) -> None:
        """Waits for the nodes."""
        ports = _Ports(session)
        indices = range(session.nodes)
        self._readers = [_Reader(ports, f"up-{index}", f"up-{index}") for index in indices]
        self._writer = _Writer(ports, "down", [f"down-{index}" for index in indices])
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
        """Gives the nodes time to take the last message, which lies in memory of this process."""
        time.sleep(0.2)


class Node:
    """Reads what the hub publishes, publishes its replies."""

    def __init__(self, session: Session, index: int) -> None:
        """Meets the hub."""
        ports = _Ports(session)
        self._reader = _Reader(ports, "down", f"down-{index}")
        self._writer = _Writer(ports, f"up-{index}", [f"up-{index}"])
        self._writer.wait_for(1)
        self._reader.wait_for_writer()
        self._writer.write(b"here")

    def receive(self) -> Any:
        """The next message."""
        return self._reader.read()

    def reply(self, message: Any) -> None:
        """To the hub."""
        self._writer.write(message)

    def close(self) -> None:
        """Nothing is left to do."""
