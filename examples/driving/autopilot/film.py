"""A film of the drive: what the camera saw, with what was detected, what was planned, and the tags.

It draws what it is given, and writes a video; it decides nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from town import birdview as above
from town.camera import CAMERA_HEIGHT, FOCAL, HEIGHT, HORIZON, WIDTH
from town.controls import Control
from town.lights import FRAMES_A_SECOND

from .lookout import Sight
from .simulator import Pixels, State

_SIDE = 240
SHAPE = (HEIGHT, WIDTH + _SIDE, 3)
_BOXES = {
    "red light": (255, 70, 60),
    "yellow light": (255, 200, 60),
    "green light": (70, 235, 120),
    "stop sign": (255, 90, 170),
    "car": (90, 180, 255),
    "person": (255, 170, 90),
}
_PLAN, _TEXT, _FAINT = (80, 150, 255), (235, 235, 235), (110, 110, 115)
_BACK = (28, 29, 33)
# How far a plan is drawn, in metres, and what turns steering into curvature.
_REACH, _WHEELBASE, _MOST_STEER = 14.0, 2.7, 0.6


class FilmError(Exception):
    """The film cannot be written; the message says where and why."""


@dataclass(frozen=True)
class Scene:
    """What one frame of the film shows."""

    tag: tuple[int, int]
    picture: Pixels
    birdview: Pixels
    state: State
    plan: Control
    sight: Sight
    control: Control


class Film:
    """A video file that grows by one frame at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = av.open(str(path), "w")
            stream = self._file.add_stream("libx264", rate=FRAMES_A_SECOND)
        except (OSError, av.FFmpegError) as error:
            raise self._failed(error) from None
        except ValueError:
            raise FilmError(
                f"the film {path} has a name of no kind of film: name it drive.mp4, for example"
            ) from None
        stream.height, stream.width = SHAPE[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"preset": "veryfast", "crf": "24"}
        stream.thread_count = 1
        self._stream = stream

    def add(self, scene: Scene) -> None:
        """Adds a frame."""
        frame = av.VideoFrame.from_ndarray(draw(scene), format="rgb24")
        try:
            self._file.mux(self._stream.encode(frame))
        except (OSError, av.FFmpegError) as error:
            raise self._failed(error) from None

    def close(self) -> None:
        """Writes what is left, so that the file can be played."""
        try:
            self._file.mux(self._stream.encode())
            self._file.close()
        except (OSError, av.FFmpegError) as error:
            raise self._failed(error) from None

    def _failed(self, error: Exception) -> FilmError:
        reason = getattr(error, "strerror", None) or str(error)
        return FilmError(f"the film {self._path} cannot be written: {reason}")


def draw(scene: Scene) -> Pixels:
    """One frame of the film."""
    frame = np.empty(SHAPE, np.uint8)
    frame[:] = _BACK
    frame[:, :WIDTH] = scene.picture
    _draw_plan(frame, scene.control)
    for it in scene.sight.detections:
        colour = _BOXES[it.kind]
        low, high = (round(it.left), round(it.top)), (round(it.right), round(it.bottom))
        cv2.rectangle(frame, low, high, colour, 1)
        place = (low[0], max(10, low[1] - 3))
        _write(frame, f"{it.kind} {it.score:.2f}", place, colour, 0.36)
    seen = above.colours(scene.birdview)
    size = (_SIDE, _SIDE)
    frame[:_SIDE, WIDTH:] = cv2.resize(seen, size, interpolation=cv2.INTER_NEAREST)
    _draw_panel(frame, scene)
    return frame


def _draw_plan(frame: Pixels, control: Control) -> None:
    """Where the car goes if it keeps its steering, as a line on the road."""
    curvature = math.tan(control.steer * _MOST_STEER) / _WHEELBASE
    points: list[tuple[int, int]] = []
    for metres in np.arange(2.5, _REACH, 0.5):
        angle = curvature * float(metres)
        ahead = metres if abs(curvature) < 1e-6 else math.sin(angle) / curvature
        left = 0.0 if abs(curvature) < 1e-6 else (1 - math.cos(angle)) / curvature
        if ahead > 1.5:
            column = WIDTH / 2 - FOCAL * left / ahead
            points.append((round(column), round(HORIZON + FOCAL * CAMERA_HEIGHT / ahead)))
    picture = frame[:, :WIDTH]
    cv2.polylines(picture, [np.array(points, np.int32)], False, _PLAN, 2, cv2.LINE_AA)


def _draw_panel(frame: Pixels, scene: Scene) -> None:
    """Tag, speed, and what is done, below the bird's-eye view."""
    left, state, control = WIDTH + 12, scene.state, scene.control
    time, microstep = scene.tag
    lines = (
        f"tag ({time / 1e9:g} s, {microstep})",
        f"frame {state.frame}, {state.progress:.0f} m",
        f"{3.6 * state.speed:.0f} km/h",
    )
    for number, line in enumerate(lines):
        _write(frame, line, (left, _SIDE + 24 + 20 * number), _TEXT, 0.45)
    held = scene.sight.advice.brake > 0 or scene.sight.advice.throttle < scene.plan.throttle
    word = "the detector holds the car back" if held else "the agent drives"
    _write(frame, word, (left, _SIDE + 92), _BOXES["red light"] if held else _FAINT, 0.38)
    bars = (
        ("throttle", control.throttle, _BOXES["green light"]),
        ("brake", control.brake, _BOXES["red light"]),
        ("steer", control.steer, _PLAN),
    )
    for number, (name, value, colour) in enumerate(bars):
        row = _SIDE + 124 + 30 * number
        _write(frame, name, (left, row), _FAINT, 0.38)
        _draw_bar(frame, row, value, colour, middle=name == "steer")


def _draw_bar(
    frame: Pixels, row: int, value: float, colour: tuple[int, int, int], middle: bool
) -> None:
    left, right = WIDTH + 84, WIDTH + _SIDE - 14
    cv2.rectangle(frame, (left, row - 9), (right, row), (50, 51, 56), -1)
    origin = (left + right) // 2 if middle else left
    # To the left is to the left, although it is above zero.
    length = -value * (right - left) / 2 if middle else value * (right - left)
    end = origin + round(length)
    cv2.rectangle(frame, (min(origin, end), row - 9), (max(origin, end), row), colour, -1)


def _write(
    frame: Pixels, text: str, place: tuple[int, int], colour: tuple[int, int, int], size: float
) -> None:
    cv2.putText(frame, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
