"""Filters for messages: subscriptions, caches and synchronizers, as in ``message_filters``.

A synchronizer counts, for each input, which messages it received, matched, and left unmatched
(``counts``); at the end of the process it says so, if there are unmatched ones. That is more than
the package of ROS 2 does.
"""

from hprm.ros._message_filters._cache import Cache as Cache
from hprm.ros._message_filters._simple import SimpleFilter as SimpleFilter
from hprm.ros._message_filters._simple import Subscriber as Subscriber
from hprm.ros._message_filters._synchronizers import (
    ApproximateTimeSynchronizer as ApproximateTimeSynchronizer,
)
from hprm.ros._message_filters._synchronizers import TimeSynchronizer as TimeSynchronizer

__all__ = [
    "ApproximateTimeSynchronizer",
    "Cache",
    "SimpleFilter",
    "Subscriber",
    "TimeSynchronizer",
]
