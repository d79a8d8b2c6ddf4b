"""A program that records a bag: a node that subscribes to topics when it learns of them.

``hprm bag record`` runs it, usually in one federation with scripts.
"""

from __future__ import annotations

import argparse
import sys
from datetime import datetime
from functools import partial
from typing import Any

import hprm.ros
from hprm.ros._bags.errors import BagError
from hprm.ros._bags.qualities import recorded
from hprm.ros._bags.recording import BagWriter, Mode, Recorded
from hprm.ros._messages import DefinitionError, class_of
from hprm.ros.executors import ExternalShutdownException
from hprm.ros.node import Node
from hprm.ros.qos import QoSProfile, ReliabilityPolicy

_DEPTH = 1_000
_LOOKS_EVERY_S = 0.1

#: What nodes tell of themselves, which is recorded where it is asked for by name.
_OF_NODES = ("/parameter_events", "/rosout")


class Recorder:
    """A node that puts the messages of some topics, or of all, into a bag, with their tags' times.

    A topic whose type is given is a connection from the start, so that no message is missed. Others
    are subscribed to when they are there.
    """

    def __init__(self, bag: BagWriter, topics: list[str]) -> None:
        """Look for topics from now on."""
        self.node = Node("rosbag2_recorder")
        self._bag = bag
        self._wanted: set[str] = set()
        self._known: set[str] = set()
        #: Topics that the bag does not know yet: its file has the policies that are known by then.
        self._later: dict[str, Any] = {}
        for it in topics:
            name, _, kind = it.partition("=")
            topic = self.node.resolve_topic_name(name)
            self._wanted.add(topic)
            if kind:
                self._subscribe(topic, kind)
        self.node.create_timer(_LOOKS_EVERY_S, self._look)

    @property
    def missing(self) -> list[str]:
        """The topics that were asked for and have never been there."""
        return sorted(self._wanted - self._known)

    def _look(self) -> None:
        for topic, types in self.node.get_topic_names_and_types():
            is_wanted = topic in self._wanted or not (self._wanted or topic in _OF_NODES)
            if is_wanted and topic not in self._known:
                self._subscribe(topic, types[0])

    def _subscribe(self, topic: str, name: str) -> None:
        self._known.add(topic)
        try:
            kind = class_of(name)
        except (LookupError, DefinitionError) as error:
            self._warn(f"{topic} is not recorded: {error.args[0]}")
            return
        # It gets the messages of publishers of any quality.
        quality = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.node.create_subscription(kind, topic, partial(self._put, topic, kind), quality)
        self._later[topic] = kind

    def _add(self, topic: str) -> None:
        kind = self._later.pop(topic)
        there = self.node.get_publishers_info_by_topic(topic)
        self._bag.add(topic, kind, [recorded(it.qos_profile) for it in there])

    def finish(self) -> None:
        """Have topics in the bag, too, of which no message has come."""
        for topic in list(self._later):
            self._add(topic)

    def _put(self, topic: str, kind: Any, message: Any) -> None:
        if topic in self._later:
            self._add(topic)
        self._bag.put(topic, kind, self.node.get_clock().now().nanoseconds, message)

    def _warn(self, text: str) -> None:
        print(f"warning: {text}", file=sys.stderr)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Say what can be typed."""
    parser.add_argument("--output", help="the bag; rosbag2_ and the time if there is none")
    parser.add_argument("--storage", choices=["mcap", "sqlite3"], default="mcap")
    parser.add_argument(
        "--wait", action="store_true", help="let callbacks wait for the disk, and lose nothing"
    )
    parser.add_argument("topics", nargs="*", metavar="TOPIC[=TYPE]", help="all if there are none")


def _options(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="hprm bag record")
    arguments(parser)
    return parser.parse_args(words)


def _opened(options: argparse.Namespace) -> tuple[str, BagWriter]:
    path = options.output or datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S")
    mode: Mode = "wait" if options.wait else "drop"
    return path, BagWriter(path, storage=options.storage, mode=mode)


def check(words: list[str]) -> None:
    """Raise a ``BagError`` if the bag that the command line names cannot be written."""
    _, bag = _opened(_options(words))
    bag.abort()


def main() -> int:
    """Record a bag until the program is asked to end. Return the exit code."""
    try:
        return _record(_options(sys.argv[1:]))
    except KeyboardInterrupt:
        # Before anything is recorded.
        return 130


def _record(options: argparse.Namespace) -> int:
    hprm.ros.init(args=[])
    try:
        path, bag = _opened(options)
        recorder = Recorder(bag, options.topics)
        try:
            hprm.ros.spin(recorder.node)
        except (ExternalShutdownException, KeyboardInterrupt):
            pass
        except BaseException:
            bag.abort()
            raise
        recorder.finish()
        _tell(path, bag.close(), recorder.missing)
    except BagError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    hprm.ros.try_shutdown()
    return 0


def _tell(path: str, recorded: Recorded, missing: list[str]) -> None:
    count = sum(recorded.written.values())
    print(f"{path}: {count} messages of {len(recorded.written)} topics")
    for topic, lost in sorted(recorded.lost.items()):
        print(f"warning: {lost} messages of {topic} are lost", file=sys.stderr)
    for topic in missing:
        print(f"warning: there was no topic {topic}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
