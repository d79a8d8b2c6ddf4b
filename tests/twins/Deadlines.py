"""A deadline that is missed at the first tag only: with `fast`, tags run ahead of physical time."""

import time

import hprm


class Sensor(hprm.Reactor):
    sample = hprm.Output(int)
    t = hprm.Timer("100 s")

    def __init__(self) -> None:
        self.count = 0

    @hprm.reaction(t, effects=[sample])
    def measure(self) -> None:
        self.count += 1
        if self.count == 1:
            time.sleep(0.06)
        self.sample.set(self.count)


class Controller(hprm.Reactor):
    sample = hprm.Input(int)

    @hprm.reaction(sample, deadline="40 ms", late="give_up")
    def control(self) -> None:
        print("in time", self.sample.value)

    def give_up(self) -> None:
        print("too late", self.sample.value)


class Deadlines(hprm.Reactor, timeout="300 s", fast=True):
    def __init__(self) -> None:
        self.sensor = Sensor()
        self.controller = Controller()
        hprm.connect(self.sensor.sample, self.controller.sample)
