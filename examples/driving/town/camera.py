"""The picture that a camera on the roof of the car takes, drawn straight into an array.

The ground is one picture of the town in perspective; on it the pieces of all things are drawn from
far to near. The same pieces, drawn with numbers for colours, tell which pixels show what.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from . import ground, scenery, shapes
from .geometry import Floats, shifted
from .ground import COARSE, FINE, WEST, Pixels
from .shapes import Pieces
from .world import World

WIDTH, HEIGHT = 640, 480
FOCAL = 320.0
_CENTRE = WIDTH / 2
HORIZON = 220.0
CAMERA_AHEAD, CAMERA_HEIGHT = 0.4, 1.6
_NEAR, _FAR = 0.4, 150.0
_GROUND_FROM, _FINE_FROM = 224, 252
_HAZE_METRES = 240.0
_BITS = 4
_SKY_ABOVE, _SKY_BELOW = (96.0, 146.0, 204.0), (198.0, 212.0, 222.0)

Numbers = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Shown:
    """What is drawn, from far to near: polygons, their colours, and the things they belong to."""

    polygons: list[npt.NDArray[np.int32]]
    colours: list[tuple[float, float, float]]
    things: list[int]


@dataclass(frozen=True)
class Seen:
    """The things near the camera, as it sees them: pieces ahead, to the left and up of it."""

    corners: Floats
    colours: Floats
    distances: Floats
    things: Numbers


class Camera:
    """Takes pictures of a world."""

    def __init__(self, world: World) -> None:
        cv2.setNumThreads(1)
        self._world = world
        self._light = random.Random(f"light {world.seed}").uniform(0.72, 1.08)
        self._ground = ground.picture(world.roads, world.seed, self._light)
        shape = self._ground.shape[:2]
        small = tuple(round(side * FINE / COARSE) for side in shape)
        self._coarse = cv2.resize(self._ground, small, interpolation=cv2.INTER_AREA)
        self._scenery = scenery.build(world.roads, ground.road_mask(world.roads), world.seed)
        self._marks = _marked(self._scenery)
        self._sky = self._sky_picture()

    def render(self, out: Pixels) -> Shown:
        """Draws the picture into an array of `HEIGHT` rows, and says what is on it."""
        if out.shape != (HEIGHT, WIDTH, 3) or out.dtype != np.uint8:
            raise ValueError(
                f"a picture is uint8 of ({HEIGHT}, {WIDTH}, 3), not {out.dtype} of {out.shape}"
            )
        out[:_GROUND_FROM] = self._sky
        self._draw_ground(out)
        shown = self._shown()
        for polygon, colour in zip(shown.polygons, shown.colours, strict=True):
            cv2.fillConvexPoly(out, polygon, colour, cv2.LINE_8, _BITS)
        return shown

    def kind(self, thing: int) -> str:
        """What a thing is, by its number in `Shown`; a light by what it shows."""
        kinds = self._scenery.things.kinds
        if thing < 0:
            return ""
        if thing < len(kinds):
            return self._light_kinds().get(thing, kinds[thing])
        return "car" if thing - len(kinds) < len(self._world.traffic.cars) else "person"

    def _light_kinds(self) -> dict[int, str]:
        world, found = self._world, {}
        for light in self._scenery.lights:
            colour = world.lights.colour(light.junction, light.arrives_from, world.journey.frames)
            found[int(self._scenery.owners[light.lamps["red"].start])] = f"{colour} light"
        return found

    def _place(self) -> tuple[tuple[float, float], float]:
        car = self._world.car
        return shifted(car.place, car.heading, CAMERA_AHEAD), car.heading

    def _sky_picture(self) -> Pixels:
        rows = np.linspace(0.0, 1.0, _GROUND_FROM)[:, None] ** 1.5
        sky = np.array(_SKY_ABOVE) * (1 - rows) + np.array(_SKY_BELOW) * rows
        return np.repeat(np.round(sky * min(1.0, self._light))[:, None], WIDTH, axis=1).astype(
            np.uint8
        )

    def _draw_ground(self, out: Pixels) -> None:
        """Puts the picture of the ground into perspective: from far away a coarser one."""
        for picture, metres, first, last in (
            (self._coarse, COARSE, _GROUND_FROM, _FINE_FROM),
            (self._ground, FINE, _FINE_FROM, HEIGHT),
        ):
            matrix = self._ground_matrix(metres, first)
            edge = tuple(channel * self._light for channel in ground.GRASS)
            cv2.warpPerspective(
                picture,
                matrix,
                (WIDTH, last - first),
                out[first:last],
                cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                cv2.BORDER_CONSTANT,
                edge,
            )

    def _ground_matrix(self, metres: float, first_row: int) -> Floats:
        """From a pixel, counted from a row, to the place in a picture of the ground."""
        (x, y), heading = self._place()
        cos, sin = math.cos(heading), math.sin(heading)
        below = first_row + 0.5 - HORIZON
        # Pixel to (ahead, left, 1), all times the distance of its row below the horizon.
        high = CAMERA_HEIGHT
        rays = np.array(
            [
                [0.0, 0.0, FOCAL * high],
                [-high, 0.0, (_CENTRE - 0.5) * high],
                [0.0, 1.0, below],
            ]
        )
        to_map = np.array(
            [
                [cos / metres, -sin / metres, (x - WEST) / metres - 0.5],
                [sin / metres, cos / metres, (y - WEST) / metres - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )
        matrix: Floats = to_map @ rays
        return matrix

    def _shown(self) -> Shown:
        seen = self._seen()
        order = np.argsort(-seen.distances, kind="stable")
        corners = seen.corners[order]
        haze = 1.0 - np.exp(-seen.distances[order] / _HAZE_METRES)[:, None]
        sky = np.array(_SKY_BELOW) * min(1.0, self._light)
        colours = seen.colours[order] * (1.0 - haze) + sky * haze
        ahead = corners[..., 0]
        flat = np.empty((*ahead.shape, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            flat[..., 0] = _CENTRE - FOCAL * corners[..., 1] / ahead
            flat[..., 1] = HORIZON - FOCAL * corners[..., 2] / ahead
        whole: npt.NDArray[np.bool_] = np.all(ahead > _NEAR, axis=1)
        low, high = flat.min(axis=1), flat.max(axis=1)
        inside = (high > 0).all(axis=1) & (low[:, 0] < WIDTH) & (low[:, 1] < HEIGHT)
        fixed = np.round((np.where(whole[:, None, None], flat, 0.0) - 0.5) * (1 << _BITS))
        polygons = list(fixed.astype(np.int32))
        kept = np.flatnonzero(inside | ~whole)
        for index in np.flatnonzero(~whole):
            polygons[index] = _clipped(corners[index])
        drawn = [int(index) for index in kept if len(polygons[index])]
        things = seen.things[order]
        shades = np.round(colours).tolist()
        return Shown(
            [polygons[index] for index in drawn],
            [tuple(shades[index]) for index in drawn],
            [int(things[index]) for index in drawn],
        )

    def _seen(self) -> Seen:
        """All pieces that are near enough, before the camera, and turn their front to it."""
        standing, moving = self._standing(), self._moving()
        corners = np.concatenate([standing.corners, moving.corners])
        first = corners[:, 0]
        normal = np.cross(corners[:, 1] - first, corners[:, 2] - first)
        faces = np.einsum("pi,pi->p", normal, first) < 0.0
        faces &= (corners[..., 0] > _NEAR).any(axis=1)
        return Seen(
            corners[faces],
            np.concatenate([standing.colours, moving.colours])[faces],
            np.concatenate([standing.distances, moving.distances])[faces],
            np.concatenate([standing.things, moving.things])[faces],
        )

    def _standing(self) -> Seen:
        it = self._scenery
        places = self._to_camera(np.concatenate([it.places, np.zeros((len(it.places), 1))], axis=1))
        near = (places[:, 0] > -12.0) & (places[:, 0] < _FAR)
        near &= np.abs(places[:, 1]) < places[:, 0] + 24.0
        chosen = np.flatnonzero(near[it.owners])
        owners = it.owners[chosen]
        corners = self._to_camera(it.corners[chosen])
        turning = it.turning[chosen]
        own = it.corners[chosen][turning] - np.array([0.0, 0.0, CAMERA_HEIGHT])
        corners[turning] = own + places[owners[turning]][:, None] * np.array([1.0, 1.0, 0.0])
        colours = self._colours()[chosen]
        distances = np.hypot(places[:, 0], places[:, 1])[owners]
        marks = np.where(self._marks[chosen], owners, -1)
        return Seen(corners, colours, distances, marks)

    def _colours(self) -> Floats:
        """The colours of what stands, with the lights that are on."""
        world = self._world
        colours = self._scenery.colours * self._light
        for light in self._scenery.lights:
            name = world.lights.colour(light.junction, light.arrives_from, world.journey.frames)
            colours[light.lamps[name]] = shapes.LAMP_COLOURS[name]
        return colours

    def _moving(self) -> Seen:
        world = self._world
        first = len(self._scenery.things.kinds)
        pieces: list[Pieces] = []
        numbers: list[int] = []
        distances: list[float] = []
        place, _ = self._place()
        bodies = [*world.traffic.cars, *world.pedestrians.bodies]
        for number, body in enumerate(bodies):
            distance = math.dist(body.place, place)
            if distance > _FAR / 2:
                continue
            if number < len(world.traffic.cars):
                made = _car(body.colour % len(shapes.CAR_COLOURS)).placed(body.place, body.heading)
                marks = [-1] + [first + number] * (len(made.corners) - 1)
            else:
                made = shapes.person(body, world.journey.frames).placed(
                    body.place, self._place()[1]
                )
                marks = [first + number] * len(made.corners)
            pieces.append(made)
            numbers += marks
            distances += [distance] * len(made.corners)
        if not pieces:
            return Seen(np.zeros((0, 4, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64))
        found = Pieces.all(pieces)
        colours = found.colours * self._light
        return Seen(self._to_camera(found.corners), colours, np.array(distances), np.array(numbers))

    def _to_camera(self, points: Floats) -> Floats:
        (x, y), heading = self._place()
        cos, sin = math.cos(heading), math.sin(heading)
        dx, dy = points[..., 0] - x, points[..., 1] - y
        up = points[..., 2] - CAMERA_HEIGHT
        return np.stack([dx * cos + dy * sin, dy * cos - dx * sin, up], axis=-1)


_CARS: dict[int, Pieces] = {}


def _car(colour: int) -> Pieces:
    if colour not in _CARS:
        _CARS[colour] = shapes.car(shapes.CAR_COLOURS[colour])
    return _CARS[colour]


def _marked(things: scenery.Scenery) -> npt.NDArray[np.bool_]:
    """Which pieces show what a detector looks for: the fronts of lights and signs."""
    marked = np.zeros(len(things.owners), np.bool_)
    first = 0
    for kind, pieces in zip(things.things.kinds, things.things.parts, strict=True):
        count = len(pieces.corners)
        skipped = shapes.BACKS.get(kind)
        if skipped is not None:
            marked[first + skipped : first + count] = True
        first += count
    return marked


def _clipped(corners: Floats) -> npt.NDArray[np.int32]:
    """The part of a piece that is before the camera, on the picture."""
    kept: list[Floats] = []
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if here[0] > _NEAR:
            kept.append(here)
        if (here[0] > _NEAR) != (there[0] > _NEAR):
            kept.append(here + (_NEAR - here[0]) / (there[0] - here[0]) * (there - here))
    points = [(_CENTRE - FOCAL * p[1] / p[0], HORIZON - FOCAL * p[2] / p[0]) for p in kept]
    limited = np.clip(np.array(points).reshape(-1, 2), -20000.0, 20000.0)
    return np.round((limited - 0.5) * (1 << _BITS)).astype(np.int32)
