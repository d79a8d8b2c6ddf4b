"""A reactor that extends another one, methods, and a source."""

import hprm


class Sensor(hprm.Reactor):
    sample = hprm.Output(int)
    t = hprm.Timer("100 ms")

    def __init__(self, offset: int = 0) -> None:
        self.offset = offset
        self.count = 0

    def raw(self) -> int:
        self.count += 1
        return self.count + self.offset

    @hprm.reaction(t, effects=[sample])
    def measure(self) -> None:
        self.sample.set(self.raw())


class Noisy(Sensor):
    noise = hprm.Output(int)

    @hprm.reaction(Sensor.t, effects=[noise])
    def hiss(self) -> None:
        self.noise.set(-self.count)


class Show(hprm.Reactor):
    sample = hprm.Input(int)
    noise = hprm.Input(int)

    @hprm.reaction(sample, sources=[noise])
    def show(self) -> None:
        print(self.sample.value, self.noise.value)


class Inheritance(hprm.Federation, timeout="300 ms"):
    def __init__(self) -> None:
        self.sensor = Noisy(offset=100)
        self.show = Show()
        hprm.connect([self.sensor.sample, self.sensor.noise], [self.show.sample, self.show.noise])
