"""Lets the expert drive through a town: `python -m town --seed 6 --picture 600:frame.png`."""

from __future__ import annotations

import argparse

import cv2
import numpy as np

from .birdview import SHAPE, Birdview, colours
from .camera import HEIGHT, WIDTH, Camera
from .expert import Expert
from .world import World


def main() -> None:
    """Drives, draws a frame if one is asked for, and says how it went."""
    parser = argparse.ArgumentParser(prog="python -m town", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--picture", metavar="FRAME:FILE", help="what is seen at a frame")
    options = parser.parse_args()
    frame, _, file = (options.picture or "").partition(":")
    if options.picture and not (frame.isdigit() and cv2.haveImageWriter(file)):
        parser.error(f"--picture {options.picture}: it must be a frame and a file, 600:frame.png")
    world = World(options.seed)
    expert = Expert(world)
    while not world.journey.ended:
        if frame == str(world.journey.frames) and not cv2.imwrite(file, _seen(world)):
            parser.error(f"{file} cannot be written")
        world.step(expert.control())
    journey, route = world.journey, world.route
    if frame and int(frame) >= journey.frames:
        parser.error(f"--picture {options.picture}: the journey has {journey.frames} frames")
    print(f"{journey.ended}: {route.path.length:.0f} m, {len(route.stop_lines)} lights and signs")
    print(f"run: {journey.red_lights} red lights, {journey.stop_signs} stop signs")


def _seen(world: World) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    """The camera's picture beside the bird's-eye view, as OpenCV orders colours."""
    picture, view = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros(SHAPE, np.uint8)
    Camera(world).render(picture)
    Birdview(world).render(view)
    flags = cv2.INTER_NEAREST
    above = cv2.resize(colours(view), (HEIGHT, HEIGHT), interpolation=flags)
    return np.concatenate([picture, above], axis=1)[:, :, ::-1].copy()


if __name__ == "__main__":
    main()
