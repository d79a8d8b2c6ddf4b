"""The tree of frames: which transform leads from one to another, at a time.

A machine without clocks and threads: it knows names, nanoseconds and numbers, and raises the
exceptions of tf2. Time 0 means the latest time at which all frames on the way are known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from hprm.ros._tf2_ros._errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)
from hprm.ros._tf2_ros._geometry import IDENTITY, Rigid, compose, inverse
from hprm.ros._tf2_ros._history import History, MovingHistory, Sample, StaticHistory

_NO_PARENT = "NO_PARENT"


class Tree:
    """All frames and their histories."""

    def __init__(self, cache_time: int) -> None:
        """Begin without frames; transforms are kept for ``cache_time`` nanoseconds."""
        self._cache_time = cache_time
        # A frame that is only known as a parent has no history: it is a root.
        self._frames: dict[str, History | None] = {}
        self._authorities: dict[str, str] = {}

    def set(self, frame: str, sample: Sample, authority: str, *, static: bool) -> bool:
        """Add a transform of a frame; return whether it is not too old to be kept."""
        history = self._frames.get(frame)
        kind = StaticHistory if static else MovingHistory
        if not isinstance(history, kind):
            history = StaticHistory() if static else MovingHistory(self._cache_time)
            self._frames[frame] = history
        self._frames.setdefault(sample.parent, None)
        added = history.add(sample)
        if added:
            self._authorities[frame] = authority
        return added

    def clear(self) -> None:
        """Forget all transforms but the static ones; the frames stay known."""
        for history in self._frames.values():
            if history is not None:
                history.clear()

    def names(self) -> list[str]:
        """Return the names of all frames, in the order in which they became known."""
        return list(self._frames)

    def check(self, frame: str, argument: str) -> None:
        """Raise an exception if an argument names no frame."""
        where = f'"{frame}" passed to {argument}'
        if not frame:
            raise InvalidArgumentException(
                f"Invalid argument {where} - in tf2 frame_ids cannot be empty"
            )
        if frame.startswith("/"):
            raise InvalidArgumentException(
                f"Invalid argument {where} - in tf2 frame_ids cannot start with a '/'"
            )
        if frame not in self._frames:
            raise LookupException(f"{where} does not exist. ")

    def lookup(self, target: str, source: str, time: int) -> tuple[int, Rigid]:
        """Return the transform that takes points of a source frame into a target frame.

        With it comes the time for which it is: the requested one, or for 0 the latest common one.
        """
        if target == source:
            return (time or self._latest_stamp(target)), IDENTITY
        if time == 0:
            time = self.latest_common_time(target, source)
        from_source, from_target = self._ways(target, source, lambda history: history.at(time))
        return time, compose(inverse(_chained(from_target)), _chained(from_source))

    def latest_common_time(self, target: str, source: str) -> int:
        """Return the latest time at which two frames are known in one another; static ones: 0."""
        if target == source:
            return self._latest_stamp(target)
        ways = self._ways(target, source, lambda history: history.latest())
        return min((step.stamp for way in ways for step in way if step.stamp), default=0)

    def _latest_stamp(self, frame: str) -> int:
        history = self._frames.get(frame)
        latest = None if history is None else history.latest()
        return 0 if latest is None else latest.stamp

    def _ways(
        self, target: str, source: str, find: Callable[[History], Sample | None]
    ) -> tuple[list[Sample], list[Sample]]:
        """Return the steps from two frames up to their nearest common ancestor."""
        suffix = f", when looking up transform from frame [{source}] to frame [{target}]"
        failed: TransformException | None = None
        passed = {source: 0}
        up: list[Sample] = []
        try:
            for step in self._climb(source, find):
                up.append(step)
                passed[step.parent] = len(up)
                if step.parent == target:
                    return up, []
        except ExtrapolationException as error:
            # There may still be a way: the target may hang below what was passed.
            failed = ExtrapolationException(f"{error}{suffix}")
        down: list[Sample] = []
        try:
            if target in passed:
                return up[: passed[target]], down
            for step in self._climb(target, find):
                down.append(step)
                if step.parent in passed:
                    return up[: passed[step.parent]], down
        except ExtrapolationException as error:
            raise ExtrapolationException(f"{error}{suffix}") from None
        raise failed or ConnectivityException(
            f"Could not find a connection between '{target}' and '{source}' because they are not "
            "part of the same tree. Tf has two or more unconnected trees."
        )

    def _climb(self, frame: str, find: Callable[[History], Sample | None]) -> Iterator[Sample]:
        path = [frame]
        while True:
            history = self._frames.get(frame)
            step = None if history is None else find(history)
            if step is None:
                return
            frame = step.parent
            if frame in path:
                loop = " -> ".join([*path[path.index(frame) :], frame])
                raise LookupException(
                    f"The tf tree is invalid because it contains a loop: {loop}\n{self.as_string()}"
                )
            path.append(frame)
            yield step

    def as_string(self) -> str:
        """Return a line for each frame with its parent."""
        lines = []
        for frame, history in self._frames.items():
            if history is not None:
                latest = history.latest()
                parent = _NO_PARENT if latest is None else latest.parent
                lines.append(f"Frame {frame} exists with parent {parent}.\n")
        return "".join(lines)

    def as_yaml(self, now: int) -> str:
        """Return what is known of each frame, in YAML; delays are left out if ``now`` is 0."""
        if not self._frames:
            return "[]"
        entries = []
        for frame, history in self._frames.items():
            latest = None if history is None else history.latest()
            if history is None or latest is None:
                continue
            oldest, newest, number = history.span()
            rate = number * 1e9 / max(newest - oldest, 100_000)
            delay = f"  transform_delay: {(now - newest) / 1e9:.3f}\n" if now else ""
            entries.append(
                f"{frame}: \n"
                f"  parent: '{latest.parent}'\n"
                f"  broadcaster: '{self._authorities[frame]}'\n"
                f"  rate: {rate:.3f}\n"
                f"  most_recent_transform: {newest / 1e9:.6f}\n"
                f"  oldest_transform: {oldest / 1e9:.6f}\n"
                f"{delay}"
                f"  buffer_length: {(newest - oldest) / 1e9:.3f}\n"
            )
        return "".join(entries)


def _chained(steps: list[Sample]) -> Rigid:
    """Return the transform of all steps, the lowest one first."""
    result = IDENTITY
    for step in steps:
        result = compose(step.transform, result)
    return result
