"""What stands in a town: houses and trees beside its roads, its lights and its signs.

Every thing has a number, by which its pieces are drawn together and labelled.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from . import shapes
from .geometry import Floats, Point, corners_of, shifted
from .ground import MASK, WEST
from .roads import HALF_ROAD, REACH, Roads
from .shapes import Pieces

Numbers = npt.NDArray[np.int64]

_WALLS: tuple[shapes.Colour, ...] = (
    (176, 150, 124),
    (196, 184, 160),
    (150, 96, 78),
    (164, 164, 160),
    (202, 190, 130),
    (128, 140, 150),
    (180, 120, 100),
)
_GREENS: tuple[shapes.Colour, ...] = ((58, 104, 50), (76, 118, 54), (48, 92, 60))
_PAVEMENT_EDGE = HALF_ROAD + 4.0


@dataclass
class Things:
    """Things with their pieces: kind and place by thing, and to which thing each piece belongs."""

    kinds: list[str] = field(default_factory=list)
    places: list[Point] = field(default_factory=list)
    parts: list[Pieces] = field(default_factory=list)
    owners: list[int] = field(default_factory=list)
    turning: list[bool] = field(default_factory=list)

    def add(self, kind: str, place: Point, pieces: Pieces, turns: bool = False) -> int:
        """Adds a thing. The pieces of one that turns are around the origin and face the camera."""
        number = len(self.kinds)
        self.kinds.append(kind)
        self.places.append(place)
        self.parts.append(pieces)
        self.owners += [number] * len(pieces.corners)
        self.turning += [turns] * len(pieces.corners)
        return number


@dataclass(frozen=True)
class TrafficLight:
    """Which light a thing is, and which of the town's pieces its lamps are."""

    junction: int
    arrives_from: int
    lamps: dict[str, slice]


@dataclass(frozen=True)
class Scenery:
    """All that stands."""

    things: Things
    lights: list[TrafficLight]
    corners: Floats
    colours: Floats
    owners: Numbers
    places: Floats
    turning: npt.NDArray[np.bool_]


def build(roads: Roads, mask: npt.NDArray[np.uint8], seed: int) -> Scenery:
    """The scenery of a seed, beside these roads."""
    rng = random.Random(f"scenery {seed}")
    things = Things()
    _houses(things, roads, mask, rng)
    _trees(things, roads, mask, rng)
    lights = _control(things, roads)
    pieces = Pieces.all(things.parts)
    return Scenery(
        things,
        lights,
        pieces.corners,
        pieces.colours,
        np.array(things.owners),
        np.array(things.places),
        np.array(things.turning),
    )


def _houses(things: Things, roads: Roads, mask: npt.NDArray[np.uint8], rng: random.Random) -> None:
    """Houses along the roads, wherever there is room."""
    taken = mask.copy()
    for start, end in roads.roads:
        a, b = roads.junctions[start].centre, roads.junctions[end].centre
        heading, length = roads.heading(start, end), math.dist(a, b)
        for side in (-1.0, 1.0):
            along = 10.0
            while along < length - 8.0:
                front, depth = rng.uniform(9.0, 16.0), rng.uniform(8.0, 11.0)
                height, wall = rng.uniform(4.5, 15.0), rng.choice(_WALLS)
                left = side * (_PAVEMENT_EDGE + rng.uniform(0.8, 3.0) + depth / 2)
                middle = shifted(a, heading, along + front / 2, left)
                if _is_free(taken, corners_of(middle, heading, front + 7.0, depth + 7.0)):
                    pieces = shapes.house(front, depth, height, wall).placed(middle, heading)
                    things.add("house", middle, pieces)
                    _take(taken, corners_of(middle, heading, front - 5.0, depth - 5.0))
                along += front + rng.uniform(1.5, 6.0)


def _trees(things: Things, roads: Roads, mask: npt.NDArray[np.uint8], rng: random.Random) -> None:
    for start, end in roads.roads:
        a, b = roads.junctions[start].centre, roads.junctions[end].centre
        heading, length = roads.heading(start, end), math.dist(a, b)
        for side in (-1.0, 1.0):
            for along in np.arange(REACH + 7.0, length - REACH - 6.0, 11.0):
                draw, height = rng.random(), rng.uniform(4.5, 7.5)
                middle = shifted(a, heading, float(along), side * (HALF_ROAD + 3.4))
                if draw < 0.45 and _is_free(mask, corners_of(middle, heading, 3.0, 3.0)):
                    pieces = shapes.tree(height, rng.choice(_GREENS))
                    things.add("tree", middle, pieces, turns=True)


def _control(things: Things, roads: Roads) -> list[TrafficLight]:
    """Lights beyond the junctions that have them, signs at the others."""
    lights: list[TrafficLight] = []
    for lane in roads.lanes:
        junction = roads.junctions[lane.end]
        if lane.inside or junction.kind == "bend":
            continue
        x, y, heading = lane.path.at(lane.path.length)
        if junction.kind == "stop":
            place = shifted((x, y), heading, 0.3, -shapes.SIGN_RIGHT)
            things.add("stop sign", place, shapes.stop_sign().placed(place, heading))
            continue
        place = shifted((x, y), heading, shapes.LIGHT_BEYOND)
        pieces, lamps = shapes.light()
        first = len(things.owners)
        things.add("light", place, pieces.placed(place, heading))
        moved = {name: slice(first + at.start, first + at.stop) for name, at in lamps.items()}
        lights.append(TrafficLight(junction.number, lane.start, moved))
    return lights


def _cells(mask: npt.NDArray[np.uint8], corners: Floats) -> Numbers:
    """The places in the mask of points all over a box."""
    steps = np.linspace(0.0, 1.0, 24)
    one, other = corners[1] - corners[0], corners[3] - corners[0]
    points = corners[0] + steps[:, None, None] * one + steps[None, :, None] * other
    cells = np.floor((points.reshape(-1, 2) - WEST) / MASK).astype(np.int64)
    inside: Numbers = np.clip(cells, 0, mask.shape[0] - 1)
    return inside


def _is_free(mask: npt.NDArray[np.uint8], corners: Floats) -> bool:
    cells = _cells(mask, corners)
    return not mask[cells[:, 1], cells[:, 0]].any()


def _take(mask: npt.NDArray[np.uint8], corners: Floats) -> None:
    cells = _cells(mask, corners)
    mask[cells[:, 1], cells[:, 0]] = 255
