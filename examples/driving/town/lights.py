"""Traffic lights: what each shows at which frame. Each road into a junction has green in turn."""

from __future__ import annotations

import random

from .roads import Roads

FRAMES_A_SECOND = 20
DT = 1 / FRAMES_A_SECOND

GREEN, YELLOW, RED = "green", "yellow", "red"
_GREEN_FRAMES, _YELLOW_FRAMES, _CLEAR_FRAMES = 100, 40, 20
_TURN = _GREEN_FRAMES + _YELLOW_FRAMES + _CLEAR_FRAMES


class Lights:
    """The lights of a town; they follow from the frame alone."""

    def __init__(self, roads: Roads, seed: int) -> None:
        rng = random.Random(f"lights {seed}")
        self._junctions = roads.junctions
        self._offsets = [rng.randrange(4 * _TURN) for _ in roads.junctions]

    def colour(self, junction: int, arrives_from: int, frame: int) -> str:
        """What cars see that come to a junction from another one."""
        neighbours = self._junctions[junction].neighbours
        turn, since = divmod(frame + self._offsets[junction], _TURN)
        if neighbours[turn % len(neighbours)] != arrives_from or since >= _TURN - _CLEAR_FRAMES:
            return RED
        return GREEN if since < _GREEN_FRAMES else YELLOW
