"""Tests of the watchdog in virtual time: no test waits."""

from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st
from watchdog import Watchdog

import hprm.testing

MS = 1_000_000


def test_an_alarm_follows_the_last_heartbeat() -> None:
    beats = [("0 ms", 1), ("60 ms", 2), ("120 ms", 3)]
    result = hprm.testing.run(Watchdog(), inputs={"heartbeat": beats})
    assert result.outputs["alarm"] == [(220 * MS, "silent since beat 3")]


def test_an_hour_passes_in_no_time(run_reactor: Callable[..., hprm.testing.Result]) -> None:
    beats = [(f"{second} s", second) for second in range(3600)]
    result = run_reactor(Watchdog(), inputs={"heartbeat": beats}, timeout="1 h")
    # One after each heartbeat, because the next one comes after a second.
    assert len(result.outputs["alarm"]) == 3600


# A machine that is busy may take long for an example: that is no fault of the watchdog.
@settings(deadline=None)
@given(st.lists(st.integers(1, 300), max_size=20))
def test_each_long_gap_raises_one_alarm(gaps: list[int]) -> None:
    times = [sum(gaps[:count]) for count in range(len(gaps) + 1)]
    beats = [(f"{time} ms", 0) for time in times]
    result = hprm.testing.run(Watchdog(), inputs={"heartbeat": beats})
    late = [time for time, gap in zip(times, [*gaps, 1000], strict=True) if gap > 100]
    assert [time for time, _ in result.outputs["alarm"]] == [(time + 100) * MS for time in late]
