"""Two reactors wait for one another."""

import hprm


class Adds(hprm.Reactor):
    number = hprm.Input(int)
    sum = hprm.Output(int)

    @hprm.reaction(number, effects=[sum])
    def add(self) -> None:
        self.sum.set(self.number.value + 1)


class Main(hprm.Reactor):
    def __init__(self) -> None:
        self.first, self.second = Adds(), Adds()
        hprm.connect(self.first.sum, self.second.number)
        hprm.connect(self.second.sum, self.first.number)
