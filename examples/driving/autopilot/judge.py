"""Judges drivers over many journeys: `python -m autopilot.judge --agent policy`.

The parts of the application drive here without HPRM, one frame after the other, as fast as they
can. The seeds are those that training leaves alone.
"""

from __future__ import annotations

import argparse
import json
import math
import random
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from town.birdview import SHAPE, Birdview
from town.camera import HEIGHT, WIDTH, Camera
from town.controls import FREE, Advice, Control
from town.expert import Expert
from town.expert import Rules as Truth
from town.world import Setting, World

from .agent import open_agent
from .lookout import Lookout, open_eyes
from .options import DETECTORS, whole
from .simulator import state_of

AGENTS = ("expert", "policy", "geometric", "constant", "random")
Drive = Callable[[], Control]
Advise = Callable[[], Advice]


@dataclass(frozen=True)
class Verdict:
    """How one journey went."""

    seed: int
    ended: str
    driven: float
    frames: int
    red_lights: int
    stop_signs: int


def journey(seed: int, agent: str, detector: str, setting: Setting | None = None) -> Verdict:
    """Drives the route of a seed to its end.

    With the detector ``perfect`` the rules know what is true.
    """
    world = World(seed, setting or Setting())
    drive, advise = _driver(world, agent), _adviser(world, detector)
    while not world.journey.ended:
        world.step(advise().applied(drive()))
    it, length = world.journey, world.route.path.length
    driven = 1.0 if it.completed else it.along / length
    return Verdict(seed, it.ended, driven, it.frames, it.red_lights, it.stop_signs)


def _driver(world: World, agent: str) -> Drive:
    if agent == "expert":
        return Expert(world).in_traffic
    if agent == "constant":
        return lambda: Control(throttle=0.4)
    if agent == "random":
        rng = random.Random(f"driver {world.seed}")
        return lambda: Control(rng.random(), rng.uniform(-1.0, 1.0), rng.random() / 4)
    birdview, made = Birdview(world), open_agent(agent)
    view = np.empty(SHAPE, np.uint8)

    def drive() -> Control:
        birdview.render(view)
        return made.drive(view, state_of(world))

    return drive


def _adviser(world: World, detector: str) -> Advise:
    if detector == "off":
        return lambda: FREE
    if detector == "perfect":
        return Truth(world).advice
    camera, lookout = Camera(world), Lookout(open_eyes(detector))
    picture = np.empty((HEIGHT, WIDTH, 3), np.uint8)

    def advise() -> Advice:
        camera.render(picture)
        return lookout.look(picture, world.car.speed).advice

    return advise


def interval(successes: int, of: int) -> tuple[float, float]:
    """Wilson's interval for a share, with 95 percent confidence."""
    z, share = 1.96, successes / of
    middle = (share + z * z / (2 * of)) / (1 + z * z / of)
    half = z * math.sqrt(share * (1 - share) / of + z * z / (4 * of * of)) / (1 + z * z / of)
    return (max(0.0, middle - half), min(1.0, middle + half))


def main() -> None:
    """Judges one driver, and prints what came out as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--agent", choices=AGENTS, default="policy")
    parser.add_argument("--detector", choices=(*DETECTORS, "perfect"), default=DETECTORS[0])
    parser.add_argument("--episodes", type=whole(1), default=30)
    parser.add_argument("--first-seed", type=whole(0), default=0)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.episodes)
    verdicts = [journey(seed, options.agent, options.detector) for seed in seeds]
    completed = sum(it.ended == "completed" for it in verdicts)
    low, high = interval(completed, len(verdicts))
    print(
        json.dumps(
            {
                "agent": options.agent,
                "detector": options.detector,
                "completed": completed,
                "of": len(verdicts),
                "interval": [round(low, 3), round(high, 3)],
                "driven": round(sum(it.driven for it in verdicts) / len(verdicts), 3),
                "red_lights": sum(it.red_lights for it in verdicts),
                "stop_signs": sum(it.stop_signs for it in verdicts),
                "journeys": [asdict(it) for it in verdicts],
            }
        )
    )


if __name__ == "__main__":
    main()
