"""A stand-in for the package carla: what the driving example uses of it, and a server.

Its town is one road, 40 m straight, a quarter of a circle to the right, and straight on, with a
parked car near its end. As with CARLA, y points to the right of x, and yaw and steering turn right.
``server`` is the one server; CARLA_ABSENT, CARLA_SILENT and CARLA_DIES_AT in the environment set
what is wrong with it.
"""

from __future__ import annotations

import fnmatch
import math
import os
import socket
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

_STRAIGHT, _RADIUS, _LENGTH, _PARKED = 40.0, 20.0, 200.0, 150.0
_WHEELBASE, _MOST_STEER = 2.7, 0.6
_SILENT = (
    "time-out of 10000ms while waiting for the simulator, make sure the simulator is ready "
    "and connected to 127.0.0.1:2000"
)


@dataclass
class Location:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


Vector3D = Location


@dataclass
class Rotation:
    pitch: float = 0.0
    yaw: float = 0.0
    roll: float = 0.0


@dataclass
class Transform:
    location: Location = field(default_factory=Location)
    rotation: Rotation = field(default_factory=Rotation)


@dataclass
class VehicleControl:
    throttle: float = 0.0
    steer: float = 0.0
    brake: float = 0.0


@dataclass
class WorldSettings:
    synchronous_mode: bool = False
    fixed_delta_seconds: float | None = None


@dataclass
class BoundingBox:
    extent: Vector3D = field(default_factory=lambda: Vector3D(2.2, 0.95, 0.8))


@dataclass
class Image:
    frame: int
    raw_data: bytes


@dataclass
class Blueprint:
    id: str
    attributes: dict[str, str] = field(default_factory=dict)

    def set_attribute(self, name: str, value: str) -> None:
        self.attributes[name] = value


class Library(list[Blueprint]):
    def find(self, name: str) -> Blueprint:
        return next(it for it in self if it.id == name)

    def filter(self, pattern: str) -> Library:
        return Library(it for it in self if fnmatch.fnmatch(it.id, pattern))


def _on_road(along: float) -> Transform:
    """The middle of the road after so many metres."""
    turned = min(max(along - _STRAIGHT, 0.0) / _RADIUS, math.pi / 2)
    x = min(along, _STRAIGHT) + _RADIUS * math.sin(turned)
    y = _RADIUS * (1 - math.cos(turned)) + max(0.0, along - _STRAIGHT - _RADIUS * math.pi / 2)
    return Transform(Location(x, y), Rotation(yaw=math.degrees(turned)))


@dataclass
class Waypoint:
    along: float
    lane_width: float = 3.5

    @property
    def transform(self) -> Transform:
        return _on_road(self.along)

    def next(self, metres: float) -> list[Waypoint]:
        onward = self.along + metres
        return [Waypoint(onward)] if onward <= _LENGTH else []


class Map:
    def get_spawn_points(self) -> list[Transform]:
        return [_on_road(2.0), _on_road(4.0)]

    def get_waypoint(self, location: Location) -> Waypoint:
        steps = [0.5 * number for number in range(2 * int(_LENGTH))]
        return Waypoint(min(steps, key=lambda at: _apart(_on_road(at).location, location)))

    def generate_waypoints(self, metres: float) -> list[Waypoint]:
        return [Waypoint(metres * number) for number in range(int(_LENGTH / metres))]

    def get_crosswalks(self) -> list[Location]:
        corners = [(15.0, -3.0), (18.0, -3.0), (18.0, 3.0), (15.0, 3.0), (15.0, -3.0)]
        return [Location(x, y) for x, y in corners]


def _apart(one: Location, other: Location) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)


