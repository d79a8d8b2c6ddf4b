"""The driving application end to end: four federates, each way of running it, bit for bit alike."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import av
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "driving"))

from autopilot.agent import GeometricAgent, PolicyAgent, action_of, control_of, state_vector
from autopilot.colour_detector import ColourDetector
from autopilot.demo import box_plot
from autopilot.detector import Detection, Detector, decode
from autopilot.film import Film, FilmError
from autopilot.judge import interval, journey
from autopilot.latency import Latencies, MeasureError
from autopilot.lookout import Lookout
from autopilot.network import ModelError, Network
from autopilot.options import options
from autopilot.rules import Rules
from autopilot.simulator import BIRDVIEW, PICTURE, Town, state_of
from town.camera import CAMERA_AHEAD, CAMERA_HEIGHT, FOCAL, HORIZON
from town.controls import FREE, Control
from town.lights import DT
from town.shapes import LIGHT_BEYOND, LIGHT_HEIGHT, LIGHT_MIDDLE, LIGHT_WIDTH, SIGN_RIGHT
from town.world import Setting, World

DRIVING = Path(__file__).resolve().parents[2] / "examples" / "driving"
HPRM = str(Path(sys.executable).parent / "hprm")
ARGUMENTS = ["--", "--agent", "geometric", "--detector", "off"]
PROGRAMS = ["DrivingCentralized.lf", "DrivingDecentralized.lf", "driving.py"]


def hprm(*words: str, timeout: float = 100) -> subprocess.CompletedProcess[str]:
    argv = [HPRM, *words]
    return subprocess.run(
        argv, cwd=DRIVING, capture_output=True, text=True, timeout=timeout, check=False
    )


def test_a_journey_is_the_same_however_it_runs() -> None:
    frames = 300 if os.environ.get("HPRM_ACCEPTANCE") else 15
    words = [PROGRAMS[0], *ARGUMENTS, "--frames", str(frames)]
    done = hprm("verify", "--json", *words, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    told = json.loads(done.stdout)
    assert told["equal"] and told["runs"] == 6
    # Five reactions begin, and four run for each frame: three of them for the last one, too.
    assert told["reactions"] > 4 * frames
    assert told["opaque_values"] == told["left_out"] == told["tardy"] == 0


@pytest.mark.parametrize("program", PROGRAMS)
def test_each_program_drives_as_far_as_its_parts_do_without_it(program: str) -> None:
    world, agent = Town(6, 40), GeometricAgent()
    view = np.zeros(BIRDVIEW, np.uint8)
    while not world.ended():
        world.look_down(view)
        world.step(agent.drive(view, world.state()))
    done = hprm("run", program, *ARGUMENTS, "--frames", "40")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"[simulator] {world.summary()}\n"
    assert "frame 40: " in done.stdout


def test_pictures_are_not_copied(tmp_path: Path) -> None:
    for name in ("autopilot", "town", "models", "DrivingDecentralized.lf"):
        (tmp_path / name).symlink_to(DRIVING / name)
    (tmp_path / "lib").mkdir()
    text = (DRIVING / "lib" / "Driving.lf").read_text()
    counted = text.replace("self.world.close()", 'print(lf.store_stats()["bytes_copied"])')
    assert counted != text
    (tmp_path / "lib" / "Driving.lf").write_text(counted)
    done = hprm("run", str(tmp_path / "DrivingDecentralized.lf"), *ARGUMENTS, "--frames", "20")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[simulator] 0"


def test_a_word_that_no_program_knows_is_an_error() -> None:
    done = hprm("run", PROGRAMS[0], "--", "--agent", "reckless")
    assert done.returncode != 0
    assert "invalid choice: 'reckless'" in done.stderr


def test_a_slow_detector_makes_the_fusion_brake() -> None:
    done = hprm("run", "DrivingDeadline.lf", *ARGUMENTS, "--frames", "40", "--slow", "0.3")
    assert done.returncode == 0, done.stderr
    (told,) = re.findall(r"braked at (\d+) of 40 frames", done.stdout)
    # It is slow from the 20th picture on; a busy machine makes others late, too.
    assert int(told) >= 19


def test_a_slow_detector_keeps_no_control_waiting_if_the_latest_sight_serves() -> None:
    done = hprm("run", "DrivingLatest.lf", *ARGUMENTS, "--frames", "40", "--slow", "0.3")
    assert done.returncode == 0, done.stderr
    (told,) = re.findall(r"40 frames, (\d+) of them seen by the detector", done.stdout)
    assert 0 < int(told) < 40


def test_the_film_has_each_frame_and_can_be_played(tmp_path: Path) -> None:
    film = tmp_path / "drive.mp4"
    done = hprm("run", "DrivingFilm.lf", *ARGUMENTS, "--frames", "12", "--film", str(film))
    assert done.returncode == 0, done.stderr
    with av.open(str(film)) as played:
        frames = [frame.to_ndarray(format="rgb24") for frame in played.decode(video=0)]
    assert len(frames) == 12
    assert frames[0].shape == (480, 880, 3)
    world = Town(6, 12)
    picture = np.zeros(PICTURE, np.uint8)
    world.take_picture(picture)
    # The upper half has nothing drawn on it here; the video is nearly what was seen.
    difference = np.abs(frames[0][:240, :640].astype(int) - picture[:240])
    assert difference.mean() < 6.0


@pytest.mark.parametrize("frames", ["12", "150"])
def test_a_film_that_cannot_be_written_is_one_clear_error(tmp_path: Path, frames: str) -> None:
    film = tmp_path / "nowhere" / "drive.mp4" if frames == "12" else tmp_path / "drive.mp4"
    words = ["DrivingFilm.lf", *ARGUMENTS, "--frames", frames, "--film", str(film)]
    # A file that may not grow is as good as a disk that is full.
    argv = ["bash", "-c", 'trap "" XFSZ; ulimit -f 30; exec "$0" run "$@"', HPRM, *words]
    done = subprocess.run(
        argv, cwd=DRIVING, capture_output=True, text=True, timeout=100, check=False
    )
    reason = "No such file or directory" if frames == "12" else "File too large"
    assert done.returncode != 0
    assert f"the film {film} cannot be written: {reason}" in done.stderr
    assert done.stderr.count("error: ") == 1, done.stderr


# What lights and signs ask for.


def seen_light(colour: str, to_line: float, left: float = 0.0) -> Detection:
    """A light as the camera sees it, if the middle of the car is so far from its line."""
    away = to_line - CAMERA_AHEAD + LIGHT_BEYOND
    column = 320 - FOCAL * left / away
    row = HORIZON - FOCAL * (LIGHT_MIDDLE - CAMERA_HEIGHT) / away
    half_width, half = FOCAL * LIGHT_WIDTH / away / 2, FOCAL * LIGHT_HEIGHT / away / 2
    edges = (column - half_width, row - half, column + half_width, row + half)
    return Detection(f"{colour} light", 0.9, *edges)


def seen_sign(to_line: float) -> Detection:
    """A stop sign in the same way."""
    away = to_line + 0.3 - CAMERA_AHEAD
    column, half = 320 + FOCAL * SIGN_RIGHT / away, FOCAL * 0.5 / away
    return Detection("stop sign", 0.9, column - half, 200 - half, column + half, 200 + half)


def approach(metres: float, see, seconds: float = 20.0) -> list[tuple[float, float]]:  # type: ignore[no-untyped-def]
    """Drives towards a line as fast as the rules let it; how far it is, and how fast, by frame."""
    rules, speed, course = Rules(), 6.0, []
    for frame in range(round(seconds / DT)):
        advice = rules.advice(see(frame, metres), speed)
        speed = max(0.0, speed + (3.0 * min(0.4, advice.throttle) - 7.0 * advice.brake) * DT)
        speed = min(speed, 8.0)
        metres -= speed * DT
        course.append((metres, speed))
    return course


def test_a_red_light_stops_the_car_before_its_line_and_green_lets_it_go() -> None:
    def see(frame: int, metres: float) -> list[Detection]:
        colour = "red" if frame < 200 else "green"
        return [seen_light(colour, metres)] if metres > -10 else []

    course = approach(30.0, see)
    metres, speed = course[199]
    assert 2.5 < metres < 6.0 and speed < 0.1
    assert course[-1][0] < 0.0


def test_a_red_light_that_is_not_seen_for_a_moment_still_holds() -> None:
    course = approach(30.0, lambda frame, m: [] if frame % 4 else [seen_light("red", m)])
    assert min(metres for metres, _ in course) > 2.0


@pytest.mark.parametrize(
    "other",
    [
        lambda m: seen_light("green", m),
        lambda m: seen_light("red", m, left=9.0),
        lambda m: seen_light("red", -8.0),
        lambda m: Detection("red light", 0.2, 315, 100, 325, 130),
    ],
    ids=["green", "of another road", "over the junction", "uncertain"],
)
def test_other_lights_stop_nothing(other) -> None:  # type: ignore[no-untyped-def]
    assert Rules().advice([other(12.0)], 6.0) == FREE


def test_a_light_that_turns_yellow_too_late_is_passed_and_otherwise_obeyed() -> None:
    assert Rules().advice([seen_light("yellow", 6.0)], 8.0) == FREE
    assert Rules().advice([seen_light("yellow", 15.0)], 8.0).brake > 0.0


def test_the_car_stands_at_a_sign_and_then_goes_although_it_is_out_of_sight() -> None:
    course = approach(30.0, lambda frame, m: [seen_sign(m)] if m > 4.5 else [])
    stands = [metres for metres, speed in course if speed < 0.1]
    assert stands and all(1.0 < metres < 6.0 for metres in stands)
    assert course[-1][0] < -5.0


@pytest.mark.parametrize(
    ("eyes", "ran"), [("off", (1, 1)), ("colours", (0, 0)), ("network", (0, 0))]
)
def test_what_the_detector_sees_decides(eyes: str, ran: tuple[int, int]) -> None:
    seen = journey(0, "geometric", eyes, Setting(2, 0, 0, 0))
    assert (seen.ended, seen.red_lights, seen.stop_signs) == ("completed", *ran)


# Agents, networks, and what judges them.


@pytest.mark.parametrize("agent", ["geometric", "policy"])
def test_an_agent_completes_routes_when_lights_are_obeyed_for_it(agent: str) -> None:
    verdicts = [journey(seed, agent, "perfect", Setting(2, 10, 4, 4)) for seed in (0, 1)]
    assert [it.ended for it in verdicts] == ["completed", "completed"]
    assert all(it.red_lights == it.stop_signs == 0 for it in verdicts)
    assert journey(0, "constant", "perfect", Setting(2, 10, 4, 4)).ended != "completed"


def test_an_action_is_a_control_within_bounds() -> None:
    # At the speed that is wanted, a little throttle keeps it.
    assert control_of(np.array([0.5, -0.25]), speed=6.0) == Control(0.15, -0.25, 0.0)
    assert control_of(np.array([-3.0, 7.0]), speed=6.0) == Control(0.0, 1.0, 1.0)
    assert control_of(np.array([9.0, -7.0]), speed=0.0) == Control(1.0, -1.0, 0.0)
    assert action_of(6.0, -0.25) == (0.5, -0.25)
    assert state_vector(state_of(World(0))).shape == (8,)


def test_wilsons_interval() -> None:
    low, high = interval(27, 30)
    assert (round(low, 3), round(high, 3)) == (0.744, 0.965)


def test_cells_become_boxes_each_thing_once() -> None:
    cells = np.full((60 * 80 + 15 * 20, 11), -9.0, np.float32)
    for cell, certainty in ((80 * 10 + 20, 4.0), (80 * 10 + 21, 3.0)):
        cells[cell, 0] = certainty
        cells[cell, 1:5] = (20.5 - cell % 80, 0.0, 0.0, np.log(2.0))
        cells[cell, 5 + 3] = 5.0
    (found,) = decode(cells)
    assert found.kind == "stop sign"
    assert found.score == pytest.approx(1 / (1 + np.exp(-4.0)))
    assert (found.left, found.top) == pytest.approx((158.0, 64.0))
    assert (found.right, found.bottom) == pytest.approx((178.0, 104.0))


def test_a_lookout_without_eyes_asks_for_nothing() -> None:
    assert Lookout(None).look(np.zeros(PICTURE, np.uint8), 8.0).advice == FREE


@pytest.mark.parametrize("network", [PolicyAgent, Detector])
@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("missing", r"model\.onnx does not exist"),
        ("corrupt", r"model\.onnx cannot be read: "),
        ("cut short", r"model\.onnx cannot be read: "),
        ("with other inputs", r"model\.onnx has the inputs .*\(1, 6, 64, 64\).*, not "),
    ],
)
def test_a_model_that_cannot_be_used_is_one_clear_error(
    network: type[PolicyAgent | Detector], fault: str, told: str, tmp_path: Path
) -> None:
    spoil(tmp_path / "model.onnx", fault)
    with pytest.raises(ModelError, match=told):
        network(tmp_path / "model.onnx")


@pytest.mark.parametrize(
    ("size", "numbers", "told"),
    [
        (64, 2, None),
        (32, 2, "has the inputs {'birdview': (1, 6, 64, 64), 'state': (1, 8)}, not "),
        (64, 3, "has the outputs {'action': (1, 2)}, not {'action': (1, 3)}"),
    ],
)
def test_a_model_of_another_shape_is_one_clear_error(
    size: int, numbers: int, told: str | None
) -> None:
    inputs = {"birdview": (1, 6, size, size), "state": (1, 8)}
    expected = pytest.raises(ModelError, match=re.escape(told)) if told else nullcontext()
    with expected:
        Network(DRIVING / "models" / "policy.onnx", inputs, {"action": (1, numbers)})


def spoil(model: Path, fault: str) -> None:
    """Leaves something else in the place of a model."""
    whole = (DRIVING / "models" / "policy.onnx").read_bytes()
    if fault == "corrupt":
        model.write_bytes(b"not a network")
    elif fault == "cut short":
        model.write_bytes(whole[: len(whole) // 2])
    elif fault == "with other inputs":
        model.write_bytes(whole.replace(b"birdview", b"overview"))


@pytest.mark.parametrize("fault", ["missing", "corrupt", "with other inputs"])
def test_a_program_without_its_model_is_one_clear_error(fault: str, tmp_path: Path) -> None:
    for name in ("autopilot", "town"):
        shutil.copytree(DRIVING / name, tmp_path / name)
    shutil.copy(DRIVING / "driving.py", tmp_path)
    (tmp_path / "models").mkdir()
    spoil(tmp_path / "models" / "policy.onnx", fault)
    words = ["--agent", "policy", "--detector", "off", "--frames", "5"]
    done = hprm("run", str(tmp_path / "driving.py"), "--", *words)
    assert done.returncode != 0
    assert f"the model {tmp_path}/models/policy.onnx " in done.stderr
    assert done.stderr.count("error: ") == 1, done.stderr


def test_the_box_plot_has_a_box_for_each_coordination() -> None:
    fast, slow = [8_000_000, 9_000_000, 10_000_000] * 10, [20_000_000, 30_000_000] * 10
    drawn = box_plot({"centralized": slow, "decentralized": fast})
    assert ">centralized</text>" in drawn and ">decentralized</text>" in drawn
    assert "nan" not in drawn
    assert drawn == box_plot({"centralized": slow, "decentralized": fast})


def test_latencies_are_those_of_the_frames_and_say_how_far_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "measured.json"
    measured = Latencies(str(file), 40)
    for _ in range(40):
        measured.frame_sent()
        measured.control_came()
    measured.save()
    told = json.loads(file.read_text())
    assert len(told["latencies_ns"]) == 40 and min(told["latencies_ns"]) > 0
    assert capsys.readouterr().out == "progress 20 40\nprogress 40 40\n"


def test_the_colour_detector_finds_a_light_and_a_sign_and_no_red_wall() -> None:
    picture = np.full(PICTURE, 150, np.uint8)
    picture[80:140, 300:324] = 26
    picture[86:103, 303:321] = (250, 44, 36)
    for row in range(30):
        corner = max(0, 9 - row, row - 20)
        picture[100 + row, 500 + corner : 530 - corner] = (190, 24, 30)
    picture[112:118, 506:524] = 230
    picture[60:150, 100:190] = (150, 40, 40)
    found = {it.kind: it for it in ColourDetector().detect(picture)}
    assert set(found) == {"red light", "stop sign"}
    light = found["red light"]
    assert abs((light.left + light.right) / 2 - 312) < 2
    assert abs((light.top + light.bottom) / 2 - 112) < 4


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--frames", "0"], "argument --frames: '0' is not a whole number from 1 to"),
        (["--seed", "-1"], "argument --seed: '-1' is not a whole number from 0 to"),
        (["--port", "99999"], "argument --port: '99999' is not a whole number from 1 to 65535"),
        (["--slow", "nan"], "argument --slow: 'nan' is not a number of seconds from 0 to"),
        (["--slow", "x"], "argument --slow: 'x' is not a number of seconds from 0 to"),
    ],
)
def test_a_number_that_makes_no_sense_is_one_clear_error(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        options(words)
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_files_that_cannot_be_written_are_told_before_the_drive(tmp_path: Path) -> None:
    with pytest.raises(MeasureError, match=r"no/x\.json cannot be written: No such file"):
        Latencies(str(tmp_path / "no" / "x.json"), 10)
    with pytest.raises(FilmError, match=r"drive\.xyz has a name of no kind of film"):
        Film(tmp_path / "drive.xyz")


@pytest.mark.parametrize("picture", ["600", "600:frame.xyz", "99999:late.png", "x:late.png"])
def test_a_picture_that_cannot_be_drawn_is_one_clear_error(picture: str, tmp_path: Path) -> None:
    argv = [sys.executable, "-m", "town", "--seed", "6", "--picture", picture]
    done = subprocess.run(
        argv,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(DRIVING)},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 2
    assert f"error: --picture {picture}: " in done.stderr
