"""Ray: a driver and an actor for each node; large messages are put into the object store once."""

from __future__ import annotations

import logging
import os
from typing import Any

import ray
from script import Answers
from session import Session, pin

_INLINE = 100_000
_STORE = 2_000_000_000


@ray.remote(num_cpus=0)
class _Actor:
    def __init__(self, cpu: int | None) -> None:
        pin(cpu)
        self._answers = Answers()

    def take(self, message: Any) -> Any:
        return self._answers.answer(message)


class Hub:
    """Calls every actor, and gets all results."""

    def __init__(self, session: Session) -> None:
        """Starts Ray and the actors."""
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
        ray.init(
            address="local",
            num_cpus=session.nodes + 1,
            object_store_memory=_STORE,
            include_dashboard=False,
            log_to_driver=False,
            logging_level=logging.ERROR,
            _temp_dir=session.directory,
        )
        self._actors = [_Actor.remote(session.node_cpu) for _ in range(session.nodes)]
        self._calls: list[Any] = []

    def send(self, message: Any) -> None:
        """To every node."""
        argument = ray.put(message) if memoryview(message).nbytes > _INLINE else message
        self._calls = [actor.take.remote(argument) for actor in self._actors]

    def receive(self) -> list[Any]:
        """One reply of each node."""
        return ray.get(self._calls)

    def close(self) -> None:
        """Ends Ray, with its processes."""
        ray.get(self._calls)
        ray.shutdown()
