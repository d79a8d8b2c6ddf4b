"""Stands for CARLA's Python package: what the paper's programs use of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class VehicleControl:
    """What moves a car."""

    throttle: float = 0.0
    steer: float = 0.0
    brake: float = 0.0
