"""What the networks of examples/driving learn from, and how the detector is judged, without JAX."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "driving"))

from autopilot.detector import KINDS, Detection
from town.labels import Label
from training.environment import Drives
from training.judge_detector import Tally, count
from training.pictures import pictures


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
