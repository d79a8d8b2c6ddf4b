"""The program of `Ordering.lf` without tags: plain queues of Python, and PUB/SUB of pyzmq.

A publisher sends the number of its step on three ways, directly and through one and two relays, and
two subscribers take what comes, as it comes. A message of an earlier step than one that has already
been taken is out of order: nothing tells the subscriber, this module counts.
Nothing of HPRM is in here.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import multiprocessing.synchronize
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

WAYS = ("direct", "short", "long")
SUBSCRIBERS = 2
END = -1
"""The number that says that no other follows on a way."""

_NUMBER = struct.Struct("<q")
_START_S = 60.0
_spawn = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class Flow:
    """How much is to be sent, and how fast."""

    steps: int
    period_ns: int

    def numbers(self) -> Iterator[int]:
        """The number of each step, when it is due; at once, if that is past."""
        start = time.monotonic_ns()
        for step in range(self.steps):
            ahead = start + step * self.period_ns - time.monotonic_ns()
            if ahead > 0:
                time.sleep(ahead / 1e9)
            yield step


Barrier = multiprocessing.synchronize.Barrier
Take = Callable[[], int]
Send = Callable[[int], None]


def contenders() -> dict[str, Callable[[Flow], dict[str, Any]]]:
    """What can be run here, by name."""
    found: dict[str, Callable[[Flow], dict[str, Any]]] = {"multiprocessing queues": queues}
    if importlib.util.find_spec("zmq") is not None:
        found["pyzmq PUB/SUB"] = zmq_sockets
    return found


def queues(flow: Flow) -> dict[str, Any]:
    """Runs the program with one queue for each process that receives."""
    inboxes = {name: _spawn.Queue() for name in ["near", "far", "farther", "0", "1"]}
    subscribers = [inboxes[str(index)] for index in range(SUBSCRIBERS)]
    relays = [
        (_relay_queue, inboxes["near"], subscribers),
        (_relay_queue, inboxes["far"], [inboxes["farther"]]),
        (_relay_queue, inboxes["farther"], subscribers),
    ]
    publisher = (_publish_queue, flow, [subscribers, [inboxes["near"]], [inboxes["far"]]])
    return _run([publisher, *relays], [(_subscribe_queue, inbox) for inbox in subscribers])


def zmq_sockets(flow: Flow) -> dict[str, Any]:
    """Runs the program with a PUB socket for each way, and SUB sockets."""
    with tempfile.TemporaryDirectory(prefix="hprm-zmq-") as folder:
        at = {name: f"ipc://{folder}/{name}" for name in [*WAYS, "near", "far", "farther"]}
        publisher = (_publish_zmq, flow, [at[way] for way in WAYS])
        relays = [
            (_relay_zmq, at["short"], at["near"], SUBSCRIBERS),
            (_relay_zmq, at["long"], at["far"], 1),
            (_relay_zmq, at["far"], at["farther"], SUBSCRIBERS),
        ]
        ends = [at["direct"], at["near"], at["farther"]]
        subscribers = [(_subscribe_zmq, ends) for _ in range(SUBSCRIBERS)]
        return _run([publisher, *relays], subscribers)


def _run(others: list[tuple[Any, ...]], subscribers: list[tuple[Any, ...]]) -> dict[str, Any]:
    """Runs each tuple, a function and its arguments, in a process; adds up what subscribers say."""
    results = _spawn.SimpleQueue()
    barrier = _spawn.Barrier(len(others) + len(subscribers))
    jobs = [(function, (barrier, *arguments)) for function, *arguments in others]
    jobs += [(function, (barrier, results, *arguments)) for function, *arguments in subscribers]
    processes = [_spawn.Process(target=function, args=args, daemon=True) for function, args in jobs]
    for process in processes:
        process.start()
    said = [results.get() for _ in subscribers]
    for process in processes:
        process.join()
    return {
        "messages": sum(messages for messages, _, _ in said),
        "out_of_order": sum(wrong for _, wrong, _ in said),
        "seconds": max(seconds for _, _, seconds in said),
    }


def _subscribe(take: Take) -> tuple[int, int, float]:
    """Takes messages until all ways have ended; how many, how many out of order, how long."""
    messages, wrong, latest, open_ways = 0, 0, -1, len(WAYS)
    begun = time.monotonic()
    while open_ways:
        number = take()
        if number == END:
            open_ways -= 1
            continue
        messages += 1
        wrong += number < latest
        latest = max(latest, number)
    return messages, wrong, time.monotonic() - begun


def _publish(flow: Flow, sends: list[Send]) -> None:
    for number in flow.numbers():
        for send in sends:
            send(number)
    for send in sends:
        send(END)


def _relay(take: Take, send: Send) -> None:
    number = 0
    while number != END:
        number = take()
        send(number)


def _to_all(queues: list[Any]) -> Send:
    def send(number: int) -> None:
        for queue in queues:
            queue.put(number)

    return send


def _publish_queue(barrier: Barrier, flow: Flow, ways: list[list[Any]]) -> None:
    barrier.wait(_START_S)
    _publish(flow, [_to_all(way) for way in ways])


def _relay_queue(barrier: Barrier, inbox: Any, readers: list[Any]) -> None:
    barrier.wait(_START_S)
    _relay(inbox.get, _to_all(readers))


def _subscribe_queue(barrier: Barrier, results: Any, inbox: Any) -> None:
    barrier.wait(_START_S)
    results.put(_subscribe(inbox.get))


def _publisher_socket(address: str, readers: int) -> Send:
    """A PUB socket, once that many have subscribed: it drops what nobody has asked for."""
    import zmq

    socket = zmq.Context.instance().socket(zmq.XPUB)
    socket.set_hwm(0)
    socket.setsockopt(zmq.XPUB_VERBOSE, 1)
    socket.bind(address)
    for _ in range(readers):
        socket.recv()
    return lambda number: socket.send(_NUMBER.pack(number))


def _subscriber_socket(addresses: list[str]) -> Take:
    """A SUB socket for everything that comes from these."""
    import zmq

    socket = zmq.Context.instance().socket(zmq.SUB)
    socket.set_hwm(0)
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    for address in addresses:
        socket.connect(address)
    return lambda: _NUMBER.unpack(socket.recv())[0]


def _publish_zmq(barrier: Barrier, flow: Flow, addresses: list[str]) -> None:
    readers = [SUBSCRIBERS, 1, 1]
    sends = [_publisher_socket(*way) for way in zip(addresses, readers, strict=True)]
    barrier.wait(_START_S)
    _publish(flow, sends)


def _relay_zmq(barrier: Barrier, source: str, target: str, readers: int) -> None:
    take = _subscriber_socket([source])
    send = _publisher_socket(target, readers)
    barrier.wait(_START_S)
    _relay(take, send)


def _subscribe_zmq(barrier: Barrier, results: Any, addresses: list[str]) -> None:
    take = _subscriber_socket(addresses)
    barrier.wait(_START_S)
    results.put(_subscribe(take))
