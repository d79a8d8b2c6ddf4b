"""Judges the detector on pictures of towns that it has not learned from.

    python -m training.judge_detector --pictures 400

A thing is found if a box of its kind covers it with an intersection over union of at least a half.
What is too small or mostly hidden is not asked for, and finding it is not wrong. Precision and
recall are at the certainty that the application asks for; the average precision is the area under
the curve of both over all certainties. It writes `models/detector_judged.json`.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from autopilot.detector import KINDS, Detection, Detector
from autopilot.rules import CERTAIN
from town.labels import Label

from .pictures import pictures

MODELS = Path(__file__).resolve().parents[1] / "models"
_SAME = 0.5


@dataclass
class Tally:
    """What was found of one kind: for each box its score, and whether it was right."""

    asked: int = 0
    boxes: list[tuple[float, bool]] = field(default_factory=list)

    def result(self) -> dict[str, float | int]:
        """Precision, recall and average precision."""
        certain = [right for score, right in self.boxes if score >= CERTAIN]
        found = sum(certain)
        return {
            "asked": self.asked,
            "precision": round(found / max(1, len(certain)), 4),
            "recall": round(found / max(1, self.asked), 4),
            "average_precision": round(self._average_precision(), 4),
        }

    def _average_precision(self) -> float:
        ranked = sorted(self.boxes, key=lambda box: -box[0])
        right = np.cumsum([box[1] for box in ranked] or [0])
        precision = right / np.arange(1, len(right) + 1)
        best = np.maximum.accumulate(precision[::-1])[::-1]
        recall = np.concatenate([[0.0], right / max(1, self.asked)])
        return float((np.diff(recall) * best).sum())


def count(tallies: dict[str, Tally], found: list[Detection], labels: list[Label]) -> None:
    """Adds one picture. A label is found once; a second box on it is wrong."""
    open_labels = list(labels)
    for label in labels:
        tallies[label.kind].asked += not label.faint
    for it in sorted(found, key=lambda it: -it.score):
        alike = [label for label in open_labels if label.kind == it.kind]
        best = max(alike, key=lambda label: _overlap(it, label), default=None)
        if best is not None and _overlap(it, best) >= _SAME:
            open_labels.remove(best)
            if not best.faint:
                tallies[it.kind].boxes.append((it.score, True))
        elif not any(label.faint and _overlap(it, label) > 0.2 for label in alike):
            tallies[it.kind].boxes.append((it.score, False))


def _overlap(it: Detection, label: Label) -> float:
    wide = min(it.right, label.right) - max(it.left, label.left)
    high = min(it.bottom, label.bottom) - max(it.top, label.top)
    shared = max(wide, 0.0) * max(high, 0.0)
    own = (it.right - it.left) * (it.bottom - it.top)
    return shared / (own + (label.right - label.left) * (label.bottom - label.top) - shared)


def main() -> None:
    """Judges, prints and writes the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=400)
    options = parser.parse_args()
    detector, tallies = Detector(), {kind: Tally() for kind in KINDS}
    for number, (picture, labels) in enumerate(pictures(first_seed=0, per_seed=10)):
        if number == options.pictures:
            break
        count(tallies, detector.detect(picture, 0.05), labels)
    kinds = {kind: tally.result() for kind, tally in tallies.items()}
    mean = float(np.mean([it["average_precision"] for it in kinds.values()]))
    told = {"pictures": options.pictures, "mean_average_precision": round(mean, 4), "kinds": kinds}
    (MODELS / "detector_judged.json").write_text(json.dumps(told, indent=1) + "\n")
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
