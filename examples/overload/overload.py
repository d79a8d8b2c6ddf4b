"""A camera that is faster than its viewers, and what each viewer gets of its frames."""

import time

import hprm


class Camera(hprm.Reactor):
    frame = hprm.Output(int)
    tick = hprm.Timer("10 ms")

    def __init__(self) -> None:
        self.number = 0

    @hprm.reaction(tick, effects=[frame])
    def capture(self) -> None:
        if self.number < 10:
            self.frame.set(self.number)
            self.number += 1


class Viewer(hprm.Reactor):
    frame = hprm.Input(int)

    def __init__(self) -> None:
        self.seen: list[int] = []

    @hprm.reaction(hprm.startup)
    def begin(self) -> None:
        time.sleep(1)  # Busy, while ten frames arrive.

    @hprm.reaction(frame)
    def show(self) -> None:
        self.seen.append(self.frame.value)

    @hprm.reaction(hprm.shutdown)
    def end(self) -> None:
        print("frames", self.seen)


class Overload(hprm.Federation, timeout="2 s"):
    def __init__(self) -> None:
        self.camera = Camera()
        self.newest = Viewer()
        self.first = Viewer()
        self.all = Viewer()
        frame = self.camera.frame
        hprm.connect(frame, self.newest.frame, physical=True, bound=(1, "replace"))
        hprm.connect(frame, self.first.frame, physical=True, bound=(3, "drop"))
        hprm.connect(frame, self.all.frame)


if __name__ == "__main__":
    hprm.run(Overload())
