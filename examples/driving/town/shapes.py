"""What things look like, as flat pieces with four corners: houses, trees, cars, people, lights.

A piece is seen from its front only, the side from which its corners run counter-clockwise; upright
pieces that turn to the camera are made for its heading. It does not say where the camera is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .bodies import CAR_LENGTH, CAR_WIDTH, Body
from .geometry import Floats, Point

Colour = tuple[int, int, int]

CAR_COLOURS: tuple[Colour, ...] = (
    (178, 34, 34),
    (32, 62, 122),
    (214, 214, 208),
    (40, 42, 46),
    (122, 128, 132),
    (190, 150, 40),
    (46, 104, 70),
    (150, 84, 48),
    (86, 60, 110),
)
COATS: tuple[Colour, ...] = (
    (170, 60, 50),
    (50, 80, 140),
    (60, 120, 70),
    (200, 160, 60),
    (90, 60, 100),
    (60, 60, 64),
    (190, 190, 186),
)
_TROUSERS: tuple[Colour, ...] = ((40, 44, 70), (58, 48, 40), (30, 30, 32), (96, 96, 100))
_SKIN: tuple[Colour, ...] = ((224, 180, 150), (168, 120, 86), (110, 74, 52))
_GLASS: Colour = (44, 54, 64)
_TYRE: Colour = (22, 22, 24)

LAMP_COLOURS: dict[str, Colour] = {
    "red": (250, 44, 36),
    "yellow": (255, 190, 40),
    "green": (40, 235, 110),
}
LAMP_OFF: dict[str, Colour] = {"red": (62, 24, 22), "yellow": (62, 50, 22), "green": (20, 56, 36)}
# The housing of a traffic light; how high its middle hangs, and how far behind its stop line.
LIGHT_WIDTH, LIGHT_HEIGHT, LIGHT_MIDDLE = 0.9, 2.4, 5.4
LIGHT_BEYOND = 22.0
# The plate of a stop sign, its middle, and how far right of the lane's middle it stands.
SIGN_SIZE, SIGN_MIDDLE, SIGN_RIGHT = 1.0, 2.3, 3.7
WALKER_HEIGHT = 1.75


@dataclass(frozen=True)
class Pieces:
    """Pieces in space with their colours."""

    corners: Floats
    colours: Floats

    @classmethod
    def of(cls, pieces: list[tuple[Floats, Colour]]) -> Pieces:
        """These pieces."""
        corners = np.array([corners for corners, _ in pieces]).reshape(-1, 4, 3)
        return cls(corners, np.array([colour for _, colour in pieces], float).reshape(-1, 3))

    @classmethod
    def all(cls, parts: list[Pieces]) -> Pieces:
        """The pieces of all parts, in order."""
        corners = np.concatenate([part.corners for part in parts])
        return cls(corners, np.concatenate([part.colours for part in parts]))

    def placed(self, place: Point, heading: float) -> Pieces:
        """The same, turned and moved on the ground."""
        cos, sin = math.cos(heading), math.sin(heading)
        x, y, z = (self.corners[..., axis] for axis in range(3))
        turned = np.stack([x * cos - y * sin + place[0], x * sin + y * cos + place[1], z], axis=-1)
        return Pieces(turned, self.colours)


def upright(left: float, right: float, low: float, high: float, ahead: float = 0.0) -> Floats:
    """A rectangle that faces against x, between two places to the left and two heights."""
    sides = ((right, low), (left, low), (left, high), (right, high))
    return np.array([(ahead, y, z) for y, z in sides])[::-1]


def _disc(radius: float, middle: float, ahead: float, across: float = 0.0) -> list[Floats]:
    """An octagon of three pieces that faces against x."""
    inner = radius * math.tan(math.pi / 8)
    rows = ((-radius, inner), (-inner, radius), (inner, radius), (radius, inner))
    found = []
    for (low, low_half), (high, high_half) in zip(rows, rows[1:], strict=False):
        corners = (
            (low_half, low),
            (-low_half, low),
            (-high_half, high),
            (high_half, high),
        )
        found.append(np.array([(ahead, across + y, middle + z) for y, z in corners]))
    return found


def box(length: float, width: float, low: float, high: float, ahead: float = 0.0) -> list[Floats]:
    """The rear, right, front, left and upper side of a box."""
    x0, x1, y = ahead - length / 2, ahead + length / 2, width / 2
    return [
        np.array([(x0, y, low), (x0, -y, low), (x0, -y, high), (x0, y, high)]),
        np.array([(x0, -y, low), (x1, -y, low), (x1, -y, high), (x0, -y, high)]),
        np.array([(x1, -y, low), (x1, y, low), (x1, y, high), (x1, -y, high)]),
        np.array([(x1, y, low), (x0, y, low), (x0, y, high), (x1, y, high)]),
        np.array([(x0, -y, high), (x1, -y, high), (x1, y, high), (x0, y, high)]),
    ]


def _shaded(sides: list[Floats], colour: Colour) -> list[tuple[Floats, Colour]]:
    """The sides of a box, each with a light of its own."""
    return [
        (side, _scaled(colour, light))
        for side, light in zip(sides, (0.9, 0.78, 0.96, 0.86, 1.08), strict=True)
    ]


def _scaled(colour: Colour, factor: float) -> Colour:
    red, green, blue = (min(255, round(part * factor)) for part in colour)
    return (red, green, blue)


def car(colour: Colour) -> Pieces:
    """A car at the origin that looks along x."""
    half, side = CAR_LENGTH / 2, CAR_WIDTH / 2
    flat = [(-half, -side, 0.02), (half, -side, 0.02), (half, side, 0.02), (-half, side, 0.02)]
    pieces: list[tuple[Floats, Colour]] = [(np.array(flat), (34, 34, 36))]
    for ahead in (-1.35, 1.35):
        pieces += [(it, _TYRE) for it in box(0.66, CAR_WIDTH - 0.04, 0.0, 0.66, ahead)[1:4:2]]
    pieces += _shaded(box(CAR_LENGTH, CAR_WIDTH, 0.28, 0.92), colour)
    cabin = box(2.3, CAR_WIDTH - 0.3, 0.92, 1.45, -0.25)
    pieces += [(it, _GLASS) for it in cabin[:4]] + [(cabin[4], _scaled(colour, 1.05))]
    for left in (-0.92, 0.52):
        rear = upright(left + 0.4, left, 0.6, 0.78, -half - 0.01)
        pieces.append((rear, (150, 22, 20)))
        front = rear[::-1] * np.array([-1.0, 1.0, 1.0])
        pieces.append((front, (236, 232, 206)))
    return Pieces.of(pieces)


def person(body: Body, phase: int) -> Pieces:
    """A pedestrian that faces against x; legs move with the phase."""
    coat = COATS[body.colour % len(COATS)]
    trousers = _TROUSERS[body.colour // 7 % len(_TROUSERS)]
    skin = _SKIN[body.colour // 29 % len(_SKIN)]
    stride = 0.11 * math.sin(phase * 0.45 + body.colour) if body.speed else 0.0
    pieces: list[tuple[Floats, Colour]] = []
    for left, move in ((0.04, stride), (-0.16, -stride)):
        leg = upright(left + 0.13, left, 0.0, 0.86)
        leg[np.isclose(leg[:, 2], 0.0), 1] += move
        pieces.append((leg, trousers))
    pieces.append((upright(0.26, -0.26, 0.78, 1.45), coat))
    pieces += [(it, skin) for it in _disc(0.16, 1.6, 0.0)]
    return Pieces.of(pieces)


def tree(height: float, green: Colour) -> Pieces:
    """A tree that faces against x."""
    pieces: list[tuple[Floats, Colour]] = [(upright(0.14, -0.14, 0.0, 0.5 * height), (84, 64, 46))]
    for across, at, size, light in (
        (0.0, 0.68, 0.3, 0.85),
        (-0.5, 0.6, 0.2, 0.95),
        (0.4, 0.76, 0.2, 1.1),
    ):
        for it in _disc(size * height, at * height, 0.0, across):
            pieces.append((it, _scaled(green, light)))
    return Pieces.of(pieces)


def house(length: float, depth: float, height: float, colour: Colour) -> Pieces:
    """A house at the origin with rows of windows on all sides."""
    pieces: list[tuple[Floats, Colour]] = []
    for number, (side, shade) in enumerate(_shaded(box(length, depth, 0.0, height), colour)[:4]):
        pieces.append((side, shade))
        a, b = side[0, :2], side[1, :2]
        storeys = int(height / 3.0)
        for storey in range(storeys):
            low = 3.0 * storey + 1.0
            for begin, end in ((0.08, 0.3), (0.39, 0.61), (0.7, 0.92)):
                (x0, y0), (x1, y1) = a + begin * (b - a), a + end * (b - a)
                high = low + 1.3
                corners = [(x0, y0, low), (x1, y1, low), (x1, y1, high), (x0, y0, high)]
                pieces.append((np.array(corners), _scaled((96, 112, 128), 1.0 - 0.08 * number)))
    return Pieces.of(pieces)


def light() -> tuple[Pieces, dict[str, slice]]:
    """A traffic light that is seen by cars which drive along x; and which pieces its lamps are."""
    middle, half = LIGHT_MIDDLE, LIGHT_HEIGHT / 2
    edge = LIGHT_WIDTH / 2
    front = upright(edge, -edge, middle - half, middle + half)
    pieces: list[tuple[Floats, Colour]] = [
        (upright(8.0, -8.0, middle + half + 0.02, middle + half + 0.08), (52, 52, 54)),
        (front[::-1], (70, 72, 74)),
        (front, (26, 27, 28)),
    ]
    lamps = {}
    for name, up in (("red", 0.75), ("yellow", 0.0), ("green", -0.75)):
        lamps[name] = slice(len(pieces), len(pieces) + 3)
        pieces += [(it, LAMP_OFF[name]) for it in _disc(0.34, middle + up, -0.02)]
    return Pieces.of(pieces), lamps


def stop_sign() -> Pieces:
    """A stop sign that is seen by cars which drive along x: white letters as a bar."""
    middle, radius = SIGN_MIDDLE, SIGN_SIZE / 2
    pole = upright(0.05, -0.05, 0.0, middle)
    pieces: list[tuple[Floats, Colour]] = [(pole, (120, 122, 124)), (pole[::-1], (120, 122, 124))]
    pieces += [(it[::-1], (134, 136, 138)) for it in _disc(radius, middle, 0.0)]
    pieces += [(it, (232, 230, 226)) for it in _disc(radius, middle, -0.01)]
    pieces += [(it, (190, 24, 30)) for it in _disc(0.9 * radius, middle, -0.02)]
    for left in (-0.33, -0.15, 0.03, 0.21):
        letter = upright(left + 0.11, left, middle - 0.13, middle + 0.13, -0.03)
        pieces.append((letter, (236, 234, 230)))
    return Pieces.of(pieces)


# How many of the first pieces of a thing do not show what it is.
BACKS = {"light": 2, "stop sign": 5}
