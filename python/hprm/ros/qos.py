"""Quality of service: policies, profiles, and which of them fit together, as in ``rclpy.qos``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from enum import Enum, IntEnum
from typing import Any, TypeVar

from hprm.ros.duration import Duration, Infinite

_UNSPECIFIED = Duration()

#: As short as the publishers allow.
DeadlineBestAvailable = Duration(nanoseconds=Infinite.nanoseconds - 1)
#: As short as the publishers allow; the name is that of rclpy.
LivelinessLeaseDurationeBestAvailable = Duration(nanoseconds=Infinite.nanoseconds - 1)


class QoSPolicyKind(IntEnum):
    """The policies of a profile, as events name them."""

    INVALID = 1 << 0
    DURABILITY = 1 << 1
    DEADLINE = 1 << 2
    LIVELINESS = 1 << 3
    RELIABILITY = 1 << 4
    HISTORY = 1 << 5
    LIFESPAN = 1 << 6
    DEPTH = 1 << 7
    LIVELINESS_LEASE_DURATION = 1 << 8
    AVOID_ROS_NAMESPACE_CONVENTIONS = 1 << 9


def qos_policy_name_from_kind(policy_kind: QoSPolicyKind | int) -> str:
    """Return the name of a policy."""
    return QoSPolicyKind(policy_kind).name


class InvalidQoSProfileException(Exception):
    """The arguments of a profile contradict one another."""

    def __init__(self, *args: object) -> None:
        """Keep what is wrong."""
        super().__init__("Invalid QoSProfile", *args)


class QoSPolicyEnum(IntEnum):
    """What the enumerations of policies share: short names for command lines and files."""

    @classmethod
    def short_keys(cls) -> list[str]:
        """Return the names of all values, in lower case."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> int:
        """Return the value with a name, in upper or lower case."""
        return cls[name.upper()].value

    @property
    def short_key(self) -> str:
        """The name in lower case."""
        return self.name.lower()


_Policy = TypeVar("_Policy", bound=QoSPolicyEnum)


class _LongName:
    """The name of a value in C, which older programs use: it works, with a warning."""

    def __init__(self, long: str, name: str) -> None:
        self.long = long
        self.name = name

    def __get__(self, instance: object, policy: type[_Policy]) -> _Policy:
        warnings.warn(
            f"{policy.__name__}.{self.long} is deprecated. "
            f"Use {policy.__name__}.{self.name} instead.",
            stacklevel=2,
        )
        return policy[self.name]


def _long_names(prefix: str, *names: str) -> Callable[[type[_Policy]], type[_Policy]]:
    def add(policy: type[_Policy]) -> type[_Policy]:
        for name in names:
            setattr(policy, f"{prefix}_{name}", _LongName(f"{prefix}_{name}", name))
        return policy

    return add


@_long_names("RMW_QOS_POLICY_HISTORY", "SYSTEM_DEFAULT", "KEEP_LAST", "KEEP_ALL", "UNKNOWN")
class HistoryPolicy(QoSPolicyEnum):
    """Which messages are kept for a reader that has not taken them yet."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


@_long_names("RMW_QOS_POLICY_RELIABILITY", "SYSTEM_DEFAULT", "RELIABLE", "BEST_EFFORT", "UNKNOWN")
class ReliabilityPolicy(QoSPolicyEnum):
    """Whether a message may get lost."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


@_long_names(
    "RMW_QOS_POLICY_DURABILITY", "SYSTEM_DEFAULT", "TRANSIENT_LOCAL", "VOLATILE", "UNKNOWN"
)
class DurabilityPolicy(QoSPolicyEnum):
    """Whether a subscription receives what was published before it was made."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


@_long_names(
    "RMW_QOS_POLICY_LIVELINESS", "SYSTEM_DEFAULT", "AUTOMATIC", "MANUAL_BY_TOPIC", "UNKNOWN"
)
class LivelinessPolicy(QoSPolicyEnum):
    """How a publisher shows that it is alive."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


QoSHistoryPolicy = HistoryPolicy
QoSReliabilityPolicy = ReliabilityPolicy
QoSDurabilityPolicy = DurabilityPolicy
QoSLivelinessPolicy = LivelinessPolicy


class _PolicyField:
    """One policy of a profile: assigned values are checked, numbers become their enumeration."""

    def __init__(self, *types: type, convert: Callable[[Any], Any] | None = None) -> None:
        self._types = types
        self._convert = convert

    def __set_name__(self, owner: type, name: str) -> None:
        self._slot = f"_{name}"

    def __get__(self, profile: Any, owner: type) -> Any:
        return self if profile is None else getattr(profile, self._slot)

    def __set__(self, profile: Any, value: Any) -> None:
        assert isinstance(value, self._types), (
            f"QoSProfile.{self._slot[1:]} must be of type "
            f"{' or '.join(kind.__name__ for kind in self._types)}, "
            f"not {type(value).__name__}"
        )
        setattr(profile, self._slot, self._convert(value) if self._convert else value)


