"""What the command line of a program asks for, behind `--`."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

AGENTS = ("policy", "geometric")
SIMULATORS = ("town", "highway", "carla")
DETECTORS = ("colours", "network", "off")


@dataclass(frozen=True)
class Options:
    """How to drive, and for how long."""

    sim: str
    host: str
    port: int
    seed: int
    frames: int
    agent: str
    detector: str
    slow: float
    slow_frames: int
    film: str
    measure: str


def whole(least: int, most: int = 10**9) -> Callable[[str], int]:
    """A type of arguments: a whole number within these limits."""

    def number(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f"{text!r} is not a whole number from {least} to {most}"
            )
        return value

    return number


def seconds(text: str) -> float:
    """A type of arguments: a time in seconds."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 3600.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds from 0 to 3600")
    return value


def options(words: Sequence[str] | None = None) -> Options:
    """The options of these words, or of the command line."""
    parser = argparse.ArgumentParser(
        prog="driving",
        description="Drives through a town.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument(
        "--sim", choices=SIMULATORS, default=SIMULATORS[0], help="which simulator has the car"
    )
    parser.add_argument("--host", default="127.0.0.1", help="of the server, for --sim carla")
    parser.add_argument(
        "--port", type=whole(1, 65535), default=2000, help="of the server, for --sim carla"
    )
    parser.add_argument("--seed", type=whole(0), default=6, help="which town")
    parser.add_argument("--frames", type=whole(1), default=300, help="how many frames at most")
    parser.add_argument("--agent", choices=AGENTS, default=AGENTS[0], help="what drives")
    parser.add_argument(
        "--detector", choices=DETECTORS, default=DETECTORS[0], help="what finds lights and signs"
    )
    parser.add_argument(
        "--slow",
        type=seconds,
        metavar="SECONDS",
        default=0.0,
        help="how much longer the detector takes",
    )
    parser.add_argument(
        "--slow-frames",
        type=whole(0),
        metavar="N",
        default=10**9,
        help="for how many frames, from the 20th on",
    )
    parser.add_argument("--film", metavar="FILE", default="drive.mp4", help="of DrivingFilm.lf")
    parser.add_argument(
        "--measure", metavar="FILE", default="", help="gets how long each frame took, as JSON"
    )
    return Options(**vars(parser.parse_args(sys.argv[1:] if words is None else words)))
