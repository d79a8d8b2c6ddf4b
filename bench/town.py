"""How many frames a second the simulator of examples/driving makes on one core.

A frame is a step of the town, the picture of its camera and its bird's-eye view. The time that
the process has computed counts, so that other work on the machine does not.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "driving"))

import numpy as np
from town.birdview import SHAPE, Birdview
from town.camera import HEIGHT, WIDTH, Camera
from town.expert import Expert
from town.world import World

FRAMES = 300


def main() -> None:
    """Measures journeys in some towns, and prints a line for each."""
    picture, view = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros(SHAPE, np.uint8)
    for seed in range(5):
        world = World(seed)
        camera, birdview, expert = Camera(world), Birdview(world), Expert(world)
        seconds = 0.0
        for _ in range(FRAMES):
            control = expert.control()
            begin = time.process_time()
            world.step(control)
            camera.render(picture)
            birdview.render(view)
            seconds += time.process_time() - begin
        print(f"town {seed}: {FRAMES / seconds:.0f} frames a second")


if __name__ == "__main__":
    main()