class _Depth(_PolicyField):
    def __set__(self, profile: Any, value: Any) -> None:
        super().__set__(profile, value)
        if profile.history == HistoryPolicy.KEEP_LAST and value == 0:
            warnings.warn(
                "A zero depth with KEEP_LAST doesn't make sense; no data could be stored. "
                "This will be interpreted as SYSTEM_DEFAULT",
                stacklevel=3,
            )


class QoSProfile:
    """The quality of service of a publisher, subscription, service or client.

    ``history`` or ``depth`` has to be given, and a ``depth`` with ``KEEP_LAST``; the rest is that
    of the default profile: reliable, volatile, without deadline and lifespan.

    Raises
    ------
    InvalidQoSProfileException
        If neither ``history`` nor ``depth`` is given, or ``KEEP_LAST`` without ``depth``.
    AssertionError
        If a policy has a value of a wrong type.

    """

    __slots__ = (
        "_history",
        "_depth",
        "_reliability",
        "_durability",
        "_lifespan",
        "_deadline",
        "_liveliness",
        "_liveliness_lease_duration",
        "_avoid_ros_namespace_conventions",
    )

    history = _PolicyField(HistoryPolicy, int, convert=HistoryPolicy)
    depth = _Depth(int)
    reliability = _PolicyField(ReliabilityPolicy, int, convert=ReliabilityPolicy)
    durability = _PolicyField(DurabilityPolicy, int, convert=DurabilityPolicy)
    lifespan = _PolicyField(Duration)
    deadline = _PolicyField(Duration)
    liveliness = _PolicyField(LivelinessPolicy, int, convert=LivelinessPolicy)
    liveliness_lease_duration = _PolicyField(Duration)
    avoid_ros_namespace_conventions = _PolicyField(bool)

    def __init__(
        self,
        *,
        history: HistoryPolicy | int | None = None,
        depth: int | None = None,
        reliability: ReliabilityPolicy | int = ReliabilityPolicy.RELIABLE,
        durability: DurabilityPolicy | int = DurabilityPolicy.VOLATILE,
        lifespan: Duration = _UNSPECIFIED,
        deadline: Duration = _UNSPECIFIED,
        liveliness: LivelinessPolicy | int = LivelinessPolicy.SYSTEM_DEFAULT,
        liveliness_lease_duration: Duration = _UNSPECIFIED,
        avoid_ros_namespace_conventions: bool = False,
    ) -> None:
        """Set the policies; those that are not named are the default ones."""
        if history is None:
            if depth is None:
                raise InvalidQoSProfileException("History and/or depth settings are required.")
            history = HistoryPolicy.KEEP_LAST
        self.history = history
        if self.history == HistoryPolicy.KEEP_LAST and depth is None:
            raise InvalidQoSProfileException("History set to KEEP_LAST without a depth setting.")
        self.depth = 10 if depth is None else depth
        self.reliability = reliability
        self.durability = durability
        self.lifespan = lifespan
        self.deadline = deadline
        self.liveliness = liveliness
        self.liveliness_lease_duration = liveliness_lease_duration
        self.avoid_ros_namespace_conventions = avoid_ros_namespace_conventions

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, QoSProfile):
            return False
        return all(getattr(self, slot) == getattr(other, slot) for slot in self.__slots__)

    # A profile can be changed.
    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        fields = ", ".join(f"{slot[1:]}={getattr(self, slot)!s}" for slot in self.__slots__)
        return f"{type(self).__name__}({fields})"


def _keep_last(depth: int, **policies: Any) -> QoSProfile:
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, **policies)


def _of_history(history: HistoryPolicy, **policies: Any) -> QoSProfile:
    return QoSProfile(history=history, depth=0, **policies)


