"""The buffer of transforms without nodes and waiting, as in ``tf2_py.BufferCore``."""

from __future__ import annotations

import math
import threading
from typing import Any

from hprm.ros._interfaces import interface
from hprm.ros._tf2_ros._errors import TransformException
from hprm.ros._tf2_ros._geometry import Rigid, compose, normalized
from hprm.ros._tf2_ros._history import Sample, seconds
from hprm.ros._tf2_ros._tree import Tree
from hprm.ros.constants import S_TO_NS
from hprm.ros.duration import Duration
from hprm.ros.impl.rcutils_logger import RcutilsLogger
from hprm.ros.time import Time

_TOLERANCE = 10e-3
# As tf2 has it: the logger of these messages has no name.
_logger = RcutilsLogger()


def nanoseconds(time: Any, what: str = "time") -> int:
    """Return the nanoseconds of a time or duration, which may be a message."""
    found = getattr(time, "nanoseconds", None)
    if found is not None:
        return int(found)
    sec, nanosec = getattr(time, "sec", None), getattr(time, "nanosec", None)
    if sec is None or nanosec is None:
        raise TypeError(f"{what} must have sec and nanosec, or nanoseconds.")
    return int(sec) * S_TO_NS + int(nanosec)


class BufferCore:
    """Transforms between frames, over time.

    Parameters
    ----------
    cache_time
        How long transforms are kept, counted back from the latest one of each frame; 10 seconds,
        if it is not given.

    """

    def __init__(self, cache_time: Duration | None = None) -> None:
        """Begin without frames."""
        kept = 10 * S_TO_NS if cache_time is None else nanoseconds(cache_time, "duration")
        self._tree = Tree(kept)
        self._lock = threading.RLock()

    def set_transform(self, transform: Any, authority: str) -> None:
        """Add a ``TransformStamped`` of a frame that moves.

        What cannot be a transform, or is older than what is kept, is left out with a message of
        the log.
        """
        self._set(transform, authority, static=False)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Add a ``TransformStamped`` of a frame that never moves; its stamp does not count."""
        self._set(transform, authority, static=True)

    def _set(self, message: Any, authority: str, *, static: bool) -> None:
        child = message.child_frame_id.removeprefix("/")
        parent = message.header.frame_id.removeprefix("/")
        moved, turned = message.transform.translation, message.transform.rotation
        translation = float(moved.x), float(moved.y), float(moved.z)
        rotation = float(turned.x), float(turned.y), float(turned.z), float(turned.w)
        wrong = _mistakes(child, parent, translation, rotation)
        for tag, why in wrong:
            _logger.error(
                f'{tag}: Ignoring transform for child_frame_id "{child}" '
                f'from authority "{authority}" because {why}'
            )
        if wrong:
            return
        stamp = nanoseconds(message.header.stamp)
        sample = Sample(stamp, parent, Rigid(translation, normalized(rotation)))
        with self._lock:
            added = self._tree.set(child, sample, authority, static=static)
        if not added:
            _logger.warning(
                f"TF_OLD_DATA ignoring data from the past for frame {child} "
                f"at time {seconds(stamp)} according to authority {authority}"
            )

    def can_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> tuple[bool, str]:
        """Return whether ``lookup_transform_core`` would find a transform, and if not, why."""
        return self._can(
            (target_frame, source_frame), ((target_frame, source_frame, nanoseconds(time)),)
        )

    def can_transform_full_core(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> tuple[bool, str]:
        """Return whether ``lookup_transform_full_core`` would find one, and if not, why."""
        return self._can(
            (target_frame, source_frame, fixed_frame),
            (
                (target_frame, fixed_frame, nanoseconds(target_time)),
                (fixed_frame, source_frame, nanoseconds(source_time)),
            ),
        )

    def _can(
        self, frames: tuple[str, ...], lookups: tuple[tuple[str, str, int], ...]
    ) -> tuple[bool, str]:
        try:
            with self._lock:
                self._check("canTransform", *frames)
                for lookup in lookups:
                    self._tree.lookup(*lookup)
        except TransformException as error:
            return False, str(error)
        return True, ""

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Any) -> Any:
        """Return the transform that takes points of a source frame into a target frame.

        Parameters
        ----------
        target_frame
            The frame into which points are taken.
        source_frame
            The frame that they are in.
        time
            The time for which the transform is; 0 is the latest at which both are known.

        Returns
        -------
        TransformStamped
            With the time for which it is.

        Raises
        ------
        InvalidArgumentException
            If a name is empty or has a slash in front.
        LookupException
            If a frame does not exist, or the frames have a loop.
        ConnectivityException
            If no way leads from one frame to the other.
        ExtrapolationException
            If there are no data for the time.

        """
        with self._lock:
            self._check("lookupTransform", target_frame, source_frame)
            stamp, transform = self._tree.lookup(target_frame, source_frame, nanoseconds(time))
        return _message(stamp, transform, target_frame, source_frame)

    def lookup_transform_full_core(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> Any:
        """Return the transform between two frames at two times.

        Points of the source frame at its time are taken into a frame that does not move between
        the two times, and from there into the target frame at its time.
        """
        with self._lock:
            self._check("lookupTransform", target_frame, source_frame, fixed_frame)
            _, inner = self._tree.lookup(fixed_frame, source_frame, nanoseconds(source_time))
            stamp, outer = self._tree.lookup(target_frame, fixed_frame, nanoseconds(target_time))
        return _message(stamp, compose(outer, inner), target_frame, source_frame)

    def _check(self, function: str, target: str, source: str, fixed: str | None = None) -> None:
        if fixed is None and target == source:
            return
        self._tree.check(target, f"{function} argument target_frame")
        self._tree.check(source, f"{function} argument source_frame")
        if fixed is not None:
            self._tree.check(fixed, f"{function} argument fixed_frame")

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """Return the latest time at which two frames are known in one another."""
        with self._lock:
            self._tree.check(target_frame, "get_latest_common_time")
            self._tree.check(source_frame, "get_latest_common_time")
            return Time(nanoseconds=self._tree.latest_common_time(target_frame, source_frame))

    def all_frames_as_yaml(self, time: Any = None) -> str:
        """Return what is known of all frames, in YAML; with a time, how late they are."""
        with self._lock:
            return self._tree.as_yaml(0 if time is None else nanoseconds(time))

    def all_frames_as_string(self) -> str:
        """Return a line for each frame with its parent."""
        with self._lock:
            return self._tree.as_string()

    def clear(self) -> None:
        """Forget all transforms but the static ones."""
        with self._lock:
            self._tree.clear()

    def _frameExists(self, frame_id: str) -> bool:
        return frame_id in self._getFrameStrings()

    def _getFrameStrings(self) -> list[str]:
        with self._lock:
            return self._tree.names()


def _mistakes(
    child: str, parent: str, translation: tuple[float, ...], rotation: tuple[float, ...]
) -> list[tuple[str, str]]:
    """Return why these cannot be a transform, each with the name that tf2 has for it."""
    mistakes = []
    if child == parent:
        mistakes.append(("TF_SELF_TRANSFORM", "frame_id and child_frame_id are the same"))
    if not child:
        mistakes.append(("TF_NO_CHILD_FRAME_ID", "child_frame_id is not set"))
    if not parent:
        mistakes.append(("TF_NO_FRAME_ID", "frame_id is not set"))
    shown = f"{translation} {rotation}"
    if any(map(math.isnan, translation + rotation)):
        mistakes.append(("TF_NAN_INPUT", f"of a nan value in the transform {shown}"))
    elif abs(sum(part * part for part in rotation) - 1.0) >= _TOLERANCE:
        mistakes.append(
            ("TF_DENORMALIZED_QUATERNION", f"of an invalid quaternion in the transform {rotation}")
        )
    return mistakes


def _message(stamp: int, transform: Rigid, target: str, source: str) -> Any:
    message = interface("geometry_msgs.msg", "TransformStamped")()
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    message.header.frame_id = target
    message.child_frame_id = source
    moved, turned = message.transform.translation, message.transform.rotation
    moved.x, moved.y, moved.z = transform.translation
    turned.x, turned.y, turned.z, turned.w = transform.rotation
    return message