@dataclass
class Actor:
    id: int
    type_id: str
    place: Transform
    blueprint: Blueprint
    speed: float = 0.0
    bounding_box: BoundingBox = field(default_factory=BoundingBox)
    control: VehicleControl = field(default_factory=VehicleControl)
    heard: Callable[[Any], None] | None = None
    alone: bool = False

    def get_transform(self) -> Transform:
        return self.place

    def get_velocity(self) -> Vector3D:
        yaw = math.radians(self.place.rotation.yaw)
        return Vector3D(self.speed * math.cos(yaw), self.speed * math.sin(yaw))

    def get_control(self) -> VehicleControl:
        return self.control

    def apply_control(self, control: VehicleControl) -> None:
        self.control = control
        server.controls.append(control)

    def set_autopilot(self, on: bool, port: int) -> None:
        self.alone = on and port > 0

    def listen(self, heard: Callable[[Any], None]) -> None:
        self.heard = heard

    def destroy(self) -> bool:
        server.actors.remove(self)
        return True

    def move(self, seconds: float) -> None:
        it = self.control
        self.speed += (3.0 * it.throttle - 7.0 * it.brake - 0.06 * self.speed) * seconds
        self.speed = max(0.0, self.speed)
        location, rotation = self.place.location, self.place.rotation
        yaw = math.radians(rotation.yaw)
        location.x += self.speed * math.cos(yaw) * seconds
        location.y += self.speed * math.sin(yaw) * seconds
        turn = self.speed * math.tan(it.steer * _MOST_STEER) / _WHEELBASE
        rotation.yaw += math.degrees(turn * seconds)


class Actors(list[Actor]):
    def filter(self, pattern: str) -> Actors:
        return Actors(it for it in self if fnmatch.fnmatch(it.type_id, pattern))


class Server:
    """What the server has; tests look into it."""

    def __init__(self) -> None:
        self.settings = WorldSettings()
        self.frame = 100
        self.actors: list[Actor] = []
        self.controls: list[VehicleControl] = []
        self.seeds: list[int] = []
        self.add(Blueprint("vehicle.parked"), _on_road(_PARKED))

    def add(self, blueprint: Blueprint, place: Transform) -> Actor:
        actor = Actor(len(self.actors) + 1, blueprint.id, place, blueprint)
        self.actors.append(actor)
        return actor


class World:
    def get_settings(self) -> WorldSettings:
        it = server.settings
        return WorldSettings(it.synchronous_mode, it.fixed_delta_seconds)

    def apply_settings(self, settings: WorldSettings) -> int:
        server.settings = settings
        return server.frame

    def get_map(self) -> Map:
        return Map()

    def get_blueprint_library(self) -> Library:
        names = ["vehicle.tesla.model3", "sensor.camera.rgb", "sensor.other.collision"]
        return Library(Blueprint(name) for name in names)

    def try_spawn_actor(self, blueprint: Blueprint, place: Transform) -> Actor | None:
        near = [it for it in server.actors if _apart(it.place.location, place.location) < 5.0]
        return None if near else server.add(blueprint, place)

    def spawn_actor(self, blueprint: Blueprint, place: Transform, attach_to: Actor) -> Actor:
        return server.add(blueprint, place)

    def get_actors(self) -> Actors:
        return Actors(server.actors)

    def tick(self) -> int:
        if server.frame - 101 >= int(os.environ.get("CARLA_DIES_AT", "100000")):
            raise RuntimeError(_SILENT)
        server.frame += 1
        for actor in server.actors:
            actor.move(server.settings.fixed_delta_seconds or 0.0)
        for actor in server.actors:
            if actor.heard is not None and actor.type_id == "sensor.camera.rgb":
                size = [int(actor.blueprint.attributes[f"image_size_{it}"]) for it in "yx"]
                blue_first = bytes((10, 20, server.frame % 256, 255))
                actor.heard(Image(server.frame, blue_first * (size[0] * size[1])))
        return server.frame


class TrafficManager:
    def set_synchronous_mode(self, on: bool) -> None:
        assert on

    def set_random_device_seed(self, seed: int) -> None:
        server.seeds.append(seed)


class Client:
    def __init__(self, host: str, port: int) -> None:
        self.place = (host, port)
        if not os.environ.get("CARLA_ABSENT"):
            # Others may have their own there at the same time.
            listener = socket.create_server(self.place, reuse_port=True)
            weakref.finalize(self, listener.close)

    def set_timeout(self, seconds: float) -> None:
        assert seconds > 0

    def get_world(self) -> World:
        if os.environ.get("CARLA_SILENT"):
            raise RuntimeError(_SILENT)
        return World()

    def get_trafficmanager(self, port: int) -> TrafficManager:
        assert port != self.place[1]
        return TrafficManager()


server = Server()
