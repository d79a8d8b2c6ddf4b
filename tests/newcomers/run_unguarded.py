"""A federation is run where its file is imported."""

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


class Main(hprm.Federation, timeout="20 ms"):
    def __init__(self) -> None:
        self.source = Source()
        self.sink = Sink()
        hprm.connect(self.source.out, self.sink.number)


hprm.run(Main())
