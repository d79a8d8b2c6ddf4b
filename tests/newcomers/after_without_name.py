"""A delay is an argument without a name, between the two ports."""

import hprm


class Source(hprm.Reactor):
    out = hprm.Output(int)

    @hprm.reaction(hprm.startup, effects=[out])
    def begin(self) -> None:
        self.out.set(1)


class Sink(hprm.Reactor):
    number = hprm.Input(int)

    @hprm.reaction(number)
    def show(self) -> None:
        print(self.number.value)


class Main(hprm.Reactor):
    def __init__(self) -> None:
        self.source = Source()
        self.sink = Sink()
        hprm.connect(self.source.out, "10 ms", self.sink.number)
