"""Machines that do not outlive a test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from machines import Machines


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Machines]:
    """Two machines without agents as yet."""
    machines = Machines(tmp_path)
    yield machines
    machines.close()
