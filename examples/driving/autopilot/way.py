"""A car on its route in a simulator that is not the town: how far it is, and what it sees ahead.

Places are in metres, x to the east and y to the north; headings and steering turn left.
"""

from __future__ import annotations

from collections.abc import Sequence

from town.bodies import Body
from town.geometry import Floats, Path, Point, seen_from
from town.overhead import ROUTE, ROUTE_AHEAD, ROUTE_WIDTH, Overhead
from town.route import LOOKAHEAD

from .simulator import State

# How far the middle of a car may be beside its route, and how close to its end it has arrived.
_LEFT, _REST = 4.0, 8.0


class Way:
    """The route, and how the car follows it."""

    def __init__(self, points: Sequence[Point]) -> None:
        self._path = Path.through(list(points))
        self.along, self.sideways = 0.0, 0.0

    @property
    def length(self) -> float:
        """Metres from its begin to its end."""
        return self._path.length

    def follow(self, car: Body) -> None:
        """Takes notice of where the car is now."""
        self.along, self.sideways = self._path.project(car.place, self.along)

    def end(self) -> str:
        """Why the journey has ended, as far as the route tells; empty while it goes on."""
        if abs(self.sideways) > _LEFT:
            return "off the road"
        return "completed" if self.along >= self.length - _REST else ""

    def state(self, frame: int, car: Body, steer: float) -> State:
        """The state of the car at a frame."""
        route: list[float] = []
        for ahead in LOOKAHEAD:
            x, y, _ = self._path.at(self.along + ahead)
            route += seen_from((x, y), car.place, car.heading)
        return State(frame, car.speed, steer, tuple(route), self.along)

    def summary(self, frame: int, end: str) -> str:
        """How far it is at a frame, in a line; ``end`` is why the journey has ended."""
        told = "on the way" if end in ("", "enough") else end
        return f"frame {frame}: {self.along:.1f} m of {self.length:.1f} m, {told}"

    def draw(self, overhead: Overhead) -> None:
        """Draws what lies ahead of it."""
        overhead.line(ROUTE, self._ahead(), ROUTE_WIDTH)

    def _ahead(self) -> Floats:
        begin = max(0, int(self.along / self._path.step) - 2)
        return self._path.points[begin : begin + ROUTE_AHEAD + 2]
