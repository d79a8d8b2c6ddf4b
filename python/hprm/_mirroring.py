"""``hprm mirror``: what passes a connection of a running federation, on a key of Zenoh.

``watch`` gives the messages and ``_payloads`` makes bytes of their values. Here they leave: on a
plain key, or as the topic of a node of ROS 2. The federation does not wait for this; what it has
missed, or could not send, it counts and tells.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Protocol

from hprm import _hprm
from hprm._hprm import WatchedMessage
from hprm._payloads import Form, Payload, Unsendable, as_json, message_of, raw
from hprm._watching import WatchError

if TYPE_CHECKING:
    import zenoh

#: The node of ROS 2 that has the topic.
_NODE = "/hprm_mirror"


class Sender(Protocol):
    """Where values go."""

    #: As the user knows it.
    where: str

    def send(self, message: WatchedMessage) -> None:
        """Send a value, or raise ``Unsendable``."""


def mirror(options: argparse.Namespace) -> int:
    """Mirror a connection until its federation ends. Return the exit code."""
    try:
        return _mirror(options)
    except WatchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0


def _mirror(options: argparse.Namespace) -> int:
    from hprm.ros._zenoh.session import BridgeError, Settings, open_session

    kind = None if options.type is None else _class_of(options.type)
    try:
        settings = Settings.of(options.zenoh, options.domain_id, [])
        # Where there is nothing to mirror, no session is opened.
        with _hprm.watch_ports(
            [options.port], options.of, options.wait, False, options=True
        ) as messages:
            session = open_session(settings.endpoint, _tell)
            try:
                sender = _sender(session, settings.domain, options, kind)
                print(f"{options.port} is on {sender.where}; Ctrl-C ends", flush=True)
                _send_all(messages, sender)
            finally:
                session.close()  # type: ignore[no-untyped-call]
    except BridgeError as error:
        message, _, hint = str(error).partition("\n  hint: ")
        raise WatchError(message, hint or None) from None
    print("the federation has ended", file=sys.stderr)
    return 0


def _sender(
    session: zenoh.Session, domain: int, options: argparse.Namespace, kind: Any
) -> Topic | Key:
    if options.topic is not None:
        return Topic(session, domain, "/" + options.topic.strip("/"), options.type, kind)
    forms: dict[str, Form] = {"raw": raw, "json": as_json, "cdr": lambda it: _cdr(kind, it)}
    return Key(session, options.key, forms[options.form])


def _send_all(messages: Iterable[WatchedMessage], sender: Sender) -> None:
    """Send all values, and say what has not been sent."""
    missed, unsent = 0, Counter[str]()
    # What passed before this began to send is none of it.
    begun: set[str] = set()
    try:
        for message in messages:
            if message.missed and message.port in begun:
                if not missed:
                    _tell(f"warning: messages of {message.port} pass faster than they are mirrored")
                missed += message.missed
            begun.add(message.port)
            try:
                sender.send(message)
            except (Unsendable, WatchError) as error:
                why = error.message if isinstance(error, WatchError) else str(error)
                unsent[why] += 1
                if unsent[why] == 1:
                    _tell(f"warning: a value of {message.port} is not mirrored: {why}")
    finally:
        if missed or unsent:
            counts = f"{missed} passed too fast, {unsent.total()} have no such form"
            _tell(f"warning: not all messages were mirrored: {counts}")


class Key:
    """A plain key: any program that uses Zenoh can subscribe to it."""

    def __init__(self, session: zenoh.Session, key: str, form: Form) -> None:
        """Declare a publisher. Raises ``WatchError`` if there can be none."""
        import zenoh

        try:
            if "*" in key:
                raise WatchError(f"{key!r} is no key to send to: `*` stands for several keys")
            self._publisher = session.declare_publisher(key)
        except zenoh.ZError as error:
            why = str(error).partition(" at /")[0]
            raise WatchError(
                f"{key!r} is no key of Zenoh: {why}", "one is robot/camera/image"
            ) from None
        self._encoding = zenoh.Encoding
        self._form = form
        self.where = f"the key {key}"

    def send(self, message: WatchedMessage) -> None:
        """Send a value, and its tag as the attachment."""
        data, encoding = self._form(message.value)
        tag = message.tag
        about: dict[str, Any] = {"port": message.port, "sent": message.sent}
        if tag is not None:
            about["tag"] = [tag.time, tag.microstep]
        self._publisher.put(
            data, encoding=self._encoding(encoding), attachment=json.dumps(about).encode()
        )


class Topic:
    """A topic of ROS 2, as nodes see it that run with rmw_zenoh."""

    def __init__(
        self, session: zenoh.Session, domain: int, name: str, type_: str, kind: Any
    ) -> None:
        """Declare a node and its publisher."""
        from hprm.ros._graph import Endpoint
        from hprm.ros._zenoh.arrivals import Arrivals
        from hprm.ros._zenoh.endpoints import Local

        local = Local(session, domain, Arrivals(_tell))
        quality = {"reliability": "RELIABLE", "durability": "VOLATILE", "depth": 10}
        local.declare(0, Endpoint("publisher", _NODE, name, type_, quality))
        found = local.publisher(0, name)
        assert found is not None, "it has just been declared"
        # What is declared lasts as long as this.
        self._local = local
        self._publisher, self._numbers = found
        self._kind = kind
        self.where = f"the topic {name} of ROS 2, as {type_}"

    def send(self, message: WatchedMessage) -> None:
        """Send a value; a header without a stamp gets the time of the tag."""
        made = message_of(self._kind, message.value)
        _stamp(made, message.sent if message.tag is None else message.tag.time)
        self._publisher.put(_serialized(made), attachment=self._numbers.attachment().pack())


def _cdr(kind: Any, value: Any) -> Payload:
    return Payload(_serialized(message_of(kind, value)), "application/cdr")


def _serialized(message: Any) -> bytes:
    from hprm.ros._messages.cdr import SERIALIZER, SerializationError

    try:
        return bytes(SERIALIZER.serialize(message))
    except SerializationError as error:
        raise Unsendable(str(error)) from None


def _stamp(message: Any, time: int) -> None:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None and not (stamp.sec or stamp.nanosec):
        stamp.sec, stamp.nanosec = divmod(time, 1_000_000_000)


def _class_of(name: str) -> Any:
    from hprm.ros._messages import DefinitionError, class_of

    try:
        kind = class_of(name)
    except (DefinitionError, LookupError) as error:
        raise WatchError(str(error.args[0])) from None
    if not hasattr(kind, "get_fields_and_field_types"):
        raise WatchError(f"{name} is no type of messages", "one is std_msgs/msg/String")
    return kind


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
