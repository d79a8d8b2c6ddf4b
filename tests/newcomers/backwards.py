"""A connection leads from an input to an output."""

import hprm


class Source(hprm.Reactor):
    out = hprm.Output(int)
    tick = hprm.Timer("10 ms")

    @hprm.reaction(tick, effects=[out])
    def send(self) -> None:
        self.out.set(1)


class Sink(hprm.Reactor):
    number = hprm.Input(int)

    @hprm.reaction(number)
    def show(self) -> None:
        print("got", self.number.value)


class Main(hprm.Reactor, timeout="20 ms"):
    def __init__(self) -> None:
        self.source = Source()
        self.sink = Sink()
        hprm.connect(self.sink.number, self.source.out)


if __name__ == "__main__":
    hprm.run(Main())
