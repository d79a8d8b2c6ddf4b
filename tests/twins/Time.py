"""Timers, and connections that delay."""

from datetime import timedelta

import hprm


class Clock(hprm.Reactor):
    beat = hprm.Output(int)
    once = hprm.Timer(offset="50 ms")
    often = hprm.Timer(timedelta(milliseconds=150))

    @hprm.reaction(once, often, effects=[beat])
    def tick(self) -> None:
        self.beat.set(self.elapsed())


class Show(hprm.Reactor):
    beat = hprm.Input(int)
    later = hprm.Input(int)
    next = hprm.Input(int)

    @hprm.reaction(beat)
    def at_once(self) -> None:
        print("beat", self.elapsed(), self.tag().microstep)

    @hprm.reaction(later)
    def after_a_while(self) -> None:
        print("later", self.elapsed(), self.later.value)

    @hprm.reaction(next)
    def in_the_next_microstep(self) -> None:
        print("next", self.elapsed(), self.tag().microstep)


class Time(hprm.Federation, timeout="400 ms"):
    def __init__(self) -> None:
        self.clock = Clock()
        self.show = Show()
        hprm.connect(self.clock.beat, self.show.beat)
        hprm.connect(self.clock.beat, self.show.later, after=20_000_000)
        hprm.connect(self.clock.beat, self.show.next, after="0 s")
