"""What the four programs do: what the reactors of examples/driving do, with messages for ports.

Each edge carries one message for a frame, and None at the end, which ends the program that reads
it. The time of a frame begins before its messages are sent, and ends when its control is there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from autopilot.agent import open_agent
from autopilot.latency import Latencies
from autopilot.lookout import open_lookout
from autopilot.options import Options, options
from autopilot.simulator import BIRDVIEW, PICTURE, open_simulator
from clock import Clock, say_drive
from session import Session


def _options(session: Session) -> Options:
    return options(session.option("arguments"))


def simulator(session: Session, ends: Any) -> None:
    """Shows each frame of the world. A control leads to the next one."""
    wanted = _options(session)
    world = open_simulator(wanted)
    latencies = Latencies(wanted.measure, wanted.frames)
    while not world.ended():
        image, view = np.empty(PICTURE, np.uint8), np.empty(BIRDVIEW, np.uint8)
        world.take_picture(image)
        world.look_down(view)
        car = world.state()
        latencies.frame_sent()
        ends.send("picture", (image, car))
        ends.send("birdview", (view, car))
        (control,) = ends.receive("control")
        latencies.control_came()
        world.step(control)
    drove = world.summary()
    world.close()
    ends.send("picture", None)
    ends.send("birdview", None)
    latencies.save()
    say_drive(session, wanted, drove)


def agent(session: Session, ends: Any) -> None:
    """Drives by what it sees from above."""
    clock: Any = Clock(open_agent(_options(session).agent), "drive")
    while (seen := ends.receive("birdview")) is not None:
        ends.send("plan", (clock.drive(*seen),))
    ends.send("plan", None)
    clock.say(session, "agent")


def detector(session: Session, ends: Any) -> None:
    """Looks for lights and signs on the pictures of the camera."""
    clock: Any = Clock(open_lookout(_options(session)), "look")
    while (shot := ends.receive("picture")) is not None:
        picture, car = shot
        ends.send("sight", (clock.look(picture, car.speed),))
    ends.send("sight", None)
    clock.say(session, "detector")


def fusion(session: Session, ends: Any) -> None:
    """Does what the agent wants, as far as the detector lets it, once it has both."""
    while True:
        plan, sight = ends.receive("plan"), ends.receive("sight")
        if plan is None or sight is None:
            return
        ends.send("control", (sight[0].advice.applied(plan[0]),))
