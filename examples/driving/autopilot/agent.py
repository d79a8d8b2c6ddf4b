"""Agents: they drive by the bird's-eye view and the state, and know nothing of lights and signs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt
from town.birdview import SHAPE
from town.controls import Control, follow, speed_to_stop, steer_to

from .network import MODELS, Network
from .simulator import Pixels, State

# How many numbers of the state a network reads.
STATE = 8
_LIMIT, _CURVE = 8.0, 5.0
# Rows of the view per metre, and the row of the car.
_PIXELS_A_METRE, _CAR_ROW = 2, 48
_ROUTE, _CROSSINGS, _CARS, _MOTION, _PEDESTRIANS = 1, 2, 3, 4, 5


class Agent(Protocol):
    """Drives."""

    def drive(self, birdview: Pixels, state: State) -> Control:
        """What to do at a frame."""
        ...


def state_vector(state: State) -> npt.NDArray[np.float32]:
    """The state as a network reads it."""
    values = [state.speed / 8.0, state.steer, *(metres / 8.0 for metres in state.route)]
    return np.array(values, np.float32)


def action_of(wanted: float, steer: float) -> tuple[float, float]:
    """The action of a network that stands for a speed and a steering; both from -1 to 1."""
    return (2.0 * wanted / _LIMIT - 1.0, steer)


def control_of(action: npt.NDArray[np.floating], speed: float) -> Control:
    """The control for an action of a network, at a speed."""
    wanted, steer = (min(max(float(value), -1.0), 1.0) for value in action)
    throttle, brake = follow(speed, _LIMIT * (wanted + 1.0) / 2.0)
    return Control(throttle, steer, brake)


class PolicyAgent:
    """Drives by a network that was trained by `training/train_policy.py`."""

    def __init__(self, path: Path = MODELS / "policy.onnx") -> None:
        inputs = {"birdview": (1, *SHAPE), "state": (1, STATE)}
        self._network = Network(path, inputs, {"action": (1, 2)})

    def drive(self, birdview: Pixels, state: State) -> Control:
        """What to do at a frame."""
        vector = state_vector(state)
        action = self._network.run(birdview=birdview[None], state=vector[None])[0]
        return control_of(action, state.speed)


class GeometricAgent:
    """Steers to the route, and stops before what is on it in the bird's-eye view."""

    def drive(self, birdview: Pixels, state: State) -> Control:
        """What to do at a frame."""
        near, far = state.route[2:4], state.route[4:6]
        turn = abs(math.atan2(far[1], far[0]))
        limit = _LIMIT if turn < 0.35 else _CURVE
        wanted = min(limit, speed_to_stop(self._free(birdview) - 6.0))
        throttle, brake = follow(state.speed, wanted)
        return Control(throttle, steer_to(near[0], near[1]), brake)

    def _free(self, birdview: Pixels) -> float:
        """How many metres the route is free."""
        route = birdview[_ROUTE] > 127
        taken = (birdview[_CARS] > 127) | (birdview[_MOTION] > 127) | (birdview[_PEDESTRIANS] > 127)
        rows = np.flatnonzero((route & taken)[: _CAR_ROW - 4].any(axis=1))
        return (_CAR_ROW - int(rows.max())) / _PIXELS_A_METRE if len(rows) else 1000.0


def open_agent(name: str) -> Agent:
    """The agent of this name."""
    return PolicyAgent() if name == "policy" else GeometricAgent()
