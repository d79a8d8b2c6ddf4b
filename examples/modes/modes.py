"""Workers with two modes: each works for a while, then rests."""

import hprm


class Worker(hprm.Reactor):
    report = hprm.Output(str)
    working = hprm.Mode(initial=True)
    resting = hprm.Mode()
    step = hprm.Timer("1 ms", offset="1 ms", mode=working)
    rested = hprm.Timer(offset="4 ms", mode=resting)

    def __init__(self, strength: int) -> None:
        self.strength = strength
        self.done = 0

    @hprm.reaction(step, effects=[report, resting], mode=working)
    def work(self) -> None:
        self.done += 1
        if self.done == self.strength:
            self.report.set("tired")
            self.resting.enter()

    @hprm.reaction(rested, effects=[report, working], mode=resting)
    def go_on(self) -> None:
        self.done = 0
        self.report.set("rested")
        self.working.enter()


class Supervisor(hprm.Reactor):
    reports = hprm.Input(str, width=3)

    @hprm.reaction(reports)
    def show(self) -> None:
        for index, report in enumerate(self.reports):
            if report.is_present:
                print(self.elapsed() // 1_000_000, f"ms: worker {index} is {report.value}")


class Shift(hprm.Reactor, fast=True, timeout="10 ms"):
    def __init__(self) -> None:
        self.workers = [Worker(strength) for strength in (2, 3, 4)]
        self.supervisor = Supervisor()
        hprm.connect([worker.report for worker in self.workers], self.supervisor.reports)


if __name__ == "__main__":
    hprm.run(Shift())
