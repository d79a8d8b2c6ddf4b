"""A reaction enters a mode that is not among its effects."""

import hprm


class Main(hprm.Reactor, timeout="1 s"):
    idle = hprm.Mode(initial=True)
    busy = hprm.Mode()
    tick = hprm.Timer("200 ms")

    @hprm.reaction(tick, mode=idle)
    def leave(self) -> None:
        self.busy.enter()
