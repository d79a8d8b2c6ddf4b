"""Profiles of quality of service: defaults, checks, names and compatibility as in rclpy."""

from __future__ import annotations

import warnings
from typing import Any

import pytest

from hprm.ros import _messages, _offers, qos, qos_overriding_options
from hprm.ros._graph import Endpoint
from hprm.ros.duration import Duration, Infinite
from hprm.ros.exceptions import ParameterAlreadyDeclaredException
from hprm.ros.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    InvalidQoSProfileException,
    LivelinessPolicy,
    QoSCompatibility,
    QoSPolicyKind,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_profile_best_available,
)
from hprm.ros.qos_overriding_options import (
    InvalidQosOverridesError,
    QoSOverridingOptions,
    _declare_qos_parameters,
    _get_qos_policy_parameter,
)

_messages.install()


def test_a_profile_of_a_depth_is_the_default_one() -> None:
    profile = QoSProfile(depth=10)
    assert profile == qos.qos_profile_default
    assert profile.history is HistoryPolicy.KEEP_LAST
    assert profile.reliability is ReliabilityPolicy.RELIABLE
    assert profile.durability is DurabilityPolicy.VOLATILE
    assert profile.liveliness is LivelinessPolicy.SYSTEM_DEFAULT
    assert profile.lifespan == profile.deadline == profile.liveliness_lease_duration == Duration()
    assert profile.avoid_ros_namespace_conventions is False
    assert profile != QoSProfile(depth=11)
    assert profile != "default"
    with pytest.raises(TypeError, match="unhashable"):
        hash(profile)


def test_a_profile_without_history_and_depth_is_refused() -> None:
    with pytest.raises(InvalidQoSProfileException) as raised:
        QoSProfile()
    assert raised.value.args == (
        "Invalid QoSProfile",
        "History and/or depth settings are required.",
    )
    with pytest.raises(InvalidQoSProfileException, match="KEEP_LAST without a depth setting"):
        QoSProfile(history=HistoryPolicy.KEEP_LAST)
    assert QoSProfile(history=HistoryPolicy.KEEP_ALL).depth == 10


def test_policies_are_checked_and_numbers_become_policies() -> None:
    profile = QoSProfile(depth=1, reliability=2)
    assert profile.reliability is ReliabilityPolicy.BEST_EFFORT
    profile.durability = 1
    assert profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    wrong: list[tuple[str, Any]] = [
        ("depth", "1"),
        ("history", "keep_last"),
        ("deadline", 1.0),
        ("avoid_ros_namespace_conventions", 0),
    ]
    for name, value in wrong:
        with pytest.raises(AssertionError, match=f"QoSProfile.{name} must be of type"):
            setattr(profile, name, value)
    with pytest.raises(ValueError):
        profile.history = 17
    with pytest.raises(TypeError):
        QoSProfile(depth=1, colour="red")  # type: ignore[call-arg]


def test_a_depth_of_zero_warns() -> None:
    with pytest.warns(UserWarning, match="A zero depth with KEEP_LAST"):
        QoSProfile(depth=0)


def test_a_profile_prints_its_policies() -> None:
    text = str(QoSProfile(depth=3))
    assert text.startswith("QoSProfile(history=")
    assert "depth=3, " in text
    assert text.endswith(
        "liveliness_lease_duration=0 nanoseconds, avoid_ros_namespace_conventions=False)"
    )


def test_policies_have_short_names_and_long_ones() -> None:
    assert qos.QoSReliabilityPolicy is ReliabilityPolicy
    assert qos.QoSHistoryPolicy is HistoryPolicy
    assert qos.QoSDurabilityPolicy is DurabilityPolicy
    assert qos.QoSLivelinessPolicy is LivelinessPolicy
    assert HistoryPolicy.short_keys() == ["system_default", "keep_last", "keep_all", "unknown"]
    assert ReliabilityPolicy.get_from_short_key("Best_Effort") == 2
    assert DurabilityPolicy.VOLATILE.short_key == "volatile"
    with pytest.warns(UserWarning, match="Use ReliabilityPolicy.RELIABLE instead"):
        assert (
            ReliabilityPolicy.RMW_QOS_POLICY_RELIABILITY_RELIABLE  # type: ignore[attr-defined]
            is ReliabilityPolicy.RELIABLE
        )
    assert qos.qos_policy_name_from_kind(16) == "RELIABILITY"


def test_presets_have_the_numbers_of_ros() -> None:
    depths = {name: profile.value.depth for name, profile in QoSPresetProfiles.__members__.items()}
    assert depths == {
        "UNKNOWN": 0,
        "DEFAULT": 10,
        "SYSTEM_DEFAULT": 0,
        "SENSOR_DATA": 5,
        "SERVICES_DEFAULT": 10,
        "PARAMETERS": 1000,
        "PARAMETER_EVENTS": 1000,
        "ACTION_STATUS_DEFAULT": 1,
        "BEST_AVAILABLE": 10,
    }
    sensor = QoSPresetProfiles.get_from_short_key("sensor_data")
    assert sensor is qos.qos_profile_sensor_data
    assert sensor.reliability is ReliabilityPolicy.BEST_EFFORT
    assert qos.qos_profile_action_status_default.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert "sensor_data" in QoSPresetProfiles.short_keys()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        QoSProfile(history=HistoryPolicy.SYSTEM_DEFAULT, depth=0)


