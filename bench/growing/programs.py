"""The federations, as texts: a chain, a mesh in which all are connected, and a pair.

Each federate writes what it has taken as a JSON file of its own into the folder `HPRM_BENCH_OUT`.
"""

from __future__ import annotations

PREAMBLE = """
target Python { coordination: COORDINATION }
preamble {=
  import json, os, time
  from pathlib import Path
  import numpy as np
  import hprm

  def save(name, **values):
      Path(os.environ["HPRM_BENCH_OUT"], f"{name}.json").write_text(json.dumps(values))

  def memory():
      # Of pages that several processes share, each counts with its part; those of files are the
      # interpreter and libraries, which all processes of the machine share.
      lines = Path("/proc/self/smaps_rollup").read_text().splitlines()
      sizes = {line.split()[0]: int(line.split()[1]) for line in lines[1:]}
      return {"kib": sizes["Pss_Anon:"] + sizes["Pss_Shmem:"]}
=}
"""

CHAIN = """
reactor First(tags = 0, warm_up = 0) {
  output out
  timer t(50 ms, 20 ms)
  state sent = 0
  state began = 0
  reaction(t) -> out {=
    if self.sent == self.warm_up:
        self.began = time.process_time_ns()
    if self.sent == self.warm_up + self.tags:
        lf.request_stop()
        return
    self.sent += 1
    out.set(time.perf_counter_ns())
  =}
  reaction(shutdown) {=
    save("first", cpu=time.process_time_ns() - self.began, **memory())
  =}
}
reactor Hop(warm_up = 0) {
  input inp
  output out
  state had = 0
  state began = 0
  reaction(inp) -> out {=
    if self.had == self.warm_up:
        self.began = time.process_time_ns()
    self.had += 1
    out.set(inp.value)
  =}
  reaction(shutdown) {=
    save(f"hop{self.bank_index}", cpu=time.process_time_ns() - self.began, **memory())
  =}
}
reactor Last(warm_up = 0) {
  input inp
  state times = {= [] =}
  state began = 0
  reaction(inp) {=
    now = time.perf_counter_ns()
    if len(self.times) == self.warm_up:
        self.began = time.process_time_ns()
    self.times.append(now - inp.value)
  =}
  reaction(shutdown) {=
    cpu = time.process_time_ns() - self.began
    save("last", cpu=cpu, times=self.times[self.warm_up:], **memory())
  =}
}
"""

SHORT_CHAIN = """
federated reactor {
  first = new First(tags = TAGS, warm_up = WARM_UP)
  last = new Last(warm_up = WARM_UP)
  first.out -> last.inp
}
"""

LONG_CHAIN = """
federated reactor {
  first = new First(tags = TAGS, warm_up = WARM_UP)
  hops = new[HOPS] Hop(warm_up = WARM_UP)
  last = new Last(warm_up = WARM_UP)
  first.out, hops.out -> hops.inp, last.inp
}
"""

MESH = """
reactor Member(width = 1) {
  input[width] inp
  output[width] out
  reaction(startup) -> out {=
    for port in out:
        port.set(self.bank_index)
  =}
  reaction(inp) {=
    if self.bank_index == 0:
        lf.request_stop()
  =}
  reaction(shutdown) {=
    save(f"member{self.bank_index}", **memory())
  =}
}
federated reactor {
  members = new[FEDERATES] Member(width = FEDERATES)
  members.out -> interleaved(members.inp)
}
"""

PAIR = """
reactor Source(size = 0, count = 0) {
  output out
  logical action step
  state sent = 0
  state array
  reaction(startup) -> step {=
    self.array = np.zeros(self.size, np.uint8)
    step.schedule(0)
  =}
  reaction(step) -> out, step {=
    out.set(self.array)
    self.sent += 1
    if self.sent < self.count:
        step.schedule(0)
  =}
}
reactor Sink(count = 0) {
  input inp
  state had = 0
  state began = 0
  reaction(inp) {=
    if self.had == self.count // 10:
        self.began = time.perf_counter_ns()
    self.had += 1
    if self.had == self.count:
        passed = time.perf_counter_ns() - self.began
        save("sink", messages=self.had - 1 - self.count // 10, passed=passed)
        lf.request_stop()
  =}
}
federated reactor {
  source = new Source(size = SIZE, count = COUNT)
  sink = new Sink(count = COUNT)
  source.out -> sink.inp
}
"""


def chain(coordination: str, federates: int, tags: int, warm_up: int) -> str:
    """A value that each of them passes on to the next one, at each tag."""
    text = PREAMBLE + CHAIN + (SHORT_CHAIN if federates == 2 else LONG_CHAIN)
    numbers = {"HOPS": federates - 2, "TAGS": tags, "WARM_UP": warm_up}
    return _filled(text, coordination, numbers)


def mesh(coordination: str, federates: int) -> str:
    """Each is connected with all of them, and itself."""
    return _filled(PREAMBLE + MESH, coordination, {"FEDERATES": federates})


def pair(coordination: str, size: int, count: int) -> str:
    """As many arrays of that many bytes as go through, one way."""
    return _filled(PREAMBLE + PAIR, coordination, {"SIZE": size, "COUNT": count})


def _filled(text: str, coordination: str, numbers: dict[str, int]) -> str:
    text = text.replace("COORDINATION", coordination)
    # The longest names first: `TAGS` may be part of another one.
    for name in sorted(numbers, key=len, reverse=True):
        text = text.replace(name, str(numbers[name]))
    return text
