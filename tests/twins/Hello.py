"""Reactions to the start and the end."""

import hprm


class Hello(hprm.Reactor, timeout="1 s", fast=True):
    @hprm.reaction(hprm.startup)
    def greet(self) -> None:
        print("Hello World.")

    @hprm.reaction(hprm.shutdown)
    def leave_politely(self) -> None:
        print("Bye.")


if __name__ == "__main__":
    hprm.run(Hello())
