"""A deadline has no handler."""

import hprm


class Main(hprm.Reactor, timeout="200 ms"):
    tick = hprm.Timer("100 ms")

    @hprm.reaction(tick, deadline="10 ms")
    def show(self) -> None:
        print("tick")
