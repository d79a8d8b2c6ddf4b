"""Logical actions: minimum delays and minimum spacing."""

import hprm


class Alarms(hprm.Reactor):
    rang = hprm.Output()
    soon = hprm.Action(str, min_delay="10 ms")
    spaced = hprm.Action(int, spacing="50 ms", policy="replace")
    t = hprm.Timer("300 ms", offset="100 ms")

    @hprm.reaction(t, effects=[soon, spaced])
    def begin(self) -> None:
        self.soon.schedule("5 ms", "first")
        self.soon.schedule("7 ms", "second")
        self.spaced.schedule(0, 1)
        self.spaced.schedule("10 ms", 2)

    @hprm.reaction(soon, effects=[rang])
    def ring(self) -> None:
        self.rang.set(self.soon.value)

    @hprm.reaction(spaced, effects=[rang])
    def count(self) -> None:
        self.rang.set(self.spaced.value)


class Show(hprm.Reactor):
    rang = hprm.Input()

    @hprm.reaction(rang)
    def show(self) -> None:
        print(self.elapsed(), self.rang.value)


class Actions(hprm.Federation, timeout="1 s"):
    def __init__(self) -> None:
        self.alarms = Alarms()
        self.show = Show()
        hprm.connect(self.alarms.rang, self.show.rang)
