"""The other simulators of examples/driving: highway-env, and CARLA with a stand-in for a server."""

from __future__ import annotations

import importlib.util
import math
import os
import platform
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "driving"))

from autopilot.agent import GeometricAgent
from autopilot.carla_simulator import Carla
from autopilot.highway import Highway
from autopilot.simulator import BIRDVIEW, PICTURE, Simulator, SimulatorError
from town.controls import Control
from town.overhead import CARS, CROSSINGS, PEDESTRIANS, ROAD, ROUTE

STAND_INS = Path(__file__).resolve().parent / "stand_ins"
DRIVING = Path(__file__).resolve().parents[2] / "examples" / "driving"
HPRM = str(Path(sys.executable).parent / "hprm")


# CARLA's package is for these alone.
HAS_CARLA = sys.version_info < (3, 13) and (sys.platform, platform.machine()) == ("linux", "x86_64")


def drive(world: Simulator) -> list[Control]:
    """Drives with the geometric agent to the end, and returns what it did."""
    agent, view, done = GeometricAgent(), np.zeros(BIRDVIEW, np.uint8), []
    while not world.ended():
        world.look_down(view)
        done.append(agent.drive(view, world.state()))
        world.step(done[-1])
    return done


@pytest.fixture
def carla(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The stand-in, with a server of its own."""
    module = stand_in()
    monkeypatch.setitem(sys.modules, "carla", module)
    return module


def stand_in() -> ModuleType:
    spec = importlib.util.spec_from_file_location("carla", STAND_INS / "carla.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "carla", module)
        spec.loader.exec_module(module)
    return module


@pytest.mark.skipif(not HAS_CARLA, reason="there is no package carla for this Python")
def test_the_stand_in_has_what_the_package_has() -> None:
    import carla as package

    ours = stand_in()
    for name in ("Client", "World", "Map", "Waypoint", "Actor", "Location", "Rotation"):
        has = {it for it in dir(getattr(package, name)) if not it.startswith("_")}
        if name == "Actor":
            # Some calls are those of cars, some those of sensors.
            has |= set(dir(package.Vehicle)) | set(dir(package.Sensor))
            has |= {"place", "blueprint", "speed", "control", "heard", "alone", "move"}
        own = {it for it in dir(getattr(ours, name)) if not it.startswith("_")}
        assert own - {"along", "place"} <= has, name
    transform = package.Transform(package.Location(x=0.4, z=1.6), package.Rotation(pitch=-3.5))
    assert (transform.location.x, transform.location.z) == pytest.approx((0.4, 1.6))
    assert transform.rotation.pitch == pytest.approx(-3.5)
    control = package.VehicleControl(throttle=0.5, steer=-0.25, brake=0.0)
    assert (control.throttle, control.steer, control.brake) == (0.5, -0.25, 0.0)
    settings = package.WorldSettings()
    settings.synchronous_mode, settings.fixed_delta_seconds = True, 0.05
    assert settings.fixed_delta_seconds == pytest.approx(0.05)
    with pytest.raises(RuntimeError, match="time-out"):
        client = package.Client("127.0.0.1", 9)
        client.set_timeout(0.2)
        client.get_world()


def test_a_car_in_carla_takes_the_turn_to_the_right_and_stops_behind_a_parked_car(
    carla: ModuleType,
) -> None:
    world = Carla(seed=1, frames=700, host="127.0.0.1", port=2000)
    done = drive(world)
    assert world.ended() == "enough", world.summary()
    car, parked = (
        next(it for it in carla.server.actors if it.type_id == kind)
        for kind in ("vehicle.tesla.model3", "vehicle.parked")
    )
    # The road ends to the right, which is where y grows.
    assert car.place.rotation.yaw == pytest.approx(90.0, abs=3.0)
    apart = math.dist(*((it.place.location.x, it.place.location.y) for it in (car, parked)))
    assert car.speed < 0.1 and 4.4 < apart < 10.0
    # To the left is above zero here, and below zero there.
    assert min(it.steer for it in done) < -0.1
    for here, there in zip(done, carla.server.controls, strict=True):
        assert (there.throttle, there.brake) == (here.throttle, here.brake)
        assert there.steer == -here.steer


def test_what_carla_shows_is_of_the_frame_that_was_asked_for(carla: ModuleType) -> None:
    world = Carla(seed=1, frames=50, host="127.0.0.1", port=2000)
    picture, view = np.zeros(PICTURE, np.uint8), np.zeros(BIRDVIEW, np.uint8)
    for _ in range(3):
        world.step(Control(throttle=1.0))
        world.take_picture(picture)
        # Red comes first here, last there.
        assert (picture == (carla.server.frame % 256, 20, 10)).all()
    (camera,) = (it for it in carla.server.actors if it.type_id == "sensor.camera.rgb")
    assert camera.blueprint.attributes == {
        "image_size_x": "640",
        "image_size_y": "480",
        "fov": "90.0",
    }
    world.look_down(view)
    assert all(view[channel].any() for channel in (ROAD, ROUTE, CROSSINGS))
    assert not view[CARS].any() and not view[PEDESTRIANS].any()
    assert world.state().frame == 3 and world.state().speed == pytest.approx(0.45, abs=0.02)
    assert carla.server.seeds == [1]


def test_carla_gets_its_time_and_its_actors_back(carla: ModuleType) -> None:
    world = Carla(seed=3, frames=50, host="127.0.0.1", port=2000)
    assert carla.server.settings == carla.WorldSettings(True, 0.05)
    assert len(carla.server.actors) > 1
    world.close()
    assert carla.server.settings == carla.WorldSettings(False, None)
    assert [it.type_id for it in carla.server.actors] == ["vehicle.parked"]


def test_a_car_in_carla_that_hits_something_has_ended_its_journey(carla: ModuleType) -> None:
    world = Carla(seed=3, frames=50, host="127.0.0.1", port=2000)
    (bumper,) = (it for it in carla.server.actors if it.type_id == "sensor.other.collision")
    bumper.heard(object())
    assert world.ended() == "collision" and "collision" in world.summary()


def test_a_carla_without_a_free_place_is_one_clear_error(
    carla: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(carla.Map, "get_spawn_points", lambda _: [])
    with pytest.raises(SimulatorError, match="no free place for the car"):
        Carla(seed=3, frames=50, host="127.0.0.1", port=2000)
    assert carla.server.settings.synchronous_mode is False


@pytest.mark.parametrize("name", ["carla", "highway_env"])
def test_a_simulator_without_its_package_says_what_to_install(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(SimulatorError, match=r"cannot be loaded: .*requirements-simulators\.txt"):
        if name == "carla":
            Carla(seed=0, frames=1, host="127.0.0.1", port=2000)
        else:
            Highway(seed=0, frames=1)


def run(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """The program in Python with the stand-in of carla."""
    argv = [HPRM, "run", "driving.py", "--", "--agent", "geometric", "--detector", "off", *words]
    env = os.environ | {"PYTHONPATH": str(STAND_INS)} | environment
    return subprocess.run(
        argv, cwd=DRIVING, env=env, capture_output=True, text=True, timeout=100, check=False
    )


def test_a_federation_drives_in_carla() -> None:
    done = run("--sim", "carla", "--frames", "20")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("[simulator] frame 20: "), done.stdout


@pytest.mark.parametrize(
    ("wrong", "told"),
    [("CARLA_ABSENT", "Connection refused"), ("CARLA_SILENT", "time-out of 10000ms")],
)
def test_a_simulator_that_cannot_start_is_one_clear_error(wrong: str, told: str) -> None:
    done = run("--sim", "carla", "--host", "127.0.0.9", **{wrong: "1"})
    assert done.returncode != 0
    assert f"CARLA at 127.0.0.9:2000 does not answer: {told}" in done.stderr
    assert "name another one with --host" in done.stderr
    assert done.stderr.count("error: ") == 1, done.stderr


def test_a_simulator_that_dies_is_one_clear_error() -> None:
    done = run("--sim", "carla", "--frames", "40", CARLA_DIES_AT="12")
    assert done.returncode != 0
    assert "CARLA at 127.0.0.1:2000 does not answer any more, at frame 12: time-out" in done.stderr
    assert done.stderr.count("error: ") == 1, done.stderr


def test_a_car_turns_left_at_the_junction_of_highway_env() -> None:
    world = Highway(seed=0, frames=600)
    turned = [it.steer for it in drive(world)]
    assert world.ended() == "completed", world.summary()
    assert max(turned) > 0.1 and min(turned) > -0.1
    world.close()


def test_highway_env_is_the_same_for_the_same_seed_and_shows_itself() -> None:
    seen = []
    for _ in range(2):
        world = Highway(seed=1, frames=60)
        drive(world)
        picture, view = np.zeros(PICTURE, np.uint8), np.zeros(BIRDVIEW, np.uint8)
        world.take_picture(picture)
        world.look_down(view)
        seen.append((world.summary(), world.state(), picture, view))
        world.close()
    (one, state, picture, view), (other, again, same, alike) = seen
    assert one == other and state == again and state.frame == 60
    assert (picture == same).all() and (view == alike).all()
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 4
    assert view[ROAD].any() and view[ROUTE].any() and view[CARS].any()


def test_a_federation_drives_in_highway_env() -> None:
    done = run("--sim", "highway", "--seed", "2", "--frames", "20")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("[simulator] frame 20: "), done.stdout
