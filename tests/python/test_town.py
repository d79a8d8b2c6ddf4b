"""The simulator of examples/driving: the same from one seed, true to its rules, drawn in place."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "driving"))

from town import geometry
from town.birdview import CHANNELS, SHAPE, Birdview, colours
from town.bodies import Body
from town.camera import FOCAL, HEIGHT, HORIZON, WIDTH, Camera
from town.controls import Control, follow, stop_in
from town.expert import Expert
from town.geometry import shifted
from town.labels import KINDS, labels
from town.lights import DT, GREEN, RED, Lights
from town.roads import SIDE, Roads, build
from town.shapes import LIGHT_BEYOND, LIGHT_MIDDLE, SIGN_MIDDLE, SIGN_RIGHT
from town.traffic import Car
from town.world import Setting, World

QUIET = Setting(cars=0, crossers=0, strollers=0)
ENDS = {"completed", "collision", "off the road", "timeout"}


@pytest.fixture(scope="module", params=range(4))
def roads(request: pytest.FixtureRequest) -> Roads:
    return build(request.param)


def drive(world: World, frames: int) -> None:
    expert = Expert(world)
    for _ in range(frames):
        world.step(expert.control())


def digest(seed: int, frames: int) -> str:
    """All that is seen and felt on a journey."""
    world = World(seed)
    camera, birdview, expert = Camera(world), Birdview(world), Expert(world)
    picture, view = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros(SHAPE, np.uint8)
    everything = hashlib.sha256()
    for frame in range(frames):
        if frame % 5 == 0:
            camera.render(picture)
            birdview.render(view)
            everything.update(picture.tobytes() + view.tobytes())
        world.step(expert.control())
        everything.update(repr((world.car, world.traffic.cars, world.journey)).encode())
    return everything.hexdigest()


def test_one_seed_gives_the_same_frames_in_every_process() -> None:
    code = "from test_town import digest; print(digest(5, 30))"
    outputs = set()
    for hash_seed in ("1", "2"):
        environment = os.environ | {"PYTHONHASHSEED": hash_seed}
        environment["PYTHONPATH"] = str(Path(__file__).parent)
        argv = [sys.executable, "-c", code]
        run = subprocess.run(argv, env=environment, capture_output=True, text=True, check=True)
        outputs.add(run.stdout.strip())
    assert outputs == {digest(5, 30)}
    assert digest(6, 1) != digest(5, 1)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10_000),
    controls=st.lists(
        st.builds(Control, *[st.floats(-2, 2, allow_nan=False)] * 3), min_size=1, max_size=12
    ),
)
def test_whatever_a_driver_does_the_journey_goes_on_or_ends_for_a_reason(
    seed: int, controls: list[Control]
) -> None:
    world = World(seed)
    for control in [it for it in controls for _ in range(15)]:
        before = world.journey.frames
        world.step(control)
        journey = world.journey
        assert world.car.speed >= 0.0
        assert math.dist(world.car.place, world.route.path.at(journey.along)[:2]) < 5.0
        assert (journey.frames == before) <= (journey.ended in ENDS)
        assert journey.lines_passed <= len(world.route.stop_lines)
        assert journey.red_lights + journey.stop_signs <= journey.lines_passed
    if world.journey.ended:
        place = world.car.place
        world.step(Control(1.0))
        assert world.car.place == place


def test_every_lane_leads_to_the_next_one(roads: Roads) -> None:
    assert len(roads.junctions) == SIDE * SIDE
    for lane in roads.lanes:
        assert 40.0 > lane.path.length - 25.0 > -25.0
        if not lane.inside:
            assert roads.exits(lane)
            for onto in roads.exits(lane):
                curve, after = roads.curve(lane, onto), roads.between[lane.end, onto]
                assert np.allclose(lane.path.points[-1], curve.path.points[0])
                assert np.allclose(curve.path.points[-1], after.path.points[0])
                turn = np.abs(np.diff(curve.path.headings)).max()
                assert turn < 0.35, "a car can follow the curve"


def test_lights_let_one_road_go_at_a_time_and_each_in_turn(roads: Roads) -> None:
    lights = Lights(roads, 0)
    junction = next(it for it in roads.junctions if it.kind == "light")
    seen = []
    for frame in range(700):
        shown = [lights.colour(junction.number, other, frame) for other in junction.neighbours]
        assert sum(colour != RED for colour in shown) <= 1
        seen += [index for index, colour in enumerate(shown) if colour == GREEN]
    assert set(seen) == set(range(len(junction.neighbours)))


def test_cars_obey_each_other() -> None:
    world = World(3, Setting(cars=30, crossers=8, strollers=0))
    driven = 0.0
    for _ in range(900):
        world.step(Control(brake=1.0))
        driven += sum(car.speed for car in world.traffic.cars) * DT
        cars = world.traffic.cars
        for index, car in enumerate(cars):
            for other in cars[index + 1 :]:
                if math.dist(car.place, other.place) < 4.0:
                    assert not geometry.overlap(car.corners(), other.corners())
    assert not world.journey.ended
    assert driven / len(world.traffic.cars) > 45.0, "traffic flows"


@pytest.mark.parametrize("seed", [0, 1])
def test_the_expert_completes_its_route_and_obeys(seed: int) -> None:
    world = World(seed)
    expert = Expert(world)
    while not world.journey.ended:
        world.step(expert.control())
    assert world.journey.clean
    assert world.journey.lines_passed == len(world.route.stop_lines) > 0


def test_a_driver_that_looks_at_nothing_runs_lights_and_signs() -> None:
    runs = {"light": 0, "stop": 0}
    for seed in range(8):
        world = World(seed, QUIET)
        expert = Expert(world)
        kinds = [line.kind for line in world.route.stop_lines]
        while not world.journey.ended:
            world.step(expert.in_traffic())
        assert world.journey.completed
        assert world.journey.stop_signs == kinds.count("stop")
        runs["light"] += world.journey.red_lights
        runs["stop"] += world.journey.stop_signs
    assert runs["light"] > 5
    assert runs["stop"] > 3


def test_what_a_car_hits_ends_its_journey() -> None:
    world = World(0, Setting(cars=0, crossers=0, strollers=1))
    person = world.pedestrians.strollers[0].body
    world.car.x, world.car.y = shifted(person.place, world.car.heading, -1.0)
    assert world.touches(person, walker=True)
    car = Body(*shifted(world.car.place, world.car.heading, 4.3), world.car.heading)
    assert world.touches(car, walker=False)
    assert not world.touches(Body(*shifted(car.place, car.heading, 0.2), car.heading), walker=False)


def test_straight_on_leaves_the_road() -> None:
    ends = set()
    for seed in range(4):
        world = World(seed, QUIET)
        while not world.journey.ended:
            world.step(Control(throttle=1.0))
        ends.add(world.journey.ended)
    assert ends == {"off the road"}


def test_a_car_stops_where_it_is_asked_to() -> None:
    for speed in (3.0, 6.0, 8.0):
        world = World(0, QUIET)
        world.car.speed, begin, goal = speed, world.car.place, 20.0
        for _ in range(400):
            left = goal - math.dist(begin, world.car.place)
            throttle, brake = follow(world.car.speed, 8.0)
            advice = stop_in(world.car.speed, left)
            world.car.drive(advice.applied(Control(throttle, 0.0, brake)))
        assert world.car.speed == 0.0
        assert abs(math.dist(begin, world.car.place) - goal) < 0.8


def pictures(world: World) -> Iterator[np.ndarray]:
    """The same picture over black and over white."""
    camera = Camera(world)
    for before in (0, 255):
        picture = np.full((HEIGHT, WIDTH, 3), before, np.uint8)
        camera.render(picture)
        yield picture


def test_a_picture_is_drawn_whole_into_the_array_that_is_given() -> None:
    world = World(2)
    drive(world, 30)
    black, white = pictures(world)
    assert np.array_equal(black, white)
    assert black.std() > 20.0
    views = [np.full(SHAPE, before, np.uint8) for before in (0, 255)]
    for view in views:
        Birdview(world).render(view)
    assert np.array_equal(views[0], views[1])
    assert set(np.unique(views[0])) == {0, 255}


def test_an_array_of_another_shape_is_an_error() -> None:
    world = World(2, QUIET)
    with pytest.raises(ValueError, match=r"uint8 of \(480, 640, 3\), not uint8 of \(48, 64, 3\)"):
        Camera(world).render(np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(ValueError, match=r"uint8 of \(6, 64, 64\), not float32"):
        Birdview(world).render(np.zeros(SHAPE, np.float32))


def before_line(kind: str, metres: float) -> tuple[World, int]:
    """A quiet town with the car so far before the first line of a kind."""
    for seed in range(20):
        world = World(seed, QUIET)
        lines = [index for index, it in enumerate(world.route.stop_lines) if it.kind == kind]
        if lines:
            line = world.route.stop_lines[lines[0]]
            along = line.along - metres
            world.car.x, world.car.y, world.car.heading = world.route.path.at(along)
            world.journey.along, world.journey.lines_passed = along, lines[0]
            return world, lines[0]
    raise AssertionError(kind)


def seen_of(world: World, kind: str) -> list[tuple[float, float, float]]:
    """Middle and height of the boxes of a kind."""
    camera = Camera(world)
    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    found = labels(camera, camera.render(picture))
    assert all(it.kind in KINDS for it in found)
    boxes = [it for it in found if kind in it.kind]
    return [((b.left + b.right) / 2, (b.top + b.bottom) / 2, b.bottom - b.top) for b in boxes]


def test_a_light_is_seen_where_geometry_says() -> None:
    world, _ = before_line("light", 10.4)
    away = 10.0 + LIGHT_BEYOND
    row = HORIZON - FOCAL * (LIGHT_MIDDLE - 1.6) / away
    places = seen_of(world, "light")
    assert any(abs(x - WIDTH / 2) < 3 and abs(y - row) < 2 for x, y, _ in places)


def test_a_light_has_the_colour_that_it_shows() -> None:
    world, index = before_line("light", 8.0)
    line, camera = world.route.stop_lines[index], Camera(world)
    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    seen = set()
    for _ in range(0, 660, 20):
        found = labels(camera, camera.render(picture))
        colour = world.colour(line)
        own = min(
            (it for it in found if it.kind.endswith("light")),
            key=lambda it: abs((it.left + it.right) / 2 - WIDTH / 2),
        )
        assert own.kind == f"{colour} light"
        box = picture[own.top : own.bottom, own.left : own.right].astype(int)
        red, green = int(box[..., 0].max()), int(box[..., 1].max())
        assert (red > 180, green > 140) == {
            "red": (True, False),
            "yellow": (True, True),
            "green": (False, True),
        }[colour]
        seen.add(colour)
        world.journey.frames += 20
    assert seen == {"red", "yellow", "green"}


def test_a_sign_is_seen_where_geometry_says() -> None:
    world, _ = before_line("stop", 12.4)
    away = 12.3
    column, row = (
        WIDTH / 2 + FOCAL * SIGN_RIGHT / away,
        HORIZON - FOCAL * (SIGN_MIDDLE - 1.6) / away,
    )
    places = seen_of(world, "stop sign")
    assert any(abs(x - column) < 3 and abs(y - row) < 3 for x, y, _ in places)


def test_what_is_behind_a_house_is_not_asked_for() -> None:
    world = World(1, Setting(cars=30, crossers=10, strollers=20))
    camera = Camera(world)
    found = labels(camera, camera.render(np.zeros((HEIGHT, WIDTH, 3), np.uint8)))
    near = [
        it
        for it in [*world.traffic.cars, *world.pedestrians.bodies]
        if 0 < geometry.seen_from(it.place, world.car.place, world.car.heading)[0] < 75
        and math.dist(it.place, world.car.place) < 75
    ]
    assert len([it for it in found if it.kind in ("car", "person")]) < len(near)


def test_the_stop_line_is_white_where_the_camera_looks_at_it() -> None:
    world, _ = before_line("stop", 8.4)
    picture = next(pictures(world))
    row = int(HORIZON + FOCAL * 1.6 / 8.0)
    stripe = picture[row - 1 : row + 1, WIDTH // 2 - 40 : WIDTH // 2 + 40].astype(int)
    around = picture[row + 30 : row + 40, WIDTH // 2 - 40 : WIDTH // 2 + 40].astype(int)
    assert stripe.mean() > around.mean() + 60


def test_the_birds_eye_view_shows_the_car_on_its_route_and_what_is_near() -> None:
    world = World(4, Setting(cars=0, crossers=0, strollers=0))
    ahead = shifted(world.car.place, world.car.heading, 10.0)
    lane = world.roads.lanes[0]
    world.traffic.cars = [Car(*ahead, world.car.heading, 4.0, lane=lane.number)]
    view = np.zeros(SHAPE, np.uint8)
    Birdview(world).render(view)
    channel = dict(zip(CHANNELS, view, strict=True))
    row, column = 47, 31
    assert channel["road"][row, column] == channel["route"][row, column] == 255
    assert channel["cars"][row, column] == 0
    rows, columns = np.nonzero(channel["cars"])
    assert abs(rows.mean() - (row - 20)) < 1.5 and abs(columns.mean() - column) < 1.5
    assert channel["motion"].sum() > channel["cars"].sum()
    assert colours(view).shape == (64, 64, 3)


def test_stopping_at_a_sign_counts_and_rolling_over_its_line_does_too() -> None:
    for stands, wrong in ((True, 0), (False, 1)):
        world, index = before_line("stop", 5.0)
        world.car.speed = 0.0 if stands else 4.0
        for _ in range(80):
            world.step(Control(throttle=1.0))
            if world.journey.lines_passed > index:
                break
        assert world.journey.stop_signs == wrong
