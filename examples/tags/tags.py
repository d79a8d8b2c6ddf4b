"""What is present at a tag, and what comes a microstep later."""

import hprm


class Ticker(hprm.Reactor):
    tick = hprm.Output(bool)
    t = hprm.Timer(lambda self: self.period)

    def __init__(self, period: str) -> None:
        self.period = period

    @hprm.reaction(t, effects=[tick])
    def send(self) -> None:
        self.tick.set(True)


class Watcher(hprm.Reactor):
    fast = hprm.Input(bool)
    slow = hprm.Input(bool)
    echo = hprm.Input(bool)

    @hprm.reaction(fast, slow, echo)
    def show(self) -> None:
        ports = {"fast": self.fast, "slow": self.slow, "echo": self.echo}
        present = [name for name, port in ports.items() if port.is_present]
        print((self.elapsed() // 1_000_000, self.tag().microstep), *present)


class Tags(hprm.Reactor, timeout="200 ms"):
    def __init__(self) -> None:
        self.fast = Ticker(period="100 ms")
        self.slow = Ticker(period="200 ms")
        self.watcher = Watcher()
        hprm.connect(self.fast.tick, self.watcher.fast)
        hprm.connect(self.slow.tick, self.watcher.slow)
        hprm.connect(self.slow.tick, self.watcher.echo, after=0)


if __name__ == "__main__":
    hprm.run(Tags())
