"""A control loop that does not wait for frames, and a frame that is tardy."""

import time

import hprm


class Camera(hprm.Reactor):
    frame = hprm.Output(int)
    tick = hprm.Timer("1 s")

    def __init__(self) -> None:
        self.number = 0

    @hprm.reaction(tick, effects=[frame])
    def capture(self) -> None:
        if self.number == 1:
            time.sleep(0.8)  # This frame comes late.
        self.frame.set(self.number)
        self.number += 1


class Motor(hprm.Reactor):
    frame = hprm.Input(int)
    tick = hprm.Timer("1 s")

    @hprm.reaction(tick)
    def control(self) -> None:
        print("control at", self.elapsed() // 1_000_000, "ms")

    @hprm.reaction(frame, tardy="adapt")
    def follow(self) -> None:
        print("frame", self.frame.value)

    def adapt(self) -> None:
        print("frame", self.frame.value, "is tardy")


class Tardy(hprm.Federation, coordination="decentralized", timeout="2 s"):
    def __init__(self) -> None:
        self.camera = Camera()
        self.motor = hprm.federate(Motor(), maxwait=0)
        hprm.connect(self.camera.frame, self.motor.frame, absent_after="600 ms")


if __name__ == "__main__":
    hprm.run(Tardy())
