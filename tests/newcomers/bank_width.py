"""A bank of three is connected to a multiport of four."""

import hprm


class Source(hprm.Reactor):
    tasks = hprm.Output(int, width=4)

    @hprm.reaction(hprm.startup, effects=[tasks])
    def begin(self) -> None:
        for index, channel in enumerate(self.tasks):
            channel.set(index)


class Worker(hprm.Reactor):
    task = hprm.Input(int)

    @hprm.reaction(task)
    def work(self) -> None:
        print(self.task.value)


class Main(hprm.Reactor):
    def __init__(self) -> None:
        self.source = Source()
        self.workers = [Worker() for _ in range(3)]
        hprm.connect(self.source.tasks, [worker.task for worker in self.workers])
