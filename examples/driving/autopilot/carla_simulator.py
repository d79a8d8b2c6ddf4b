"""CARLA as a simulator, over the network, in synchronous mode: each frame waits for its control.

A camera and a sensor of collisions ride on the car; the bird's-eye view is drawn from the map and
from what the server says of the others. CARLA's y points to the right of x, and its yaw and
steering turn right, so they change their sign here.
"""

from __future__ import annotations

import math
import queue
import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from town.bodies import Body
from town.camera import CAMERA_AHEAD, CAMERA_HEIGHT, FOCAL, HEIGHT, HORIZON, WIDTH
from town.controls import Control
from town.geometry import Point
from town.lights import DT
from town.overhead import CROSSINGS, ROAD, Overhead, checked

from .simulator import Pixels, SimulatorError, State
from .way import Way

_TIMEOUT = 10.0
_ROUTE_METRES, _OTHERS = 330, 20
_CAR = "vehicle.tesla.model3"
# The pieces of the map that are nearer may be on the view.
_SEEN = 42.0


class Carla:
    """A car in the world of a CARLA server."""

    def __init__(self, seed: int, frames: int, host: str, port: int) -> None:
        try:
            import carla  # type: ignore[import-untyped]
        except ImportError as error:
            raise SimulatorError(
                f"the package carla cannot be loaded: {error}; it needs "
                "`pip install -r requirements-simulators.txt`, in the root of the repository"
            ) from None
        self._carla: Any = carla
        self._where = f"CARLA at {host}:{port}"
        self._frames, self._frame, self._random = frames, 0, random.Random(seed)
        self._actors: list[Any] = []
        self._pictures: queue.Queue[Any] = queue.Queue()
        self._hit = ""
        self._lost = False
        self._before: Any = None
        try:
            client = carla.Client(host, port)
            _call(host, port)
            self._begin(client, port, seed)
        except SimulatorError:
            self.close()
            raise
        except RuntimeError as error:
            self.close()
            raise SimulatorError(
                f"{self._where} does not answer: {error}; start it there, "
                "or name another one with --host and --port"
            ) from None

    def _begin(self, client: Any, port: int, seed: int) -> None:
        client.set_timeout(_TIMEOUT)
        self._world = client.get_world()
        self._before = self._world.get_settings()
        settings = self._world.get_settings()
        settings.synchronous_mode = True
        settings.fixed_delta_seconds = DT
        self._world.apply_settings(settings)
        self._map = self._world.get_map()
        places = self._map.get_spawn_points()
        self._random.shuffle(places)
        self._vehicle = self._place_car(places)
        self._place_sensors()
        # The server's own traffic, which keeps the same time.
        traffic = client.get_trafficmanager(port + 6000)
        traffic.set_synchronous_mode(True)
        traffic.set_random_device_seed(seed)
        self._place_others(places, port + 6000)
        self._roads = _roads(self._map)
        self._crossings = _crossings(self._map)
        self._advance()
        self._way = Way(self._route())

    def _place_car(self, places: list[Any]) -> Any:
        blueprint = self._world.get_blueprint_library().find(_CAR)
        while places:
            vehicle = self._world.try_spawn_actor(blueprint, places.pop())
            if vehicle is not None:
                self._actors.append(vehicle)
                return vehicle
        raise SimulatorError(f"{self._where} has no free place for the car in its map")

    def _place_sensors(self) -> None:
        carla, library = self._carla, self._world.get_blueprint_library()
        camera = library.find("sensor.camera.rgb")
        angle = math.degrees(2.0 * math.atan(WIDTH / 2 / FOCAL))
        wanted = {"image_size_x": WIDTH, "image_size_y": HEIGHT, "fov": angle}
        for name, value in wanted.items():
            camera.set_attribute(name, str(value))
        # The town's camera sees its horizon above the middle: this one looks down as far.
        down = math.degrees(math.atan((HEIGHT / 2 - HORIZON) / FOCAL))
        place = carla.Transform(
            carla.Location(x=CAMERA_AHEAD, z=CAMERA_HEIGHT), carla.Rotation(pitch=-down)
        )
        eye = self._world.spawn_actor(camera, place, attach_to=self._vehicle)
        self._actors.append(eye)
        eye.listen(self._pictures.put)
        bumper = self._world.spawn_actor(
            library.find("sensor.other.collision"), carla.Transform(), attach_to=self._vehicle
        )
        self._actors.append(bumper)
        bumper.listen(self._collided)

    def _collided(self, _: Any) -> None:
        self._hit = "collision"

    def _place_others(self, places: list[Any], port: int) -> None:
        models = list(self._world.get_blueprint_library().filter("vehicle.*"))
        for place in places[:_OTHERS]:
            other = self._world.try_spawn_actor(self._random.choice(models), place)
            if other is not None:
                self._actors.append(other)
                other.set_autopilot(True, port)

    def _route(self) -> list[Point]:
        """A random way along lanes, a point a metre."""
        here = self._map.get_waypoint(self._vehicle.get_transform().location)
        points = [_point(here.transform.location)]
        for _ in range(_ROUTE_METRES):
            onward = here.next(1.0)
            if not onward:
                break
            here = self._random.choice(onward)
            points.append(_point(here.transform.location))
        return points

    def _advance(self) -> None:
        """Computes the next frame, and waits for its picture."""
        number = self._world.tick()
        while True:
            try:
                picture = self._pictures.get(timeout=_TIMEOUT)
            except queue.Empty:
                raise RuntimeError("its camera sends no pictures") from None
            if picture.frame >= number:
                break
        self._picture = picture

    @contextmanager
    def _answering(self) -> Iterator[None]:
        """Says in one error that the server has gone."""
        try:
            yield
        except RuntimeError as error:
            self._lost = True
            raise SimulatorError(
                f"{self._where} does not answer any more, at frame {self._frame}: {error}"
            ) from None

    def state(self) -> State:
        with self._answering():
            steer = -self._vehicle.get_control().steer
            return self._way.state(self._frame, self._car(), steer)

    def take_picture(self, out: Pixels) -> None:
        pixels = np.frombuffer(self._picture.raw_data, np.uint8).reshape(HEIGHT, WIDTH, 4)
        out[:] = pixels[..., 2::-1]

    def look_down(self, out: Pixels) -> None:
        with self._answering():
            own, actors = self._car(), self._world.get_actors()
            vehicles = [it for it in actors.filter("vehicle.*") if it.id != self._vehicle.id]
            cars = [(_body(it), it.bounding_box.extent) for it in vehicles]
            walkers = [_body(it) for it in actors.filter("walker.pedestrian.*")]
        overhead = Overhead(own, checked(out))
        out[:] = 0
        for line, width in self._roads:
            if math.dist(line[0], own.place) < _SEEN:
                overhead.line(ROAD, np.array(line), width)
        for corners in self._crossings:
            if math.dist(corners[0], own.place) < _SEEN:
                overhead.fill(CROSSINGS, np.array(corners))
        self._way.draw(overhead)
        for car, half in cars:
            if overhead.sees(car):
                overhead.car(car, 2 * half.x, 2 * half.y)
        for walker in filter(overhead.sees, walkers):
            overhead.pedestrian(walker, walker.speed)

    def step(self, control: Control) -> None:
        told = self._carla.VehicleControl(
            throttle=control.throttle, steer=-control.steer, brake=control.brake
        )
        with self._answering():
            self._vehicle.apply_control(told)
            self._advance()
            self._frame += 1
            self._way.follow(self._car())

    def ended(self) -> str:
        return self._hit or self._way.end() or ("enough" if self._frame >= self._frames else "")

    def summary(self) -> str:
        return self._way.summary(self._frame, self.ended())

    def close(self) -> None:
        """Takes the car and the others out of the world, and lets its time go on as before."""
        if self._lost:
            return
        try:
            for actor in reversed(self._actors):
                actor.destroy()
            if self._before is not None:
                self._world.apply_settings(self._before)
        except RuntimeError:
            # A server that is gone has nothing left to give back.
            self._lost = True
        self._actors.clear()

    def _car(self) -> Body:
        return _body(self._vehicle)


