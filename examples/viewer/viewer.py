"""A viewer that joins, leaves, and joins again, while the camera runs."""

import hprm


class Camera(hprm.Reactor):
    visit = hprm.Input(bool)
    frame = hprm.Output(int)
    tick = hprm.Timer("20 ms")

    def __init__(self) -> None:
        self.number = 0
        self.visits = 0

    @hprm.reaction(tick, effects=[frame])
    def capture(self) -> None:
        self.frame.set(self.number)
        self.number += 1

    @hprm.reaction(visit)
    def count(self) -> None:
        self.visits += 1
        print("visits:", self.visits)
        if self.visits == 2:
            self.request_stop()


class Viewer(hprm.Reactor):
    frame = hprm.Input(int)
    visit = hprm.Output(bool)

    def __init__(self) -> None:
        self.seen: list[int] = []

    @hprm.reaction(hprm.startup)
    def join(self) -> None:
        print("joins")

    @hprm.reaction(frame)
    def show(self) -> None:
        self.seen.append(self.frame.value)
        if len(self.seen) == 3:
            self.leave()

    @hprm.reaction(hprm.shutdown, effects=[visit])
    def end(self) -> None:
        in_a_row = [number - self.seen[0] for number in self.seen]
        print("leaves, has seen", in_a_row)
        self.visit.set(True)


class Viewing(hprm.Federation, timeout="1 min"):
    def __init__(self) -> None:
        self.camera = Camera()
        self.viewer = hprm.federate(Viewer(), transient=True)
        hprm.connect(self.camera.frame, self.viewer.frame)
        hprm.connect(self.viewer.visit, self.camera.visit, after="10 ms")


if __name__ == "__main__":
    hprm.run(Viewing())
