"""Two reactors that answer each other: a logical action serves the next ball."""

import hprm


class Ping(hprm.Reactor):
    pong = hprm.Input(int)
    ping = hprm.Output(int)
    serve = hprm.Action(min_delay="1 ms")

    def __init__(self, balls: int = 3) -> None:
        self.left = balls

    @hprm.reaction(hprm.startup, effects=[serve])
    def begin(self) -> None:
        self.serve.schedule()

    @hprm.reaction(serve, effects=[ping])
    def play(self) -> None:
        self.left -= 1
        self.ping.set(self.left)

    @hprm.reaction(pong, effects=[serve])
    def again(self) -> None:
        print(self.elapsed() // 1_000_000, f"ms: {self.pong.value} left")
        if self.left > 0:
            self.serve.schedule()


class Pong(hprm.Reactor):
    ping = hprm.Input(int)
    pong = hprm.Output(int)

    @hprm.reaction(ping, effects=[pong])
    def reply(self) -> None:
        self.pong.set(self.ping.value)


class PingPong(hprm.Reactor, fast=True):
    def __init__(self) -> None:
        self.ping = Ping()
        self.pong = Pong()
        hprm.connect(self.ping.ping, self.pong.ping)
        hprm.connect(self.pong.pong, self.ping.pong)


if __name__ == "__main__":
    hprm.run(PingPong())
