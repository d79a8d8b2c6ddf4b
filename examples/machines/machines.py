"""A camera and a planner on two machines: the same program on both."""

import numpy as np
import numpy.typing as npt

import hprm

Image = npt.NDArray[np.uint8]


class Camera(hprm.Reactor):
    image = hprm.Output(Image)
    tick = hprm.Timer("50 ms")

    def __init__(self) -> None:
        self.number = 0

    @hprm.reaction(tick, effects=[image])
    def capture(self) -> None:
        self.image.set(np.full((480, 640), self.number, np.uint8))
        self.number += 1


class Planner(hprm.Reactor):
    image = hprm.Input(Image)

    @hprm.reaction(image)
    def plan(self) -> None:
        print(self.elapsed() // 1_000_000, "ms: image", self.image.value.max())


class Machines(hprm.Federation, timeout="100 ms"):
    def __init__(self) -> None:
        self.camera = hprm.federate(Camera(), host="camera.local")
        self.planner = hprm.federate(Planner(), host="robot.local")
        hprm.connect(self.camera.image, self.planner.image)


if __name__ == "__main__":
    hprm.run(Machines())
