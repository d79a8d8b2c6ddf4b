"""Two federates in a circle, and a request to stop."""

import hprm


class Ping(hprm.Reactor):
    back = hprm.Input(int)
    ball = hprm.Output(int)

    def __init__(self, rounds: int = 5) -> None:
        self.rounds = rounds
        self.left = 0

    @hprm.reaction(hprm.startup, effects=[ball])
    def serve(self) -> None:
        self.left = self.rounds
        self.ball.set(self.left)

    @hprm.reaction(back, effects=[ball])
    def reply(self) -> None:
        print("back", self.back.value)
        self.left -= 1
        if self.left > 0:
            self.ball.set(self.left)
        else:
            self.request_stop()


class Pong(hprm.Reactor):
    ball = hprm.Input(int)
    back = hprm.Output(int)

    @hprm.reaction(ball, effects=[back])
    def reply(self) -> None:
        self.back.set(-self.ball.value)


class Feedback(hprm.Federation, timeout="1 s"):
    def __init__(self) -> None:
        self.ping = Ping(rounds=4)
        self.pong = Pong()
        hprm.connect(self.ping.ball, self.pong.ball)
        hprm.connect(self.pong.back, self.ping.back, after=0)
