"""A car drives through a town: the same program as DrivingCentralized.lf, in Python."""

import numpy as np
import numpy.typing as npt
from autopilot.agent import Agent, open_agent
from autopilot.latency import Latencies
from autopilot.lookout import Lookout, Sight, open_lookout
from autopilot.options import Options, options
from autopilot.simulator import BIRDVIEW, PICTURE, Simulator, State, open_simulator
from town.controls import Control

import hprm

Pixels = npt.NDArray[np.uint8]


class World(hprm.Reactor):
    """Shows each frame of the world. A control leads to the next frame."""

    control = hprm.Input(Control)
    picture = hprm.Output(Pixels)
    birdview = hprm.Output(Pixels)
    car = hprm.Output(State)
    simulator: Simulator
    latencies: Latencies

    def __init__(self, wanted: Options) -> None:
        self.wanted = wanted

    @hprm.reaction(hprm.startup)
    def begin(self) -> None:
        self.simulator = open_simulator(self.wanted)
        self.latencies = Latencies(self.wanted.measure, self.wanted.frames)

    @hprm.reaction(hprm.startup, control, effects=[picture, birdview, car])
    def advance(self) -> None:
        if self.control.is_present:
            self.latencies.control_came()
            self.simulator.step(self.control.value)
        if self.simulator.ended():
            self.request_stop()
            return
        image, view = hprm.empty(PICTURE, np.uint8), hprm.empty(BIRDVIEW, np.uint8)
        self.simulator.take_picture(image)
        self.simulator.look_down(view)
        self.picture.set(image)
        self.birdview.set(view)
        self.car.set(self.simulator.state())
        self.latencies.frame_sent()

    @hprm.reaction(hprm.shutdown)
    def end(self) -> None:
        print(self.simulator.summary())
        self.simulator.close()
        self.latencies.save()


class Driver(hprm.Reactor):
    """Drives by what it sees from above."""

    birdview = hprm.Input(Pixels)
    car = hprm.Input(State)
    plan = hprm.Output(Control)
    agent: Agent

    def __init__(self, name: str) -> None:
        self.name = name

    @hprm.reaction(hprm.startup)
    def begin(self) -> None:
        self.agent = open_agent(self.name)

    @hprm.reaction(birdview, sources=[car], effects=[plan])
    def drive(self) -> None:
        self.plan.set(self.agent.drive(self.birdview.value, self.car.value))


class Detector(hprm.Reactor):
    """Looks for lights and signs on the pictures of the camera."""

    picture = hprm.Input(Pixels)
    car = hprm.Input(State)
    sight = hprm.Output(Sight)
    lookout: Lookout

    def __init__(self, wanted: Options) -> None:
        self.wanted = wanted

    @hprm.reaction(hprm.startup)
    def begin(self) -> None:
        self.lookout = open_lookout(self.wanted)

    @hprm.reaction(picture, sources=[car], effects=[sight])
    def detect(self) -> None:
        self.sight.set(self.lookout.look(self.picture.value, self.car.value.speed))


class Fusion(hprm.Reactor):
    """Does what the agent wants, as far as the detector lets it."""

    plan = hprm.Input(Control)
    sight = hprm.Input(Sight)
    control = hprm.Output(Control)

    @hprm.reaction(plan, sight, effects=[control])
    def decide(self) -> None:
        self.control.set(self.sight.value.advice.applied(self.plan.value))


class Driving(hprm.Federation, coordination="centralized"):
    """The application. `--property coordination=decentralized` does without a coordinator."""

    def __init__(self, stated: Options | None = None) -> None:
        wanted = stated or options()
        self.simulator = World(wanted)
        self.agent = Driver(wanted.agent)
        self.detector = Detector(wanted)
        self.fusion = Fusion()
        hprm.connect(self.simulator.birdview, self.agent.birdview)
        hprm.connect(self.simulator.car, self.agent.car)
        hprm.connect(self.simulator.picture, self.detector.picture)
        hprm.connect(self.simulator.car, self.detector.car)
        hprm.connect(self.agent.plan, self.fusion.plan)
        hprm.connect(self.detector.sight, self.fusion.sight)
        hprm.connect(self.fusion.control, self.simulator.control, after=0)


if __name__ == "__main__":
    hprm.run(Driving(options()))
