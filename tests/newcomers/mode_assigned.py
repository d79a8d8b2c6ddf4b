"""A mode is assigned instead of entered."""

import hprm


class Main(hprm.Reactor, timeout="500 ms"):
    idle = hprm.Mode(initial=True)
    busy = hprm.Mode()
    tick = hprm.Timer("200 ms")

    @hprm.reaction(tick, effects=[busy], mode=idle)
    def leave(self) -> None:
        print("idle")
        self.busy = True

    @hprm.reaction(tick, mode=busy)
    def work(self) -> None:
        print("busy")
