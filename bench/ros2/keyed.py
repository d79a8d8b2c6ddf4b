"""Talker or listener with Zenoh's binding: what `pair.py` does, with bytes."""

import json
import sys
import time

import zenoh


def opened(role: str, port: str) -> zenoh.Session:
    """Open a peer: the talker listens at a port, and the listener connects to it."""
    config = zenoh.Config()
    place = [f"tcp/127.0.0.1:{port}"]
    for key, value in {
        "mode": "peer",
        "listen/endpoints": place if role == "talker" else [],
        "connect/endpoints": place if role == "listener" else [],
        "scouting/multicast/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def main() -> None:
    """Be the one or the other: role, size, count, period, port."""
    role, size, count, period = sys.argv[1], *map(int, sys.argv[2:4]), float(sys.argv[4])
    with opened(role, sys.argv[5]) as session:
        if role == "talker":
            talk(session, size, count, period)
            return
        samples = session.declare_subscriber("image", zenoh.handlers.FifoChannel(1000))
        took = []
        for _ in range(count):
            data = samples.recv().payload.to_bytes()
            took.append(time.monotonic_ns() - int.from_bytes(data[:8], "little"))
        print(*took, flush=True)


def talk(session: zenoh.Session, size: int, count: int, period: float) -> None:
    """Publish when there is a listener."""
    wait = zenoh.CongestionControl.BLOCK
    publisher = session.declare_publisher("image", congestion_control=wait)
    while not publisher.matching_status.matching:
        time.sleep(0.01)
    rest = bytes(size - 8)
    for _ in range(count):
        time.sleep(period)
        publisher.put(time.monotonic_ns().to_bytes(8, "little") + rest)
    while publisher.matching_status.matching:
        time.sleep(0.01)


main()
