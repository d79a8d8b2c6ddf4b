"""A pipeline of four federates, with feedback and a deadline."""

import time

import hprm


class Camera(hprm.Reactor):
    frame = hprm.Output(int)
    tick = hprm.Timer("1 s")

    def __init__(self) -> None:
        self.number = 0

    @hprm.reaction(tick, effects=[frame])
    def capture(self) -> None:
        self.frame.set(self.number)
        self.number += 1


class Detector(hprm.Reactor):
    frame = hprm.Input(int)
    distance = hprm.Output(int)

    @hprm.reaction(frame, effects=[distance])
    def detect(self) -> None:
        self.distance.set(10 - self.frame.value)


class Planner(hprm.Reactor):
    distance = hprm.Input(int)
    speed = hprm.Input(int)
    target = hprm.Output(int)

    def __init__(self) -> None:
        self.last_speed = 0

    @hprm.reaction(speed)
    def remember(self) -> None:
        self.last_speed = self.speed.value

    @hprm.reaction(distance, effects=[target])
    def plan(self) -> None:
        if self.distance.value == 8:
            time.sleep(0.95)  # A plan that takes too long.
        self.target.set(min(self.last_speed + 2, self.distance.value))


class Motor(hprm.Reactor):
    target = hprm.Input(int)
    speed = hprm.Output(int)

    @hprm.reaction(target, effects=[speed], deadline="800 ms", late="stop")
    def drive(self) -> None:
        print(f"drive at {self.target.value}")
        self.speed.set(self.target.value)

    def stop(self) -> None:
        print("too late: stop")
        self.speed.set(0)


class Pipeline(hprm.Federation, timeout="3 s"):
    def __init__(self) -> None:
        self.camera = Camera()
        self.detector = Detector()
        self.planner = Planner()
        self.motor = Motor()
        hprm.connect(self.camera.frame, self.detector.frame)
        hprm.connect(self.detector.distance, self.planner.distance)
        hprm.connect(self.planner.target, self.motor.target)
        hprm.connect(self.motor.speed, self.planner.speed, after="10 ms")


if __name__ == "__main__":
    hprm.run(Pipeline())
