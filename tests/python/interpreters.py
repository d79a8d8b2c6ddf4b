"""What tests leave out on some interpreters, for reasons that are not ours."""

from __future__ import annotations

import sys
import sysconfig
from functools import cache
from importlib.util import find_spec

import pytest

FREE_THREADED = bool(sysconfig.get_config_var("Py_GIL_DISABLED"))
"""Whether threads run without a global lock (PEP 703)."""

# By package of which there is no build (`requirements-not-free-threaded.txt`), what needs it.
_NEEDED = {
    "cv2": [
        "test_driving.py",
        "test_driving_simulators.py",
        "test_driving_training.py",
        "test_evaluation.py",
        "test_town.py",
        "test_gallery.py::test_a_command_prints_what_the_readme_says[driving",
    ],
    "foxglove": ["test_foxglove.py", "[howto/viewers.md]"],
    "grpc_tools": ["test_protobuf.py"],
    "zenoh": [
        "test_mirror.py",
        "test_ros_zenoh.py",
        "test_ros_zenoh_starting.py",
        "[howto/mirror.md]",
        "[howto/rclpy.md]",
    ],
}
# By reason, without a global lock.
_DIFFERENT = {
    "the interpreter reserves address space in advance": [
        "test_a_receiver_without_memory_for_the_value_says_so"
    ],
    "a fork in C while other threads run leaves them running for the interpreter": [
        "test_a_forked_process_may_do_with_arrays_what_it_likes[C on a thread]"
    ],
    "pyarrow waits for ever where threads use it at once for the first time": [
        "test_a_value_of_every_kind_is_the_same_in_every_deployment",
    ],
    "`apsw` turns the lock on, and the interpreter warns": [
        "test_ros_bags.py",
        "test_ros_bag_nodes.py",
        "test_ros_bag_programs.py",
    ],
    "an array of a thread is copied": [
        "test_an_array_that_only_a_message_has_is_not_copied[False]",
    ],
}


def left_out() -> list[str]:
    """Return the files that cannot be imported."""
    return [it for it, _ in _reasons() if it.endswith(".py")]


def skip(item: pytest.Item) -> None:
    """Have a test skipped that cannot pass."""
    for part, reason in _reasons():
        if part in item.nodeid:
            item.add_marker(pytest.mark.skip(reason=reason))


@cache
def _reasons() -> list[tuple[str, str]]:
    newer = [("[howto/debugging.md]", "`breakpoint()` stops elsewhere since Python 3.13")]
    by_version = newer if sys.version_info >= (3, 13) else []
    return by_version + (_reasons_without_lock() if FREE_THREADED else [])


def _reasons_without_lock() -> list[tuple[str, str]]:
    missing = {
        f"there is no build of {package}": parts
        for package, parts in _NEEDED.items()
        if find_spec(package) is None
    }
    return [(part, why) for why, parts in (missing | _DIFFERENT).items() for part in parts]
