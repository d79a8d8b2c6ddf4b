"""Modes: reset and history."""

import hprm


class Robot(hprm.Reactor):
    command = hprm.Input(int)
    did = hprm.Output(str)
    Idle = hprm.Mode(initial=True)
    Driving = hprm.Mode()
    t = hprm.Timer("30 ms", mode=Driving)

    def __init__(self) -> None:
        self.steps = 0

    @hprm.reaction(command, effects=[Driving, did], mode=Idle)
    def start(self) -> None:
        self.did.set(f"starts on {self.command.value}")
        self.Driving.enter()

    @hprm.reaction(t, effects=[did], mode=Driving)
    def step(self) -> None:
        self.steps += 1
        self.did.set(f"step {self.steps}")

    @hprm.reaction(command, effects=[Idle.history, did], mode=Driving)
    def stop(self) -> None:
        self.did.set(f"stops on {self.command.value}")
        self.Idle.enter()


class Commander(hprm.Reactor):
    command = hprm.Output(int)
    t = hprm.Timer("100 ms", offset="100 ms")

    def __init__(self) -> None:
        self.count = 0

    @hprm.reaction(t, effects=[command])
    def order(self) -> None:
        self.count += 1
        self.command.set(self.count)


class Show(hprm.Reactor):
    did = hprm.Input(str)

    @hprm.reaction(did)
    def show(self) -> None:
        print(self.elapsed(), self.did.value)


class Modes(hprm.Federation, timeout="1 s"):
    def __init__(self) -> None:
        self.commander = Commander()
        self.robot = Robot()
        self.show = Show()
        hprm.connect(self.commander.command, self.robot.command)
        hprm.connect(self.robot.did, self.show.did)
