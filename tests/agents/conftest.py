"""Machines that do not outlive a test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from machines import Machines
from networks import Fleet


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Machines]:
    """Two machines without agents as yet."""
    machines = Machines(tmp_path)
    yield machines
    machines.close()


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[Fleet]:
    """Machines in subnets, without agents as yet."""
    fleet = Fleet(tmp_path)
    yield fleet
    fleet.close()
