"""A counter and an adder: ports, state, parameters and a connection."""

import hprm


class Counter(hprm.Reactor):
    count = hprm.Output(int)
    tick = hprm.Timer(lambda self: self.period)

    def __init__(self, first: int = 0, period: str = "1 s") -> None:
        self.next = first
        self.period = period

    @hprm.reaction(tick, effects=[count])
    def advance(self) -> None:
        self.count.set(self.next)
        self.next += 1


class Adder(hprm.Reactor):
    number = hprm.Input(int)

    def __init__(self) -> None:
        self.sum = 0

    @hprm.reaction(number)
    def add(self) -> None:
        self.sum += self.number.value
        print(self.elapsed() // 1_000_000, "ms:", self.sum)


class Counting(hprm.Reactor, timeout="200 ms"):
    def __init__(self) -> None:
        self.counter = Counter(first=1, period="100 ms")
        self.adder = Adder()
        hprm.connect(self.counter.count, self.adder.number)


if __name__ == "__main__":
    hprm.run(Counting())
