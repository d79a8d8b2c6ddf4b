"""What the networks of examples/driving learn from, and how the detector is judged, without JAX."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "driving"))

from autopilot.agent import action_of
from autopilot.detector import KINDS, SCALES, Detection
from town.labels import Label
from training.crops import BATCH, SIDE, TOLD, Crops, empty_targets, mark
from training.curves import detector_curve, policy_curve
from training.environment import UNSEEN, Drives
from training.judge_detector import Tally, count
from training.pictures import pictures

DRIVING = Path(__file__).resolve().parents[2] / "examples" / "driving"


def box(kind: str, left: int, faint: bool = False) -> Label:
    return Label(kind, left, 100, left + 20, 140, faint)


def found(kind: str, left: float, score: float) -> Detection:
    return Detection(kind, score, left, 100.0, left + 20.0, 140.0)


def test_a_thing_is_found_once_and_what_is_faint_does_not_count() -> None:
    tallies = {kind: Tally() for kind in KINDS}
    labels = [box("car", 0), box("car", 200), box("person", 300, faint=True)]
    sights = [found("car", 1, 0.9), found("car", 2, 0.8), found("person", 301, 0.9)]
    count(tallies, sights, labels)
    assert tallies["car"].result() == {
        "asked": 2,
        "precision": 0.5,
        "recall": 0.5,
        "average_precision": 0.5,
    }
    assert tallies["person"] == Tally()


def test_average_precision_is_the_area_under_the_best_precision() -> None:
    tally = Tally(asked=4, boxes=[(0.9, True), (0.8, False), (0.7, True), (0.1, True)])
    assert tally.result()["average_precision"] == round((1 + 0.75 + 0.75) / 4, 4)
    assert tally.result()["precision"] == round(2 / 3, 4)


def test_pictures_have_labels_on_them() -> None:
    taken = pictures(first_seed=0, per_seed=2)
    for _ in range(2):
        picture, labels = next(taken)
        assert picture.shape == (480, 640, 3)
        assert any(not it.faint for it in labels)
        assert all(
            0 <= it.left < it.right <= 640 and 0 <= it.top < it.bottom <= 480 for it in labels
        )


def test_driving_on_is_rewarded_and_leaving_the_road_is_not() -> None:
    drives = Drives(2, first_seed=1000)
    total = np.zeros(2)
    while not drives.finished():
        rewards, ends = drives.step(np.array([[1.0, 0.0], [1.0, 1.0]]))
        if ends.any():
            break
        total += rewards
    assert ends[1] and rewards[1] < -5.0
    assert total[0] > total[1]
    assert drives.views.shape == (2, 6, 64, 64) and drives.states.shape == (2, 8)


def test_values_know_of_the_next_light_what_it_will_show() -> None:
    drives = Drives(2, first_seed=1000)
    drive = drives.drives[0]
    while (line := drive.world.next_line) is None or line.kind != "light":
        drive.step(np.array(action_of(*drive.expert.wants())))
    left, limit, to_line, is_light, is_sign, *reds = drives.unseen()[0]
    assert (
        drives.unseen().shape == (2, UNSEEN) and 0.0 < min(left, limit) <= max(left, limit) <= 1.0
    )
    assert (is_light, is_sign) == (1.0, 0.0) and 0.0 < to_line <= 1.0
    light = (line.junction, line.arrives_from)
    frames = [drive.world.journey.frames + 20 * seconds for seconds in (0, 2, 4, 8, 16)]
    assert reds == [drive.world.lights.colour(*light, frame) == "red" for frame in frames]


def test_a_car_that_comes_too_fast_to_what_is_before_it_loses_by_that() -> None:
    drive = Drives(1, first_seed=1000).drives[0]
    straight_on = np.array(action_of(8.0, 0.0))
    for _ in range(20):
        drive.step(straight_on)
    drive.expert.safe_speed = lambda: 100.0  # type: ignore[method-assign]
    free, _ = copy.deepcopy(drive).step(straight_on)
    drive.expert.safe_speed = lambda: 1.0  # type: ignore[method-assign]
    near, _ = drive.step(straight_on)
    assert near == pytest.approx(free - 0.3 * (drive.world.car.speed - 1.5))


def test_a_box_is_told_to_the_cells_of_its_scale_and_of_its_middle() -> None:
    targets = empty_targets(SIDE)
    # 20 pixels wide and 40 high on the picture; the square begins 100 pixels further in.
    mark(targets, ["stop sign", 150, 120, 170, 160, False], (100, 100), mirrored=False)
    fine, coarse = targets
    assert not coarse.any()
    rows, columns = np.nonzero(fine[..., 0] == 1.0)
    middles = {(8 * column + 4, 8 * row + 4) for row, column in zip(rows, columns, strict=True)}
    assert middles and all(abs(x - 60) <= 8 and abs(y - 40) <= 12 for x, y in middles)
    for row, column in zip(rows, columns, strict=True):
        told = fine[row, column]
        x, y = (column + 0.5 + told[1]) * 8, (row + 0.5 + told[2]) * 8
        assert (x, y) == pytest.approx((60, 40))
        assert np.exp(told[3:5]) * SCALES[0].size == pytest.approx((20, 40))
        assert KINDS[int(told[5])] == "stop sign"
    assert (fine[..., 6] ** 2).sum() == pytest.approx(1.0)


def test_a_mirrored_box_is_on_the_other_side_and_one_that_is_faint_is_not_asked_for() -> None:
    targets = empty_targets(SIDE)
    mark(targets, ["car", 10, 20, 50, 50, False], (0, 0), mirrored=True)
    rows, columns = np.nonzero(targets[0][..., 0] == 1.0)
    assert all(abs(8 * column + 4 - (SIDE - 30)) < 12 for column in columns)
    targets = empty_targets(SIDE)
    mark(targets, ["car", 10, 20, 50, 50, True], (0, 0), mirrored=False)
    mark(targets, ["car", 300, 20, 350, 50, False], (0, 0), mirrored=False)
    assert set(np.unique(targets[0][..., 0])) == {-1.0, 0.0}


def test_the_squares_of_a_step_are_the_same_and_show_all_kinds(tmp_path: Path) -> None:
    stored = np.lib.format.open_memmap(
        tmp_path / "pictures.npy", "w+", dtype=np.uint8, shape=(8, 480, 640, 3)
    )
    boxes = []
    for number, (picture, labels) in zip(range(8), pictures(first_seed=0), strict=False):
        stored[number] = picture
        boxes.append([list(vars(it).values()) for it in labels])
    stored.flush()
    (tmp_path / "labels.json").write_text(json.dumps(boxes))
    crops = Crops(tmp_path, seed=3)
    (one, asked), (again, _), (other, _) = crops.batch(5), crops.batch(5), crops.batch(6)
    assert one.shape == (BATCH, SIDE, SIDE, 3) and one.dtype == np.uint8
    assert (one == again).all() and (one != other).any()
    assert [it.shape for it in asked] == [
        (BATCH, SIDE // it.stride, SIDE // it.stride, TOLD) for it in SCALES
    ]
    there = {int(cell[5]) for it in asked for cell in it[it[..., 0] == 1.0]}
    assert len(there) >= 3


def test_curves_are_pictures_of_their_points() -> None:
    ends = [{"collision": 0.5, "completed": 0.5}, {"completed": 1.0}]
    points = [
        {"phase": phase, "steps": 1000 * number, "ends": it}
        for number, (phase, it) in enumerate(zip(("imitation", "ppo"), ends, strict=True), 1)
    ]
    drawn = policy_curve(points)
    assert ">imitation</text>" in drawn and ">ppo</text>" in drawn
    assert drawn == policy_curve(points) != policy_curve(points[:1])
    assert ">steps</text>" in detector_curve([{"steps": 1, "loss": 2.0}, {"steps": 2, "loss": 1.0}])


def test_the_readme_says_how_the_detector_was_judged() -> None:
    judged = json.loads((DRIVING / "models" / "detector_judged.json").read_text())
    readme = (DRIVING / "README.md").read_text()
    assert f"On {judged['pictures']} pictures" in readme
    assert f"The mean average precision is {judged['mean_average_precision']:.2f}" in readme
    for kind, told in judged["kinds"].items():
        figures = (told[it] for it in ("precision", "recall", "average_precision"))
        row = [kind, str(told["asked"]), *(f"{it:.2f}" for it in figures)]
        assert f"| {' | '.join(row)} |" in readme
