"""A planner and a motor that answer each other, with a delay in the cycle."""

import hprm


class Planner(hprm.Reactor):
    speed = hprm.Input(int)
    target = hprm.Output(int)

    @hprm.reaction(hprm.startup, effects=[target])
    def begin(self) -> None:
        self.target.set(1)

    @hprm.reaction(speed, effects=[target])
    def plan(self) -> None:
        print(f"the motor turns at {self.speed.value}")
        self.target.set(self.speed.value + 1)


class Motor(hprm.Reactor):
    target = hprm.Input(int)
    speed = hprm.Output(int)

    @hprm.reaction(target, effects=[speed])
    def drive(self) -> None:
        self.speed.set(self.target.value)


class Feedback(hprm.Reactor, timeout="30 ms"):
    def __init__(self) -> None:
        self.planner = Planner()
        self.motor = Motor()
        hprm.connect(self.planner.target, self.motor.target)
        hprm.connect(self.motor.speed, self.planner.speed, after="10 ms")


if __name__ == "__main__":
    hprm.run(Feedback())
