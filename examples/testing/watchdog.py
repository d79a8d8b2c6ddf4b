"""A watchdog: it raises an alarm when no heartbeat has come for 100 ms."""

import hprm


class Watchdog(hprm.Reactor):
    heartbeat = hprm.Input(int)
    alarm = hprm.Output(str)
    expired = hprm.Action(int, min_delay="100 ms")

    def __init__(self) -> None:
        self.beats = 0

    @hprm.reaction(heartbeat, effects=[expired])
    def beat(self) -> None:
        self.beats += 1
        self.expired.schedule(0, self.beats)

    @hprm.reaction(expired, effects=[alarm])
    def expire(self) -> None:
        if self.expired.value == self.beats:  # No heartbeat since.
            self.alarm.set(f"silent since beat {self.beats}")
