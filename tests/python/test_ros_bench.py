"""The benchmark of programs of rclpy: that it runs, and what it does if a program fails."""

from __future__ import annotations

import sys

import pytest
from processes import ROOT

sys.path.insert(0, str(ROOT / "bench"))

import ros2_programs


@pytest.mark.parametrize("size", ros2_programs.SIZES)
def test_a_talker_and_a_listener_are_measured(size: str) -> None:
    took = ros2_programs.pair("hprm.ros", size, is_quick=True)
    assert len(took) == 10
    assert min(took) > 0


def test_a_timer_and_a_launch_are_measured() -> None:
    assert 0 < ros2_programs.idle(is_quick=True) < 1
    assert 0 < ros2_programs.launch(3) < ros2_programs.TIME_LIMIT_S


def test_what_fails_is_named() -> None:
    with pytest.raises(ros2_programs.Failed, match="nothing.py has failed: .*nothing.py"):
        ros2_programs.run([str(ros2_programs.HPRM), "ros", "run", "nothing.py"])
