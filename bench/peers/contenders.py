"""Who takes part, with which settings, and in which groups of workloads.

One line adds a contender: another way to run HPRM is a name and the options of `hprm run`. What the
processes of a contender do is in `worker/`, how they are started in `launch.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

GATHER, SAME, APART, FAN, PLACE, ENCODE = "gather", "same", "apart", "fan", "place", "encode"
GROUPS = {
    GATHER: "broadcast and gather, 4 nodes",
    SAME: "ping-pong, both processes on one core",
    APART: "ping-pong and rate, one core each",
    FAN: "rate, 1 to 4",
    PLACE: "placing an array in shared memory",
    ENCODE: "serialization",
}
"""What is run without another contender in between, and what it is called."""

_ALL = (GATHER, SAME, APART, FAN)


@dataclass(frozen=True)
class Contender:
    """One way to move messages."""

    name: str
    kind: str
    """How its processes are started: a method of `launch.Launcher`."""
    groups: tuple[str, ...]
    transport: str = ""
    """The module under `worker/transports`; the method, in the groups without a node."""
    environment: str | None = None
    """Whose Python it runs in, by the name in `environments.py`; the harness's if none."""
    options: dict[str, Any] = field(default_factory=dict)
    """For the transport."""
    variables: dict[str, str] = field(default_factory=dict)
    """For the environment of its processes."""
    arguments: tuple[str, ...] = ()
    """For `hprm run`."""
    without: tuple[str, ...] = ()
    """Workloads of its groups that it cannot do."""
    by_size: bool = False
    """Whether it takes part in W6, which has room for few: each is a line in one picture."""

    def does(self, workload: str) -> bool:
        """Whether it takes part in a workload of its groups."""
        return workload not in self.without and (self.by_size or workload != "W6")

    @property
    def ours(self) -> bool:
        """Whether it is a way to run HPRM's programs."""
        return self.kind == "hprm"


def _hprm(name: str, coordination: str, *arguments: str, groups: tuple[str, ...]) -> Contender:
    options = {"coordination": coordination}
    return Contender(name, "hprm", groups, options=options, arguments=arguments, by_size=True)


def _method(name: str, group: str, method: str, environment: str | None = None) -> Contender:
    kind = "plasma" if environment == "plasma" else "alone"
    return Contender(name, kind, (group,), method, environment)


_POOL = {"DORA_NODE_SHM_POOL_SIZE": "400000000"}
_POLL_GROUPS = (APART,)
"""Busy loops on one core make no sense, and five of them on two cores neither."""
_RTI_GROUPS = (SAME, APART, FAN)
"""Large arrays do not pass through it."""
_ROS = (GATHER, SAME, APART)
"""Its default queues of ten messages would lose most of W5."""

CONTENDERS = (
    _hprm("hprm centralized", "centralized", groups=_ALL),
    Contender(
        "hprm through the RTI",
        "hprm",
        _RTI_GROUPS,
        options={"coordination": "centralized"},
        variables={"HPRM_BOARDS": "off"},
    ),
    _hprm("hprm decentralized", "decentralized", groups=_ALL),
    _hprm("hprm spinning", "decentralized", "--spin=200us", groups=_POLL_GROUPS),
    _hprm("hprm spinning centralized", "centralized", "--spin=200us", groups=_POLL_GROUPS),
    Contender("limit", "processes", _ALL, "limit", by_size=True),
    Contender(
        "limit spinning",
        "processes",
        _POLL_GROUPS,
        "limit",
        options={"spin_s": 2e-4},
        by_size=True,
    ),
    Contender("iceoryx2", "processes", _ALL, "iceoryx2", "iceoryx2", by_size=True),
    Contender(
        "iceoryx2 polling",
        "processes",
        _POLL_GROUPS,
        "iceoryx2",
        "iceoryx2",
        options={"polls": True},
        by_size=True,
    ),
    Contender("zenoh tcp", "processes", _ALL, "zenoh", "zenoh"),
    Contender("zenoh shm", "processes", _ALL, "zenoh", "zenoh", {"shm": True}),
    Contender("dora", "dora", _ALL, "dora", "dora"),
    Contender("dora 400 MB pool", "dora", _ALL, "dora", "dora", variables=_POOL),
    Contender("cyclonedds", "processes", _ALL, "cyclonedds", "cyclonedds"),
    Contender("pyzmq ipc", "processes", _ALL, "pyzmq", "pyzmq"),
    Contender("shm + pickle", "processes", (GATHER, SAME, APART), "shm_pickle", without=("W5",)),
    Contender("unix + pickle", "processes", _ALL, "unix_pickle"),
    Contender("plasma", "plasma", _ALL, "plasma", "plasma"),
    Contender("plasma, never deleted", "plasma", (GATHER,), "plasma", "plasma", {"keeps": True}),
    Contender("ray", "ray", _ALL, "ray", "ray"),
    Contender("ros2", "processes", _ROS, "ros2", "ros2", without=("W5",)),
    Contender("ros2, array", "processes", _ROS, "ros2", "ros2", {"form": "array"}, without=("W5",)),
    Contender("ros2 + shm", "processes", _ROS, "ros2", "ros2", {"form": "shm"}, without=("W5",)),
    _method("memcpy, recycled", PLACE, "recycled"),
    _method("memcpy, fresh memory", PLACE, "fresh"),
    Contender("hprm copy", "hprm", (PLACE,)),
    Contender("hprm loan", "hprm", (PLACE,), options={"loan": True}),
    _method("shared_memory", PLACE, "shared_memory"),
    _method("shm + pickle", PLACE, "shm_pickle"),
    _method("iceoryx2 loan + copy", PLACE, "iceoryx2", "iceoryx2"),
    _method("zenoh shm", PLACE, "zenoh", "zenoh"),
    _method("plasma", PLACE, "plasma", "plasma"),
    _method("ray put", PLACE, "ray", "ray"),
    _method("hprm", ENCODE, "hprm"),
    _method("pickle 5 out of band", ENCODE, "pickle_out_of_band"),
    _method("pickle 5 in band", ENCODE, "pickle_in_band"),
    _method("cyclonedds CDR", ENCODE, "cyclonedds", "cyclonedds"),
    _method("protobuf", ENCODE, "protobuf", "protobuf"),
    _method("ros2 message", ENCODE, "ros_message", "rosbags"),
    _method("ros2 message, CDR", ENCODE, "ros_cdr", "rosbags"),
    _method("ros2 message, bytes checked", ENCODE, "ros_checked", "rosbags"),
    _method("ros2_numpy", ENCODE, "ros2_numpy", "ros2_numpy"),
)


def chosen(group: str, names: list[str] | None) -> list[Contender]:
    """The contenders of a group; those whose name has one of the words, if there are any."""
    return [
        contender
        for contender in CONTENDERS
        if group in contender.groups
        and (not names or any(name in contender.name for name in names))
    ]
