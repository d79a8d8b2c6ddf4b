"""A program that plays a bag: a node that publishes its messages, at the tags of their times.

``hprm bag play`` runs it, alone or in one federation with scripts.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import Any

import hprm.ros
from hprm.ros._bags.definitions import class_in
from hprm.ros._bags.errors import BagError
from hprm.ros._bags.qualities import played
from hprm.ros._bags.reading import BagReader
from hprm.ros.executors import ExternalShutdownException
from hprm.ros.node import Node
from hprm.ros.publisher import Publisher
from hprm.ros.qos import QoSProfile

_DEPTH = 10


class Player:
    """A node that publishes the messages of a bag. The first one leaves at once."""

    def __init__(self, bag: BagReader, options: argparse.Namespace) -> None:
        """Make a publisher for each topic that is played."""
        self.node = Node("rosbag2_player")
        self.is_done = False
        self._bag, self._rate, self._loops = bag, options.rate, options.loop
        self._offset = options.start_offset
        renamed = dict(it.split(":=", 1) for it in options.remap)
        self._publishers: dict[str, Publisher[Any]] = {}
        for it in bag.connections(options.topic or None):
            try:
                kind = class_in(bag.path, it)
            except BagError as error:
                print(f"warning: {it.topic} is not played: {error}", file=sys.stderr)
                continue
            name = renamed.get(it.topic, it.topic)
            self._publishers[it.topic] = self.node.create_publisher(kind, name, _quality(it))
        self._messages = self._begin()
        self._next = next(self._messages, None)
        self._first = 0 if self._next is None else self._next[0]
        self._played = 0
        # A timer's period is longer than nothing.
        self._timer = self.node.create_timer(1e-9, self._play)

    def _begin(self) -> Iterator[tuple[int, str, Any]]:
        return self._bag.messages(list(self._publishers), self._offset)

    def _play(self) -> None:
        """Publish all messages of one time, and wait until that of the next ones."""
        time = None if self._next is None else self._next[0]
        while self._next is not None and self._next[0] == time:
            _, topic, message = self._next
            self._publishers[topic].publish(message)
            self._next = next(self._messages, None)
        if self._next is None and self._loops and time is not None:
            self._messages = self._begin()
            self._next = next(self._messages)
            self._played = -1
        if self._next is None:
            # At once: a timer that is due each nanosecond would delay an interrupt.
            self._timer.cancel()
            self.is_done = True
            return
        # Computed from the first message, so that roundings do not add up.
        due = round((self._next[0] - self._first) / self._rate)
        self._timer.timer_period_ns = max(due - self._played, 1)
        self._played = due


def _quality(connection: Any) -> QoSProfile:
    offers = list(getattr(connection.ext, "offered_qos_profiles", ()))
    return played(connection.topic, offers, _DEPTH)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Say what can be typed."""
    parser.add_argument("--rate", type=_positive, default=1.0, help="how many times as fast")
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--start-offset", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--topic", action="append", default=[], help="only this one")
    parser.add_argument("--remap", action="append", default=[], type=_rule, metavar="OLD:=NEW")
    parser.add_argument("bag")


def _positive(text: str) -> float:
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"{text} is not larger than 0")
    return value


def _rule(text: str) -> str:
    if not all(text.partition(":=")):
        raise argparse.ArgumentTypeError(f"{text!r} is not like /old:=/new")
    return text


def _options(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="hprm bag play")
    arguments(parser)
    return parser.parse_args(words)


def _opened(options: argparse.Namespace) -> BagReader:
    bag = BagReader(options.bag)
    if options.loop and bag.info.duration == 0:
        bag.close()
        raise BagError(f"{bag.path} takes no time, so it cannot be played in a loop")
    if options.start_offset * 1e9 > bag.info.duration:
        bag.close()
        takes, offset = bag.info.duration / 1e9, options.start_offset
        raise BagError(f"{bag.path} takes {takes:g} s, and --start-offset {offset:g} is after that")
    return bag


def check(words: list[str]) -> None:
    """Raise a ``BagError`` if what the command line says cannot be played."""
    _opened(_options(words)).close()


def main() -> int:
    """Play a bag. Return the exit code."""
    options = _options(sys.argv[1:])
    hprm.ros.init(args=[])
    try:
        with _opened(options) as bag:
            player = Player(bag, options)
            while not player.is_done:
                hprm.ros.spin_once(player.node)
        hprm.ros.try_shutdown()
    except BagError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except (ExternalShutdownException, KeyboardInterrupt):
        # At any moment, also while it ends.
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
