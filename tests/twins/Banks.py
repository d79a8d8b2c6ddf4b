"""A bank between multiports."""

import hprm


class Source(hprm.Reactor):
    out = hprm.Output(int, width=lambda self: self.width)
    t = hprm.Timer("100 ms")

    def __init__(self, width: int = 3) -> None:
        self.width = width

    @hprm.reaction(t, effects=[out])
    def emit(self) -> None:
        for i, channel in enumerate(self.out):
            channel.set(i * 10)


class Worker(hprm.Reactor):
    task = hprm.Input(int)
    done = hprm.Output(int)

    @hprm.reaction(task, effects=[done])
    def work(self) -> None:
        self.done.set(self.task.value + self.bank_index)


class Sink(hprm.Reactor):
    results = hprm.Input(int, width=lambda self: self.width)

    def __init__(self, width: int = 3) -> None:
        self.width = width

    @hprm.reaction(results)
    def show(self) -> None:
        print([channel.value for channel in self.results if channel.is_present])


class Banks(hprm.Federation, timeout="200 ms"):
    def __init__(self) -> None:
        self.source = Source(width=4)
        self.workers = [Worker() for _ in range(4)]
        self.sink = Sink(width=4)
        hprm.connect(self.source.out, [worker.task for worker in self.workers])
        hprm.connect([worker.done for worker in self.workers], self.sink.results)
