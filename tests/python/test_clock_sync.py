"""The clocks of federates follow the time of the RTI, and never go back."""

from __future__ import annotations

import pytest
from conftest import Run

PROGRAM = """\
    target Python {{
      timeout: 300 ms,
      coordination: {coordination},
      clock-sync: {mode},
      clock-sync-options: {{ local-federates-on: true, test-offset: {offset} }}
    }}
    preamble {{= import time =}}
    reactor Watch {{
      input inp
      output out
      timer t(0, 1 ms)
      state before = 0
      state wrong = 0
      state back = 0
      reaction(startup) -> out {{= out.set(1) =}}
      reaction(inp) {{= pass =}}
      reaction(t) {{=
        for _ in range(100):
            now = lf.time.physical()
            self.back += now < self.before
            self.before = now
        self.wrong = max(self.wrong, abs(now - time.time_ns()))
      =}}
      reaction(shutdown) {{= print(self.wrong < SEC(5), self.back, lf.time.logical_elapsed()) =}}
    }}
    federated reactor {{
      a = new Watch()
      b = new Watch()
      a.out -> b.inp
      b.out -> a.inp after 10 ms
    }}
    """


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
@pytest.mark.parametrize("mode", ["init", "on"])
@pytest.mark.parametrize("offset", ["100 s", "-100 s", "1 msec"])
def test_a_wrong_clock_is_put_right_before_the_start(
    launch: Run, coordination: str, mode: str, offset: str
) -> None:
    outcome = launch(PROGRAM.format(coordination=coordination, mode=mode, offset=offset))
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == [f"[{name}] True 0 300000000" for name in ["a", "b"]]


def test_without_a_comparison_clocks_are_left_alone(launch: Run) -> None:
    outcome = launch(PROGRAM.format(coordination="centralized", mode="off", offset="100 s"))
    assert (outcome.code, outcome.err) == (0, "")
    assert sorted(outcome.out.splitlines()) == [f"[{name}] True 0 300000000" for name in ["a", "b"]]