def _call(host: str, port: int) -> None:
    """Say at once that no server listens there; CARLA's client tries for its whole time-out."""
    try:
        socket.create_connection((host, port), _TIMEOUT).close()
    except OSError as error:
        raise RuntimeError(error.strerror or str(error)) from None


def _point(location: Any) -> Point:
    return (location.x, -location.y)


def _body(actor: Any) -> Body:
    transform, velocity = actor.get_transform(), actor.get_velocity()
    x, y = _point(transform.location)
    speed = math.hypot(velocity.x, velocity.y)
    return Body(x, y, -math.radians(transform.rotation.yaw), speed)


def _roads(world_map: Any) -> list[tuple[list[Point], float]]:
    """Short pieces of all lanes, with their widths."""
    pieces: list[tuple[list[Point], float]] = []
    for waypoint in world_map.generate_waypoints(2.0):
        here = waypoint.transform
        yaw = math.radians(here.rotation.yaw)
        x, y = _point(here.location)
        ahead = (x + 2.2 * math.cos(yaw), y - 2.2 * math.sin(yaw))
        pieces.append(([(x, y), ahead], waypoint.lane_width))
    return pieces


def _crossings(world_map: Any) -> list[list[Point]]:
    """The polygons of crossings: each ends with the corner that it begins with."""
    found: list[list[Point]] = []
    corners: list[Point] = []
    for location in world_map.get_crosswalks():
        corner = _point(location)
        if corners and math.dist(corner, corners[0]) < 1e-6:
            found.append(corners)
            corners = []
        else:
            corners.append(corner)
    return found
