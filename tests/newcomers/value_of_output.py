"""A reaction reads its own output."""

import hprm


class Source(hprm.Reactor):
    out = hprm.Output(int)
    tick = hprm.Timer("100 ms")

    @hprm.reaction(tick, effects=[out])
    def count(self) -> None:
        self.out.set(self.out.value + 1)


class Main(hprm.Reactor, timeout="300 ms"):
    def __init__(self) -> None:
        self.source = Source()
