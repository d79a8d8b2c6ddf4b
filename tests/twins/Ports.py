"""Inputs, outputs, state, and a connection with a delay."""

import hprm


class Ramp(hprm.Reactor):
    value = hprm.Output(int)
    t = hprm.Timer("100 ms")

    def __init__(self, step: int = 2) -> None:
        self.step = step
        self.count = 0

    @hprm.reaction(t, effects=[value])
    def rise(self) -> None:
        self.value.set(self.count)
        self.count += self.step


class Sum(hprm.Reactor):
    left = hprm.Input(int)
    right = hprm.Input(int)
    total = hprm.Output(int)

    @hprm.reaction(left, right, effects=[total])
    def add(self) -> None:
        self.total.set(self.left.get(0) + self.right.get(0))


class Show(hprm.Reactor):
    total = hprm.Input(int)

    @hprm.reaction(total)
    def show(self) -> None:
        print(self.elapsed(), self.total.value)


class Ports(hprm.Federation, timeout="500 ms"):
    def __init__(self) -> None:
        self.slow = Ramp()
        self.fast = Ramp(step=10)
        self.sum = Sum()
        self.show = Show()
        hprm.connect(self.slow.value, self.sum.left)
        hprm.connect(self.fast.value, self.sum.right, after="100 ms")
        hprm.connect(self.sum.total, self.show.total)
