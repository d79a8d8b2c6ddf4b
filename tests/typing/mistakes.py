"""Mistakes that type checkers find: each line with `# error` has one, and no other line has."""

import hprm


class Camera(hprm.Reactor):
    image = hprm.Output(bytes)
    ready = hprm.Output(bool)
    tick = hprm.Timer("10 ms")
    again = hprm.Action(int)

    def __init__(self, rate: int) -> None:
        self.rate = rate

    @hprm.reaction(tick, effects=[image, again])
    def capture(self) -> None:
        self.image.set(b"pixels")
        self.image.set("pixels")  # error
        self.imgae.set(b"pixels")  # error
        self.again.schedule("10 ms", 3)
        self.again.schedule("10 ms", "three")  # error
        self.again.schedule(0.5, 3)  # error

    @hprm.reaction(tik, effects=[image])  # error
    def misspelled(self) -> None:
        self.image.set(b"pixels")


class Detector(hprm.Reactor):
    image = hprm.Input(bytes)
    boxes = hprm.Output(list[int])

    @hprm.reaction(image, effects=[boxes])
    def detect(self) -> None:
        self.boxes.set([len(self.image.value)])
        self.boxes.set([self.image.value])  # error
        length: int = self.image.get(b"")  # error
        print(length)


class Vision(hprm.Federation, timeout="1 s"):
    def __init__(self) -> None:
        self.camera = Camera(rate=10)
        self.second = Camera("10")  # error
        self.detector = Detector()
        hprm.connect(self.camera.image, self.detector.image)
        hprm.connect(self.camera.ready, self.detector.image)  # error
        hprm.connect(self.camera.imgae, self.detector.image)  # error


class Wrong(hprm.Federation, coordination="central"):  # error for pyright
    pass


class WrongTime(hprm.Federation, timeout=0.5):  # error for pyright
    pass
