"""A deadline is an argument of a timer."""

import hprm


class Main(hprm.Reactor):
    tick = hprm.Timer("1 s", deadline="10 ms")

    @hprm.reaction(tick)
    def show(self) -> None:
        print(self.elapsed())
