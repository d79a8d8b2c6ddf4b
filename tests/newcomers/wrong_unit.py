"""A unit of time that there is not."""

import hprm


class Main(hprm.Reactor, timeout="1 s"):
    tick = hprm.Timer("100 millis")

    @hprm.reaction(tick)
    def show(self) -> None:
        print("tick")
