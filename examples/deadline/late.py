"""A motor that stops rather than follow a plan that is too late."""

import time

import hprm


class Planner(hprm.Reactor):
    target = hprm.Output(int)
    tick = hprm.Timer("500 ms")

    def __init__(self) -> None:
        self.plans = 0

    @hprm.reaction(tick, effects=[target])
    def plan(self) -> None:
        self.plans += 1
        if self.plans == 2:
            time.sleep(0.45)  # A plan that takes too long.
        self.target.set(self.plans)


class Motor(hprm.Reactor):
    target = hprm.Input(int)

    @hprm.reaction(target, deadline="400 ms", late="stop")
    def drive(self) -> None:
        print("follows plan", self.target.value)

    def stop(self) -> None:
        print("stops: plan", self.target.value, "is too late")


class Late(hprm.Reactor, timeout="1 s"):
    def __init__(self) -> None:
        self.planner = Planner()
        self.motor = Motor()
        hprm.connect(self.planner.target, self.motor.target)


if __name__ == "__main__":
    hprm.run(Late())
