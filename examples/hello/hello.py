"""A timer says hello."""

import hprm


class Hello(hprm.Reactor, timeout="200 ms"):
    tick = hprm.Timer("100 ms")

    @hprm.reaction(tick)
    def greet(self) -> None:
        print(self.elapsed() // 1_000_000, "ms: hello")


if __name__ == "__main__":
    hprm.run(Hello())
