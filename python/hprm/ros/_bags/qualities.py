"""The quality of service of topics in bags: what publishers have offered, and what a player offers.

A player offers the most that one of them has offered, so subscriptions that got messages from the
publishers get those of the player, too.
"""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from hprm.ros.duration import Infinite
from hprm.ros.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

#: Of topics of this name, each subscription wants what was published before.
_STATIC = "/tf_static"


def recorded(profile: QoSProfile) -> Qos:
    """Return what a bag has of a publisher's quality of service."""
    keeps_all = profile.history is HistoryPolicy.KEEP_ALL
    is_manual = profile.liveliness is LivelinessPolicy.MANUAL_BY_TOPIC
    return Qos(
        QosHistory.KEEP_ALL if keeps_all else QosHistory.KEEP_LAST,
        profile.depth,
        QosReliability[profile.reliability.name],
        QosDurability[profile.durability.name],
        _time(profile.deadline),
        _time(profile.lifespan),
        QosLiveliness.MANUAL_BY_TOPIC if is_manual else QosLiveliness.AUTOMATIC,
        _time(profile.liveliness_lease_duration),
        False,
    )


def _time(duration: Any) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds or Infinite.nanoseconds, 1_000_000_000))


def played(topic: str, offers: list[Qos], depth: int) -> QoSProfile:
    """Return with which quality of service a topic is played, at least with that depth."""
    quality = QoSProfile(depth=max([depth, *(it.depth for it in offers)]))
    is_static = not offers and topic.endswith(_STATIC)
    if is_static or any(it.durability is QosDurability.TRANSIENT_LOCAL for it in offers):
        quality.durability = DurabilityPolicy.TRANSIENT_LOCAL
    if offers and all(it.reliability is QosReliability.BEST_EFFORT for it in offers):
        quality.reliability = ReliabilityPolicy.BEST_EFFORT
    return quality
