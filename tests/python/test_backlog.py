"""Threads that schedule faster than reactions follow: a warning, and a limit that users may set."""

from __future__ import annotations

import pytest
from conftest import Run

PROGRAM = """\
target Python
preamble {=
import queue, threading
import numpy as np

def film(frame, values):
    "Schedule values until that is refused, and return how many there were, and the reason."
    for count, value in enumerate(values):
        try:
            frame.schedule(0, value)
        except queue.Full as full:
            return count, str(full)
    return len(values), ""
=}
main reactor {
  physical action frame
  state waiting = 0
  state rounds = 0
  reaction(startup, frame) -> frame {=
    if self.waiting > 0:
        self.waiting -= 1
    if self.waiting == 0 and self.rounds == 2:
        request_stop()
    elif self.waiting == 0:
        # This reaction does not come back before the thread has scheduled what it may.
        values, result = VALUES, []
        thread = threading.Thread(target=lambda: result.append(film(frame, values)))
        thread.start()
        thread.join()
        self.rounds += 1
        self.waiting, reason = result[0]
        print(self.waiting, reason)
        if self.waiting == 0: request_stop()
  =}
}
"""

WAITING = "events that threads have scheduled"


@pytest.mark.parametrize(
    ("limit", "values", "count", "reason"),
    [
        ("", "[1] * 5000", 5000, ""),
        ("3000", "[1] * 5000", 3000, f"3000 {WAITING}, with 0 bytes, wait for reactions"),
        ("1 MB", "[bytes(300_000)] * 9", 3, f"3 {WAITING}, with 900000 bytes, wait for reactions"),
        ("1 MB", "[np.zeros(50_000)] * 9", 2, f"2 {WAITING}, with 800000 bytes, wait"),
        ("1 MB", "[{'a': [], 'b': np.zeros(50_000)}] * 9", 2, f"2 {WAITING}, with 800000 bytes"),
        # One may always wait.
        ("10", "[np.zeros(50_000)] * 9", 9, ""),
        ("10 B", "[np.zeros(50_000)] * 9", 1, f"1 {WAITING}, with 400000 bytes, wait"),
    ],
)
def test_a_thread_that_schedules_too_much_is_told(
    run: Run, monkeypatch: pytest.MonkeyPatch, limit: str, values: str, count: int, reason: str
) -> None:
    monkeypatch.setenv("HPRM_EVENT_LIMIT", limit)
    outcome = run(PROGRAM.replace("VALUES", values))
    assert (outcome.code, outcome.err) == (0, "")
    # What has been dealt with does not count any more, so the second round is like the first. The
    # event that is being dealt with waits no more, but its value is still there.
    first, second = outcome.out.splitlines()
    assert first.split(" ", 1)[0] == str(count)
    assert int(second.split(" ", 1)[0]) in (count, count - 1)
    if reason:
        assert reason in first
        assert "frame cannot be scheduled: " in first
        assert "HPRM_EVENT_LIMIT permits no more; schedule less often" in first
    else:
        assert first == str(count) + " "


def test_that_events_pile_up_is_told_once(run: Run) -> None:
    text = PROGRAM.replace("VALUES", "[np.zeros((1 << 30) // 8, np.float64)] * 3")
    outcome = run(text)
    assert outcome.code == 0, outcome.err
    [line] = outcome.err.splitlines()
    assert line.startswith(
        f"warning: 2 {WAITING}, with {2 << 30} bytes, wait for reactions, now of "
    )
    assert "HPRM_EVENT_LIMIT" in line


@pytest.mark.parametrize("text", ["plenty", "-1", "1.5 MB"])
def test_a_limit_that_is_none_is_an_error(
    run: Run, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setenv("HPRM_EVENT_LIMIT", text)
    outcome = run(PROGRAM.replace("VALUES", "[]"))
    assert outcome.code == 1
    assert f"HPRM_EVENT_LIMIT={text} is wrong: not a number of events" in outcome.err


FEDERATION = """\
target Python { timeout: 10 ms }
reactor Source { output out  reaction(startup) -> out {= out.set(1) =} }
reactor Sink { input inp  reaction(inp) {= pass =} }
federated reactor {
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}
"""


def test_a_federation_says_so_every_time(launch: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HPRM_EVENT_LIMIT", "plenty")
    # A federate that fails at once ends before the RTI has answered it.
    for _ in range(5):
        outcome = launch(FEDERATION)
        assert outcome.code == 2
        assert "HPRM_EVENT_LIMIT=plenty is wrong" in outcome.err, outcome.err