qos_profile_unknown = _of_history(
    HistoryPolicy.UNKNOWN,
    reliability=ReliabilityPolicy.UNKNOWN,
    durability=DurabilityPolicy.UNKNOWN,
    liveliness=LivelinessPolicy.UNKNOWN,
)
qos_profile_default = _keep_last(10)
qos_profile_system_default = _of_history(
    HistoryPolicy.SYSTEM_DEFAULT,
    reliability=ReliabilityPolicy.SYSTEM_DEFAULT,
    durability=DurabilityPolicy.SYSTEM_DEFAULT,
)
qos_profile_sensor_data = _keep_last(5, reliability=ReliabilityPolicy.BEST_EFFORT)
qos_profile_services_default = _keep_last(10)
qos_profile_parameters = _keep_last(1000)
qos_profile_parameter_events = _keep_last(1000)
qos_profile_best_available = _keep_last(
    10,
    reliability=ReliabilityPolicy.BEST_AVAILABLE,
    durability=DurabilityPolicy.BEST_AVAILABLE,
    deadline=DeadlineBestAvailable,
    liveliness=LivelinessPolicy.BEST_AVAILABLE,
    liveliness_lease_duration=LivelinessLeaseDurationeBestAvailable,
)
qos_profile_action_status_default = _keep_last(1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class QoSPresetProfiles(Enum):
    """The profiles that have names."""

    UNKNOWN = qos_profile_unknown
    DEFAULT = qos_profile_default
    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default
    BEST_AVAILABLE = qos_profile_best_available

    @classmethod
    def short_keys(cls) -> list[str]:
        """Return the names of all profiles, in lower case."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> QoSProfile:
        """Return the profile with a name, in upper or lower case."""
        return cls[name.upper()].value


class QoSCompatibility(IntEnum):
    """Whether a publisher and a subscription exchange messages."""

    OK = 0
    WARNING = 1
    ERROR = 2


def qos_check_compatible(
    publisher_qos: QoSProfile, subscription_qos: QoSProfile
) -> tuple[QoSCompatibility, str]:
    """Check whether a publisher and a subscription with these profiles exchange messages.

    Returns
    -------
    tuple[QoSCompatibility, str]
        ``ERROR`` if they do not, ``WARNING`` if that depends on what "system default" or "unknown"
        stands for, ``OK`` otherwise; and the reasons, each with a semicolon behind it.

    """
    errors = "".join(f"ERROR: {reason};" for reason in _errors(publisher_qos, subscription_qos))
    if errors:
        return QoSCompatibility.ERROR, errors
    doubts = "".join(f"WARNING: {reason};" for reason in _doubts(publisher_qos, subscription_qos))
    return (QoSCompatibility.WARNING if doubts else QoSCompatibility.OK), doubts


def _errors(pub: QoSProfile, sub: QoSProfile) -> Iterator[str]:
    if (pub.reliability, sub.reliability) == (
        ReliabilityPolicy.BEST_EFFORT,
        ReliabilityPolicy.RELIABLE,
    ):
        yield "Best effort publisher and reliable subscription"
    if (pub.durability, sub.durability) == (
        DurabilityPolicy.VOLATILE,
        DurabilityPolicy.TRANSIENT_LOCAL,
    ):
        yield "Volatile publisher and transient local subscription"
    if sub.deadline != _UNSPECIFIED:
        if pub.deadline == _UNSPECIFIED:
            yield "Subscription has a deadline, but publisher does not"
        elif sub.deadline < pub.deadline:
            yield "Subscription deadline is less than publisher deadline"
    if (pub.liveliness, sub.liveliness) == (
        LivelinessPolicy.AUTOMATIC,
        LivelinessPolicy.MANUAL_BY_TOPIC,
    ):
        yield "Publisher's liveliness is automatic and subscription's is manual by topic"
    if sub.liveliness_lease_duration != _UNSPECIFIED:
        if pub.liveliness_lease_duration == _UNSPECIFIED:
            yield "Subscription has a liveliness lease duration, but publisher does not"
        elif sub.liveliness_lease_duration < pub.liveliness_lease_duration:
            yield "Subscription liveliness lease duration is less than publisher"


# For each policy: its name, what the strict subscription asks for, what the weak publisher offers,
# and how the two are described.
_STRICT = (
    (
        "reliability",
        ReliabilityPolicy.RELIABLE,
        ReliabilityPolicy.BEST_EFFORT,
        "Reliable subscription, but publisher is",
        "Best effort publisher, but subscription is",
    ),
    (
        "durability",
        DurabilityPolicy.TRANSIENT_LOCAL,
        DurabilityPolicy.VOLATILE,
        "Transient local subscription, but publisher is",
        "Volatile publisher, but subscription is",
    ),
    (
        "liveliness",
        LivelinessPolicy.MANUAL_BY_TOPIC,
        LivelinessPolicy.AUTOMATIC,
        "Subscription's liveliness is manual by topic, but publisher's is",
        "Publisher's liveliness is automatic, but subscription's is",
    ),
)


def _doubts(pub: QoSProfile, sub: QoSProfile) -> Iterator[str]:
    for policy, strict, weak, strict_subscription, weak_publisher in _STRICT:
        offered, requested = getattr(pub, policy), getattr(sub, policy)
        unknown = (type(strict)["SYSTEM_DEFAULT"], type(strict)["UNKNOWN"])
        if offered in unknown and requested in unknown:
            yield (
                f"Publisher {policy} is {offered.short_key} "
                f"and subscription {policy} is {requested.short_key}"
            )
        elif offered in unknown and requested == strict:
            yield f"{strict_subscription} {offered.short_key}"
        elif offered == weak and requested in unknown:
            yield f"{weak_publisher} {requested.short_key}"