def compatible(publisher: dict[str, Any], subscription: dict[str, Any]) -> tuple[int, str]:
    """Check profiles that differ from the default one in these policies."""
    definite: dict[str, Any] = {"depth": 1, "liveliness": LivelinessPolicy.AUTOMATIC}
    return qos_check_compatible(
        QoSProfile(**{**definite, **publisher}), QoSProfile(**{**definite, **subscription})
    )


def test_equal_profiles_are_compatible() -> None:
    assert compatible({}, {}) == (QoSCompatibility.OK, "")


@pytest.mark.parametrize(
    ("publisher", "subscription", "reason"),
    [
        (
            {"reliability": ReliabilityPolicy.BEST_EFFORT},
            {},
            "Best effort publisher and reliable subscription",
        ),
        (
            {},
            {"durability": DurabilityPolicy.TRANSIENT_LOCAL},
            "Volatile publisher and transient local subscription",
        ),
        (
            {},
            {"deadline": Duration(seconds=1)},
            "Subscription has a deadline, but publisher does not",
        ),
        (
            {"deadline": Duration(seconds=2)},
            {"deadline": Duration(seconds=1)},
            "Subscription deadline is less than publisher deadline",
        ),
        (
            {},
            {"liveliness": LivelinessPolicy.MANUAL_BY_TOPIC},
            "Publisher's liveliness is automatic and subscription's is manual by topic",
        ),
        (
            {},
            {"liveliness_lease_duration": Duration(seconds=1)},
            "Subscription has a liveliness lease duration, but publisher does not",
        ),
        (
            {"liveliness_lease_duration": Duration(seconds=2)},
            {"liveliness_lease_duration": Duration(seconds=1)},
            "Subscription liveliness lease duration is less than publisher",
        ),
    ],
)
def test_a_subscription_that_asks_for_more_is_incompatible(
    publisher: dict[str, Any], subscription: dict[str, Any], reason: str
) -> None:
    assert compatible(publisher, subscription) == (QoSCompatibility.ERROR, f"ERROR: {reason};")
    # The same policies the other way round: the publisher offers more.
    assert compatible(subscription, publisher)[0] == QoSCompatibility.OK


@pytest.mark.parametrize(
    ("publisher", "subscription", "reason"),
    [
        (
            {"reliability": ReliabilityPolicy.SYSTEM_DEFAULT},
            {},
            "Reliable subscription, but publisher is system_default",
        ),
        (
            {"reliability": ReliabilityPolicy.BEST_EFFORT},
            {"reliability": ReliabilityPolicy.UNKNOWN},
            "Best effort publisher, but subscription is unknown",
        ),
        (
            {"durability": DurabilityPolicy.UNKNOWN},
            {"durability": DurabilityPolicy.SYSTEM_DEFAULT},
            "Publisher durability is unknown and subscription durability is system_default",
        ),
        (
            {},
            {"durability": DurabilityPolicy.SYSTEM_DEFAULT},
            "Volatile publisher, but subscription is system_default",
        ),
        (
            {"liveliness": LivelinessPolicy.UNKNOWN},
            {"liveliness": LivelinessPolicy.MANUAL_BY_TOPIC},
            "Subscription's liveliness is manual by topic, but publisher's is unknown",
        ),
    ],
)
def test_what_depends_on_a_default_is_doubtful(
    publisher: dict[str, Any], subscription: dict[str, Any], reason: str
) -> None:
    assert compatible(publisher, subscription) == (
        QoSCompatibility.WARNING,
        f"WARNING: {reason};",
    )


class Publisher:
    """A class of this name stands for publishers."""


class Subscription:
    """A class of this name stands for subscriptions."""


class Value:
    def __init__(self, value: Any) -> None:
        self.value = value


class Node:
    """A node whose parameters may be given from outside."""

    def __init__(self, **overrides: Any) -> None:
        self.overrides = {name.replace("__", "."): value for name, value in overrides.items()}
        self.parameters: dict[str, Any] = {}
        self.descriptors: list[Any] = []

    def declare_parameter(self, name: str, value: Any, descriptor: Any) -> Value:
        if name in self.parameters:
            raise ParameterAlreadyDeclaredException(name)
        self.descriptors.append(descriptor)
        self.parameters[name] = self.overrides.get(name.rpartition("/t.")[2], value)
        return Value(self.parameters[name])

    def get_parameter(self, name: str) -> Value:
        return Value(self.parameters[name])


def endpoint(kind: Any, profile: QoSProfile) -> Endpoint:
    """Describe an endpoint of the one topic that there is."""
    return Endpoint(kind, "/node", "/topic", "a/msg/B", _offers.described(kind, profile, 1))


