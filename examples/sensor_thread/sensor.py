"""A sensor: a thread that schedules a physical action."""

import threading

import hprm


class Sensor(hprm.Reactor):
    reading = hprm.Output(int)
    measured = hprm.PhysicalAction(int)

    @hprm.reaction(hprm.startup, effects=[measured])
    def begin(self) -> None:
        threading.Thread(target=self.measure).start()

    def measure(self) -> None:
        for number in range(5):
            self.measured.schedule(0, 20 + number % 4)

    @hprm.reaction(measured, effects=[reading])
    def forward(self) -> None:
        self.reading.set(self.measured.value)


class Display(hprm.Reactor):
    reading = hprm.Input(int)

    def __init__(self) -> None:
        self.received = 0

    @hprm.reaction(reading)
    def show(self) -> None:
        print(f"reading {self.received}: {self.reading.value} °C")
        self.received += 1
        if self.received == 5:
            self.request_stop()


class Sensing(hprm.Reactor, keepalive=True):
    def __init__(self) -> None:
        self.sensor = Sensor()
        self.display = Display()
        hprm.connect(self.sensor.reading, self.display.reading)


if __name__ == "__main__":
    hprm.run(Sensing())
