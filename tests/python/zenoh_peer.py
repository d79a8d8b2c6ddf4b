"""A node of ROS 2 as those elsewhere are: a session of Zenoh, all keys and bytes written out."""

from __future__ import annotations

import json
import queue
import struct
import time
from collections.abc import Callable
from typing import Any

import zenoh
from tcp_ports import free_ports

STRING = (
    "std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
)
IMAGE = (
    "sensor_msgs::msg::dds_::Image_/"
    "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
)
ADD = (
    "example_interfaces::srv::dds_::AddTwoInts_/"
    "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
)
#: The default profile of publishers: reliable, volatile, the last ten.
TEN = "::,10:,:,:,,"

GID = bytes(range(16))
WAIT_S = 30


def text(data: str) -> bytes:
    """A std_msgs/String as bytes."""
    encoded = data.encode() + b"\0"
    return b"\0\x01\0\0" + struct.pack("<I", len(encoded)) + encoded


def beside(number: int, gid: bytes = GID) -> bytes:
    """An attachment as today's versions write it."""
    return struct.pack("<qq", number, 1_700_000_000_000_000_000) + b"\x10" + gid


def beside_named(number: int, gid: bytes = GID) -> bytes:
    """An attachment as versions before April 2025 wrote it."""
    return (
        b"\x0fsequence_number"
        + struct.pack("<q", number)
        + b"\x10source_timestamp"
        + struct.pack("<q", 1_700_000_000_000_000_000)
        + b"\x0asource_gid\x10"
        + gid
    )


class Peer:
    """A session that is the router, or one that connects to a port."""

    def __init__(self, port: int | None = None) -> None:
        """Open it."""
        self.port = free_ports(1)[0] if port is None else port
        where = json.dumps([f"tcp/127.0.0.1:{self.port}"])
        config = zenoh.Config()
        config.insert_json5("mode", '"router"' if port is None else '"peer"')
        config.insert_json5("listen/endpoints", where if port is None else '["tcp/127.0.0.1:0"]')
        config.insert_json5("connect/endpoints", "[]" if port is None else where)
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("timestamping/enabled", "true")
        config.insert_json5("transport/shared_memory/enabled", "false")
        self.session = zenoh.open(config)
        self.option = f"--zenoh=tcp/127.0.0.1:{self.port}"
        self._tokens: queue.Queue[tuple[bool, str]] = queue.Queue()
        self.seen: list[tuple[bool, str]] = []
        self._kept: list[Any] = []

    def token(self, rest: str, domain: int = 0) -> Any:
        """Show an entity: all that is behind the identity of the session."""
        return self.keep(
            self.session.liveliness().declare_token(
                f"@ros2_lv/{domain}/{self.session.zid()}/{rest}"
            )
        )

    def watch(self, domain: int = 0) -> None:
        """See the entities of others."""
        self.keep(
            self.session.liveliness().declare_subscriber(
                f"@ros2_lv/{domain}/**",
                lambda it: self._tokens.put((it.kind == zenoh.SampleKind.PUT, str(it.key_expr))),
                history=True,
            )
        )

    def await_token(self, part: str, is_there: bool = True) -> str:
        """Wait for a token with this in it, or for its end; return the token."""
        while True:
            for found, key in self.seen:
                if found == is_there and part in key:
                    return key
            self.seen.append(self._tokens.get(timeout=WAIT_S))

    def subscribe(self, key: str, declare: Callable[..., Any] | None = None, **more: Any) -> Any:
        """Return a queue of the samples of a key."""
        samples: queue.Queue[Any] = queue.Queue()
        if declare is None:
            self.keep(self.session.declare_subscriber(key, samples.put, **more))
        else:
            self.keep(declare(self.session, key, samples.put, **more))
        return samples

    def put(self, key: str, payload: bytes, attachment: bytes) -> None:
        """Publish."""
        wait = zenoh.CongestionControl.BLOCK
        self.session.put(key, payload, attachment=attachment, congestion_control=wait)

    def keep(self, declared: Any) -> Any:
        """Keep what ends when nothing refers to it."""
        self._kept.append(declared)
        return declared

    def ask(self, key: str, payload: bytes, attachment: bytes) -> tuple[bytes, bytes]:
        """Send a request, and return the response with its attachment."""
        replies: queue.Queue[Any] = queue.Queue()
        self.session.get(
            key,
            replies.put,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            payload=payload,
            attachment=attachment,
            timeout=WAIT_S,
        )
        reply = replies.get(timeout=WAIT_S)
        assert reply.ok is not None, reply.err.payload.to_string()
        return reply.ok.payload.to_bytes(), reply.ok.attachment.to_bytes()

    def close(self) -> None:
        """End."""
        self.session.close()


def numbers(sample: Any) -> tuple[int, bytes]:
    """Return the number and the identity beside a message, whose time must be about now."""
    data = sample.attachment.to_bytes()
    assert len(data) == 33 and data[16] == 16
    number, sent = struct.unpack("<qq", data[:16])
    assert abs(time.time_ns() - sent) < 3600 * 10**9
    return number, data[17:]
