"""What the application needs of a simulator, and the town as one.

`highway.py` and `carla_simulator.py` are others; they are loaded only if they are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from town.birdview import SHAPE, Birdview
from town.camera import HEIGHT, WIDTH, Camera
from town.controls import Control
from town.world import Setting, World

from .options import Options

Pixels = npt.NDArray[np.uint8]
PICTURE, BIRDVIEW = (HEIGHT, WIDTH, 3), SHAPE


class SimulatorError(Exception):
    """A simulator cannot start, or has ended; the message says which and why."""


@dataclass(frozen=True)
class State:
    """What the car's instruments say, and its navigation.

    ``route`` has points of the route ahead, as pairs of metres ahead and to the left; ``progress``
    is the metres that the car has driven along it.
    """

    frame: int
    speed: float
    steer: float
    route: tuple[float, ...]
    progress: float


class Simulator(Protocol):
    """A world with a car in it. A frame is observed first, then a control leads to the next one."""

    def state(self) -> State:
        """The state at this frame."""
        ...

    def take_picture(self, out: Pixels) -> None:
        """Writes what the camera sees at this frame."""
        ...

    def look_down(self, out: Pixels) -> None:
        """Writes the bird's-eye view at this frame."""
        ...

    def step(self, control: Control) -> None:
        """Goes on to the next frame."""
        ...

    def ended(self) -> str:
        """Why the journey has ended; empty while it goes on."""
        ...

    def summary(self) -> str:
        """How far the car has come, and what it did wrong, in one line."""
        ...

    def close(self) -> None:
        """Gives back what the simulator holds."""
        ...


def state_of(world: World) -> State:
    """The state of a town at this frame."""
    car, along = world.car, world.journey.along
    points = world.route.navigation(along, car.place, car.heading)
    route = tuple(value for point in points for value in point)
    return State(world.journey.frames, car.speed, car.steer, route, along)


class Town:
    """The embedded simulator."""

    def __init__(self, seed: int, frames: int, setting: Setting | None = None) -> None:
        self._frames = frames
        self.world = World(seed, setting or Setting())
        self._camera = Camera(self.world)
        self._birdview = Birdview(self.world)

    def state(self) -> State:
        return state_of(self.world)

    def take_picture(self, out: Pixels) -> None:
        self._camera.render(out)

    def look_down(self, out: Pixels) -> None:
        self._birdview.render(out)

    def step(self, control: Control) -> None:
        self.world.step(control)

    def ended(self) -> str:
        journey = self.world.journey
        return journey.ended or ("enough" if journey.frames >= self._frames else "")

    def summary(self) -> str:
        journey, length = self.world.journey, self.world.route.path.length
        wrong = f"red lights run: {journey.red_lights}, stop signs run: {journey.stop_signs}"
        end = journey.ended or "on the way"
        return f"frame {journey.frames}: {journey.along:.1f} m of {length:.1f} m, {end}; {wrong}"

    def close(self) -> None:
        return None


def open_simulator(options: Options) -> Simulator:
    """The simulator that the options ask for."""
    # Both need packages that the others do not.
    if options.sim == "highway":
        from .highway import Highway

        return Highway(options.seed, options.frames)
    if options.sim == "carla":
        from .carla_simulator import Carla

        return Carla(options.seed, options.frames, options.host, options.port)
    return Town(options.seed, options.frames)
