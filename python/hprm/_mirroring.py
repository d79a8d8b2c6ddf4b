"""``hprm mirror``: what passes a connection of a running federation, on a key of Zenoh.

``watch`` gives the messages and ``_payloads`` makes bytes of their values. Here they leave: on a
plain key, or as the topic of a node of ROS 2. The federation does not wait for this; what it has
missed, or could not send, it counts and tells.
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Protocol

from hprm import _hprm
from hprm._hprm import WatchedMessage
from hprm._payloads import Form, Payload, Unsendable, as_json, raw
from hprm._viewing import run_to_end
from hprm._watching import WatchError

if TYPE_CHECKING:
    import zenoh

#: The node of ROS 2 that has the topic.
_NODE = "/hprm_mirror"

#: The most characters of a key: Zenoh fails with those that do not fit into one of its packets.
_LONGEST_KEY = 1024

#: How many reasons are told why values are not sent; each may name a value, so there may be many.
_REASONS = 5

#: For how many seconds the session may tell others that it ends.
_CLOSING_S = 2.0


class Sender(Protocol):
    """Where values go."""

    #: As the user knows it.
    where: str

    def send(self, message: WatchedMessage) -> None:
        """Send a value, or raise ``Unsendable``."""


def mirror(options: argparse.Namespace) -> int:
    """Mirror a connection until its federation ends. Return the exit code."""
    # They end it as Ctrl-C does, so that what was not sent is told.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    return run_to_end(lambda: _mirror(options))


def _mirror(options: argparse.Namespace) -> None:
    from hprm.ros._zenoh.session import BridgeError, Settings, open_session, why

    kind = None if options.type is None else _class_of(options.type)
    if options.topic is None:
        _check_key(options.key)
        if kind is not None and options.form != "cdr":
            raise WatchError("--type is for messages of ROS 2", "use --as cdr, or --topic")
    else:
        options.topic = _full_name(options.topic)
    try:
        # A key has no domain.
        domain = "0" if options.topic is None else options.domain_id
        settings = Settings.of(options.zenoh, domain, [])
        # Where there is nothing to mirror, no session is opened.
        with _hprm.watch_ports(
            [options.port], options.of, options.wait, False, options=True
        ) as messages:
            session = open_session(settings.endpoint, _tell)
            import zenoh

            try:
                sender = _sender(session, settings.domain, options, kind)
                _say(f"{options.port} is on {sender.where}; Ctrl-C ends")
                _send_all(messages, sender)
            except zenoh.ZError as error:
                raise WatchError(f"Zenoh fails: {why(error)}") from None
            finally:
                _close(session)
    except BridgeError as error:
        message, _, hint = str(error).partition("\n  hint: ")
        raise WatchError(message, hint or None) from None


def _sender(session: zenoh.Session, domain: int, options: argparse.Namespace, kind: Any) -> Sender:
    if options.topic is not None:
        return Topic(session, domain, options.topic, kind)
    if options.form == "cdr":
        return Key(session, options.key, _as_cdr(kind))
    form: Form = {"raw": raw, "json": as_json}[options.form]
    return Key(session, options.key, lambda it: form(it.value))


def _send_all(messages: Iterable[WatchedMessage], sender: Sender) -> None:
    """Send all values, and say what has not been sent."""
    missed = unsent = 0
    told: set[str] = set()
    # What passed before is none of this, also if the next message tells that it was missed.
    begins, begun = time.time_ns(), set[str]()
    try:
        for message in messages:
            if message.missed and message.port in begun:
                if not missed:
                    _tell(f"warning: messages of {message.port} pass faster than they are mirrored")
                missed += message.missed
            if message.sent >= begins:
                begun.add(message.port)
            try:
                sender.send(message)
            except (Unsendable, WatchError) as error:
                why = error.message if isinstance(error, WatchError) else str(error)
                unsent += 1
                if why not in told and len(told) < _REASONS:
                    told.add(why)
                    _tell(f"warning: a value of {message.port} is not mirrored: {why}")
    finally:
        if missed or unsent:
            counts = f"{missed} passed too fast, {unsent} have no such form"
            _tell(f"warning: not all messages were mirrored: {counts}")


class Key:
    """A plain key: any program that uses Zenoh can subscribe to it."""

    def __init__(
        self, session: zenoh.Session, key: str, form: Callable[[WatchedMessage], Payload]
    ) -> None:
        """Declare a publisher."""
        import zenoh

        self._publisher = session.declare_publisher(key)
        self._encoding = zenoh.Encoding
        self._form = form
        self.where = f"the key {key}"

    def send(self, message: WatchedMessage) -> None:
        """Send a value, and its tag as the attachment."""
        data, encoding = self._form(message)
        tag = message.tag
        about: dict[str, Any] = {"port": message.port, "sent": message.sent}
        if tag is not None:
            about["tag"] = [tag.time, tag.microstep]
        self._publisher.put(
            data, encoding=self._encoding(encoding), attachment=json.dumps(about).encode()
        )


class Topic:
    """A topic of ROS 2, as nodes see it that run with rmw_zenoh."""

    def __init__(self, session: zenoh.Session, domain: int, name: str, kind: Any) -> None:
        """Declare a node and its publisher."""
        from hprm.ros._graph import Endpoint
        from hprm.ros._messages import type_name
        from hprm.ros._zenoh.arrivals import Arrivals
        from hprm.ros._zenoh.endpoints import Local

        local, type_ = Local(session, domain, Arrivals(_tell)), type_name(kind)
        quality = {"reliability": "RELIABLE", "durability": "VOLATILE", "depth": 10}
        local.declare(0, Endpoint("publisher", _NODE, name, type_, quality))
        found = local.publisher(0, name)
        assert found is not None, "it has just been declared"
        # What is declared lasts as long as this.
        self._local = local
        self._publisher, self._numbers = found
        self._form = _as_cdr(kind)
        self.where = f"the topic {name} of ROS 2, as {type_}"

    def send(self, message: WatchedMessage) -> None:
        """Send a value."""
        data = self._form(message).data
        self._publisher.put(data, attachment=self._numbers.attachment().pack())


def _as_cdr(kind: Any) -> Callable[[WatchedMessage], Payload]:
    """Return what makes bytes of values, as ROS 2 writes messages of a class.

    A header without a stamp gets the time of the tag.
    """
    from hprm.ros._filling import message_of
    from hprm.ros._messages.cdr import SERIALIZER, SerializationError

    def cdr(message: WatchedMessage) -> Payload:
        made = message_of(kind, message.value)
        _stamp(made, message.sent if message.tag is None else message.tag.time)
        try:
            return Payload(bytes(SERIALIZER.serialize(made)), "application/cdr")
        except SerializationError as error:
            raise Unsendable(str(error)) from None

    return cdr


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


def _check_key(key: str) -> None:
    """Refuse what is no key, or stands for several, before anything is opened."""
    wrong = None
    if not key or key.startswith("/") or key.endswith("/") or "//" in key:
        wrong = "each part between two `/` has a name"
    elif found := re.search(r"[*$?#\s]|[^ -~\u00a0-\U0010ffff]", key):
        wrong = f"{found[0]!r} has no place in a key to send to"
    elif key.startswith("@"):
        wrong = "keys with @ at their beginning are Zenoh's own"
    elif len(key) > _LONGEST_KEY:
        wrong, key = f"it has more than {_LONGEST_KEY} characters", f"{key[:20]}..."
    if wrong is not None:
        raise WatchError(f"{key!r} is no key: {wrong}", "one is robot/camera/image")


def _full_name(topic: str) -> str:
    """Return the full name of a topic."""
    from hprm.ros._names import full_topic_error

    name = topic if topic.startswith("/") else f"/{topic}"
    wrong = full_topic_error(name)
    if wrong is not None:
        shown = topic if len(topic) < 60 else f"{topic[:20]}..."
        raise WatchError(f"{shown!r} is no name of a topic: {wrong[0]}", "one is /robot/speed")
    return name


def _close(session: zenoh.Session) -> None:
    """Close the session, but do not wait for a subscriber that stands still."""
    closing = threading.Thread(target=session.close, name="closing", daemon=True)
    closing.start()
    closing.join(_CLOSING_S)


def _say(text: str) -> None:
    """Print the only line of the standard output; that nothing reads it changes nothing."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        return
    except OSError as error:
        raise WatchError(f"the standard output cannot be written: {error.strerror}") from None


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
