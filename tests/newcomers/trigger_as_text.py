"""A trigger is named by a text."""

import hprm


class Main(hprm.Reactor, timeout="1 s"):
    tick = hprm.Timer("100 ms")

    @hprm.reaction("tick")
    def show(self) -> None:
        print("tick")
