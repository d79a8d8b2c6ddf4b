"""Large arrays between processes."""

from typing import Any

import numpy as np
import numpy.typing as npt

import hprm

Image = npt.NDArray[np.float64]


class Camera(hprm.Reactor):
    image = hprm.Output(Image)
    t = hprm.Timer("100 ms")

    def __init__(self) -> None:
        self.count = 0

    @hprm.reaction(t, effects=[image])
    def capture(self) -> None:
        self.count += 1
        self.image.set(np.full((500, 500), self.count, dtype=np.float64))


class Detector(hprm.Reactor):
    image = hprm.Input(Image)
    boxes = hprm.Output(list[Any])

    @hprm.reaction(image, effects=[boxes])
    def detect(self) -> None:
        self.boxes.set([float(self.image.value.sum()), self.image.value.shape])


class Show(hprm.Reactor):
    boxes = hprm.Input(list[Any])

    @hprm.reaction(boxes)
    def show(self) -> None:
        print(self.boxes.value)


class Arrays(hprm.Federation, timeout="300 ms"):
    def __init__(self) -> None:
        self.camera = Camera()
        self.detector = Detector()
        self.show = Show()
        hprm.connect(self.camera.image, self.detector.image)
        hprm.connect(self.detector.boxes, self.show.boxes)
