"""Quality of service from parameters, as in ``rclpy.qos_overriding_options``.

A publisher or a subscription with these options declares read-only parameters such as
``qos_overrides./chatter.publisher.depth``, and their values override its profile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from hprm.ros._interfaces import interface
from hprm.ros.duration import Duration
from hprm.ros.exceptions import ParameterAlreadyDeclaredException
from hprm.ros.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPolicyEnum,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)

_ENUMERATIONS: dict[QoSPolicyKind, type[QoSPolicyEnum]] = {
    QoSPolicyKind.DURABILITY: DurabilityPolicy,
    QoSPolicyKind.HISTORY: HistoryPolicy,
    QoSPolicyKind.LIVELINESS: LivelinessPolicy,
    QoSPolicyKind.RELIABILITY: ReliabilityPolicy,
}


class InvalidQosOverridesError(Exception):
    """A callback refuses the profile that the parameters make."""


def __getattr__(name: str) -> Any:
    """Return the class of what callbacks return, which is a message."""
    if name == "QosCallbackResult":
        return interface("rcl_interfaces.msg", "SetParametersResult")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


#: A callback gets the profile, and returns a ``QosCallbackResult``.
QosCallbackType: TypeAlias = Callable[[QoSProfile], Any]


class QoSOverridingOptions:
    """Which policies have parameters.

    Parameters
    ----------
    policy_kinds
        The policies.
    callback
        What checks the profile when the parameters have their values.
    entity_id
        A name in those of the parameters, where one topic has several publishers in a node.

    """

    def __init__(
        self,
        policy_kinds: Iterable[QoSPolicyKind],
        *,
        callback: QosCallbackType | None = None,
        entity_id: str | None = None,
    ) -> None:
        """Take the policies."""
        self._policy_kinds = tuple(policy_kinds)
        self._callback = callback
        self._entity_id = entity_id

    @property
    def policy_kinds(self) -> tuple[QoSPolicyKind, ...]:
        """The policies that have parameters."""
        return self._policy_kinds

    @property
    def callback(self) -> QosCallbackType | None:
        """What checks the profile."""
        return self._callback

    @property
    def entity_id(self) -> str | None:
        """The name in those of the parameters."""
        return self._entity_id

    @classmethod
    def with_default_policies(
        cls, *, callback: QosCallbackType | None = None, entity_id: str | None = None
    ) -> QoSOverridingOptions:
        """Return options with history, depth and reliability."""
        kinds = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
        return cls(kinds, callback=callback, entity_id=entity_id)


def _declare_qos_parameters(
    entity_type: type, node: Any, topic_name: str, qos: QoSProfile, options: QoSOverridingOptions
) -> None:
    """Declare the parameters of a publisher or subscription, and change its profile by them.

    Raises ``InvalidQosOverridesError`` if the callback refuses the profile.
    """
    kind = _entity(entity_type)
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    what = f"for {kind} `{topic_name}` with id `{options.entity_id}`"
    for policy in options.policy_kinds:
        # What a subscription has received does not expire.
        if kind == "subscription" and policy == QoSPolicyKind.LIFESPAN:
            continue
        policy_name = policy.name.lower()
        name = f"qos_overrides.{topic_name}.{kind}{suffix}.{policy_name}"
        descriptor = interface("rcl_interfaces.msg", "ParameterDescriptor")(
            description=f"{policy_name} {what}", read_only=True
        )
        try:
            parameter = node.declare_parameter(
                name, _get_qos_policy_parameter(qos, policy), descriptor
            )
        except ParameterAlreadyDeclaredException:
            parameter = node.get_parameter(name)
        _override_qos_policy_with_param(qos, policy, parameter)
    if options.callback is not None:
        result = options.callback(qos)
        if not result.successful:
            raise InvalidQosOverridesError(
                f"Provided QoS overrides {what}, are not valid: {result.reason}"
            )


def _entity(entity_type: type) -> str:
    names = {base.__name__ for base in entity_type.__mro__}
    for name in ("Publisher", "Subscription"):
        if name in names:
            return name.lower()
    raise TypeError("Argument `entity_type` should be a subclass of Publisher or Subscription")


def _get_qos_policy_parameter(qos: QoSProfile, policy: QoSPolicyKind) -> str | int | bool:
    """Return the value of a policy as that of a parameter."""
    value = getattr(qos, policy.name.lower())
    if isinstance(value, QoSPolicyEnum):
        if value.short_key == "unknown":
            raise ValueError("User provided QoS profile is invalid")
        return value.short_key
    if isinstance(value, Duration):
        return value.nanoseconds
    plain: int | bool = value
    return plain


def _override_qos_policy_with_param(qos: QoSProfile, policy: QoSPolicyKind, param: Any) -> None:
    """Set a policy to the value of a parameter."""
    name, value = policy.name.lower(), param.value
    if policy in _ENUMERATIONS:
        try:
            value = _ENUMERATIONS[policy][value.upper()]
        except KeyError:
            raise RuntimeError(f"Unexpected QoS override for policy `{name}`: `{value}`") from None
    elif isinstance(getattr(qos, name), Duration):
        value = Duration(nanoseconds=value)
    setattr(qos, name, value)
