"""The program: hprm run src/new_project/app.py."""

import hprm


class Sensor(hprm.Reactor):
    """Stands for a sensor: each reading is one more than the last one."""

    reading = hprm.Output(int)
    t = hprm.Timer("100 ms")

    def __init__(self) -> None:
        self.count = 0

    @hprm.reaction(t, effects=[reading])
    def read(self) -> None:
        """Read the sensor."""
        self.count += 1
        self.reading.set(self.count)


class Filter(hprm.Reactor):
    """The mean of the last readings."""

    reading = hprm.Input(int)
    mean = hprm.Output(float)

    def __init__(self, size: int = 3) -> None:
        self.size = size
        self.last: list[int] = []

    @hprm.reaction(reading, effects=[mean])
    def calculate(self) -> None:
        """Calculate the mean of this reading and those before it."""
        self.last = [*self.last, self.reading.value][-self.size :]
        self.mean.set(sum(self.last) / len(self.last))


class Display(hprm.Reactor):
    """Prints each mean, and the logical time at which it was calculated."""

    mean = hprm.Input(float)

    @hprm.reaction(mean)
    def show(self) -> None:
        """Print a line."""
        print(f"{self.elapsed() // 10**6} ms: {self.mean.value}")


class NewProject(hprm.Federation, timeout="1 s"):
    """The whole program; each of its reactors is a process."""

    def __init__(self) -> None:
        self.sensor, self.filter, self.display = Sensor(), Filter(), Display()
        self.sensor.reading >> self.filter.reading
        self.filter.mean >> self.display.mean


if __name__ == "__main__":
    hprm.run(NewProject())
