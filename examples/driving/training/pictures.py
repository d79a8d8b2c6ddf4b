"""Takes pictures of towns with the boxes of what is on them, for the detector to learn from.

    python -m training.pictures out/pictures --count 3000

Seeds below 1000 are kept for judging.
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from town.camera import HEIGHT, WIDTH, Camera
from town.controls import Control
from town.expert import Expert
from town.ground import Pixels
from town.labels import Label, labels
from town.world import Setting, World


def pictures(first_seed: int, per_seed: int = 40) -> Iterator[tuple[Pixels, list[Label]]]:
    """Pictures with their labels, some of each seed, for ever."""
    seed = first_seed
    while True:
        yield from _of_town(seed, per_seed)
        seed += 1


def _of_town(seed: int, count: int) -> Iterator[tuple[Pixels, list[Label]]]:
    rng = random.Random(f"pictures {seed}")
    world = World(seed, Setting(cars=24, crossers=18, strollers=18))
    camera, expert = Camera(world), Expert(world)
    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for _ in range(count):
        for _ in range(rng.randrange(6, 26)):
            control = expert.control()
            # A little astray, so that there are pictures of that, too.
            astray = 0.12 * rng.uniform(-1.0, 1.0)
            world.step(Control(control.throttle, control.steer + astray, control.brake))
        shown = camera.render(picture)
        found = labels(camera, shown)
        if any(not it.faint for it in found):
            yield picture, found
        if world.journey.ended:
            return


def main() -> None:
    """Writes pictures and labels into a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=3000)
    parser.add_argument("--first-seed", type=int, default=1000)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    shape = (options.count, HEIGHT, WIDTH, 3)
    path = options.folder / "pictures.npy"
    stored = np.lib.format.open_memmap(path, "w+", dtype=np.uint8, shape=shape)
    boxes = []
    for number, (picture, found) in enumerate(pictures(options.first_seed)):
        if number == options.count:
            break
        stored[number] = picture
        boxes.append([list(vars(it).values()) for it in found])
        if number % 250 == 0:
            print(f"{number} of {options.count}", flush=True)
    stored.flush()
    (options.folder / "labels.json").write_text(json.dumps(boxes))


if __name__ == "__main__":
    main()
