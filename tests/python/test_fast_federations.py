"""Federations that do not wait for physical time."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

# An hour of logical time, in which two federates exchange messages and a third one only listens.
HOUR = """\
target Python {{ fast: true, timeout: 1 hour }}
reactor Simulator {{
  input back
  output out
  state count = 0
  timer t(0, 1 s)
  reaction(t) -> out {{=
    self.count += 1
    out.set(self.count)
  =}}
  reaction(back) {{=
    if back.value % 600 == 0:
        print("back", back.value, lf.time.logical_elapsed() // 1_000_000, flush=True)
  =}}
}}
reactor Robot {{
  input i
  output o
  reaction(i) -> o {{= o.set(i.value) =}}
}}
reactor Recorder {{
  input i
  state sum = 0
  reaction(i) {{= self.sum += i.value =}}
  reaction(shutdown) {{= print("sum", self.sum, flush=True) =}}
}}
{kind} reactor {{
  s = new Simulator()
  r = new Robot()
  c = new Recorder()
  s.out -> r.i
  {back}
  r.o -> c.i
}}
"""


@pytest.mark.parametrize("back", ["r.o -> s.back after 10 ms", "r.o -> s.back"])
@pytest.mark.parametrize("options", [[], ["--in-process"]])
def test_an_hour_passes_in_seconds_in_the_same_order(
    bench: Bench, tmp_path: Path, back: str, options: list[str]
) -> None:
    printed = []
    for kind, words in [("main", []), ("federated", options)]:
        (tmp_path / f"{kind}.lf").write_text(HOUR.format(kind=kind, back=back))
        outcome = finish(bench.call("run", *words, f"{kind}.lf"))
        assert outcome.code == 0, outcome.err
        lines = [line.rpartition("] ")[2] for line in outcome.out.splitlines()]
        # The federates end at the same time.
        printed.append(sorted(lines))
    assert printed[0] == printed[1]
    assert f"sum {3601 * 3602 // 2}" in printed[0] and len(printed[0]) == 7
