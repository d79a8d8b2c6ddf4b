"""A decentralized federation with limits for waiting."""

import hprm


class Source(hprm.Reactor):
    value = hprm.Output(int)
    t = hprm.Timer("100 ms")

    @hprm.reaction(t, effects=[value])
    def emit(self) -> None:
        self.value.set(self.elapsed())


class Fuse(hprm.Reactor):
    left = hprm.Input(int)
    right = hprm.Input(int)

    @hprm.reaction(left, right, tardy="complain")
    def fuse(self) -> None:
        print(self.left.get(), self.right.get())

    def complain(self) -> None:
        print("tardy")


class Tardy(hprm.Federation, coordination="decentralized", timeout="400 ms"):
    def __init__(self) -> None:
        self.a = hprm.federate(Source(), maxwait="1 s")
        self.b = Source()
        self.fuse = hprm.federate(Fuse(), maxwait="2 s")
        hprm.connect(self.a.value, self.fuse.left)
        hprm.connect(self.b.value, self.fuse.right)
