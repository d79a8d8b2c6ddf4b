"""A reactor in a reactor, and reactions to contained ports."""

import hprm


class Scale(hprm.Reactor):
    number = hprm.Input(int)
    scaled = hprm.Output(int)

    def __init__(self, factor: int = 1) -> None:
        self.factor = factor

    @hprm.reaction(number, effects=[scaled])
    def scale(self) -> None:
        self.scaled.set(self.factor * self.number.value)


class Chain(hprm.Reactor):
    number = hprm.Input(int)
    scaled = hprm.Output(int)

    def __init__(self) -> None:
        self.first = Scale(factor=2)
        self.second = Scale(factor=5)
        hprm.connect(self.number, self.first.number)
        hprm.connect(self.first.scaled, self.second.number)
        hprm.connect(self.second.scaled, self.scaled)


class Hierarchy(hprm.Reactor, timeout="300 ms", fast=True):
    t = hprm.Timer("100 ms")

    def __init__(self) -> None:
        self.count = 0
        self.chain = Chain()

    @hprm.reaction(t, effects=[lambda self: self.chain.number])
    def feed(self) -> None:
        self.count += 1
        self.chain.number.set(self.count)

    @hprm.reaction(lambda self: self.chain.scaled)
    def show(self) -> None:
        print(self.chain.scaled.value)
