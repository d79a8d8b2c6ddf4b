"""Three cameras, and a federate that fuses their images."""

import numpy as np
import numpy.typing as npt

import hprm

Image = npt.NDArray[np.uint8]


class Camera(hprm.Reactor):
    image = hprm.Output(Image)
    tick = hprm.Timer("50 ms")

    def __init__(self, every: int) -> None:
        self.every = every
        self.frame = 0

    @hprm.reaction(tick, effects=[image])
    def capture(self) -> None:
        if self.frame % self.every == 0:
            self.image.set(np.full((480, 640), self.bank_index + 1, np.uint8))
        self.frame += 1


class Fusion(hprm.Reactor):
    images = hprm.Input(Image, width=lambda self: self.cameras)

    def __init__(self, cameras: int) -> None:
        self.cameras = cameras

    @hprm.reaction(images)
    def fuse(self) -> None:
        seen = [int(image.value.max()) for image in self.images if image.is_present]
        print(self.elapsed() // 1_000_000, "ms: images", seen)


class Cameras(hprm.Federation, timeout="100 ms"):
    def __init__(self) -> None:
        self.cameras = [Camera(every) for every in (1, 1, 2)]
        self.fusion = Fusion(cameras=3)
        hprm.connect([camera.image for camera in self.cameras], self.fusion.images)


if __name__ == "__main__":
    hprm.run(Cameras())