ANYTHING = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    liveliness=LivelinessPolicy.AUTOMATIC,
)
ALL = QoSProfile(
    depth=1,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    deadline=Duration(nanoseconds=1),
    liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
    liveliness_lease_duration=Duration(nanoseconds=1),
)
NEVER = QoSProfile(depth=1, deadline=Infinite, liveliness_lease_duration=Infinite)


@pytest.mark.parametrize(
    ("publisher", "subscription", "policy"),
    [
        (ANYTHING, ANYTHING, None),
        (ALL, ALL, None),
        (ALL, ANYTHING, None),
        # The first one that does not fit is told.
        (ANYTHING, ALL, QoSPolicyKind.RELIABILITY),
        (QoSProfile(depth=1), ALL, QoSPolicyKind.DURABILITY),
        (QoSProfile(depth=1), NEVER, None),
        (NEVER, QoSProfile(depth=1), None),
        (qos_profile_best_available, ALL, None),
        (ANYTHING, qos_profile_best_available, None),
        (QoSPresetProfiles.SYSTEM_DEFAULT.value, QoSProfile(depth=1), None),
        (ANYTHING, QoSPresetProfiles.SYSTEM_DEFAULT.value, None),
    ],
)
def test_endpoints_exchange_messages_if_a_publisher_offers_enough(
    publisher: QoSProfile, subscription: QoSProfile, policy: QoSPolicyKind | None
) -> None:
    one, other = endpoint("publisher", publisher), endpoint("subscription", subscription)
    assert _offers.mismatch(one, other) is _offers.mismatch(other, one) is policy
    request = _offers.Request(other, str)
    sent = _offers.Offer(one).beside("news")
    assert request.message_of(sent) == ("news" if policy is None else None)
    assert request.message_of(_offers.Offer(one).beside(3)) is None
    assert _offers.message_of(sent) == "news"


def test_endpoints_elsewhere_exchange_messages_in_any_case() -> None:
    strict = endpoint("subscription", ALL)
    there = Endpoint(
        "publisher",
        "/there",
        "/topic",
        "a/msg/B",
        _offers.elsewhere({"reliability": "BEST_EFFORT", "durability": "VOLATILE", "depth": 1}),
    )
    assert _offers.mismatch(there, strict) is None
    sent = _offers.from_elsewhere("news")
    assert _offers.Request(strict, str).message_of(sent) == _offers.message_of(sent) == "news"
    assert not _offers.is_kept(sent)


def test_parameters_override_a_profile() -> None:
    node = Node(publisher__depth=100, publisher__reliability="best_effort")
    # The second time, the parameters are there already.
    for _ in range(2):
        profile = QoSProfile(depth=10)
        _declare_qos_parameters(
            Publisher, node, "/t", profile, QoSOverridingOptions.with_default_policies()
        )
        expected = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        assert profile == expected
    assert node.parameters == {
        "qos_overrides./t.publisher.history": "keep_last",
        "qos_overrides./t.publisher.depth": 100,
        "qos_overrides./t.publisher.reliability": "best_effort",
    }
    assert all(descriptor.read_only for descriptor in node.descriptors)
    assert node.descriptors[1].description == "depth for publisher `/t` with id `None`"


def test_a_subscription_has_no_lifespan_and_may_have_an_id() -> None:
    node = Node(subscription_one__deadline=5)
    profile = QoSProfile(depth=10)
    kinds = [QoSPolicyKind.LIFESPAN, QoSPolicyKind.DEADLINE]
    options = QoSOverridingOptions(kinds, entity_id="one")
    _declare_qos_parameters(type("Mine", (Subscription,), {}), node, "/t", profile, options)
    assert node.parameters == {"qos_overrides./t.subscription_one.deadline": 5}
    assert profile.deadline == Duration(nanoseconds=5)
    with pytest.raises(TypeError, match="should be a subclass of Publisher or Subscription"):
        _declare_qos_parameters(int, node, "/t", profile, options)


def test_a_callback_may_refuse_a_profile() -> None:
    result = qos_overriding_options.QosCallbackResult(successful=False, reason="too deep")
    seen: list[QoSProfile] = []

    def check(profile: QoSProfile) -> Any:
        seen.append(profile)
        return result

    profile = QoSProfile(depth=10)
    options = QoSOverridingOptions.with_default_policies(callback=check)
    with pytest.raises(InvalidQosOverridesError, match="are not valid: too deep"):
        _declare_qos_parameters(Publisher, Node(), "/t", profile, options)
    assert seen == [profile]
    result.successful = True
    _declare_qos_parameters(Publisher, Node(), "/t", profile, options)


def test_overrides_that_cannot_be_are_refused() -> None:
    options = QoSOverridingOptions.with_default_policies()
    with pytest.raises(RuntimeError, match="QoS override for policy `history`: `none`"):
        node = Node(publisher__history="none")
        _declare_qos_parameters(Publisher, node, "/t", QoSProfile(depth=1), options)
    with pytest.raises(ValueError, match="User provided QoS profile is invalid"):
        _get_qos_policy_parameter(qos.qos_profile_unknown, QoSPolicyKind.HISTORY)
