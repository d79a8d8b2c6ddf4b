"""A camera and a detector, each a process of its own."""

import numpy as np
import numpy.typing as npt

import hprm

Image = npt.NDArray[np.float64]


class Camera(hprm.Reactor):
    image = hprm.Output(Image)
    tick = hprm.Timer("100 ms")

    @hprm.reaction(tick, effects=[image])
    def capture(self) -> None:
        self.image.set(np.full((1080, 1920, 3), 0.5))


class Detector(hprm.Reactor):
    image = hprm.Input(Image)

    @hprm.reaction(image)
    def detect(self) -> None:
        print(self.elapsed(), self.image.value.mean())


class Vision(hprm.Federation, timeout="200 ms"):
    def __init__(self) -> None:
        self.camera, self.detector = Camera(), Detector()
        hprm.connect(self.camera.image, self.detector.image)


if __name__ == "__main__":
    hprm.run(Vision())
