"""What a reader cannot do with the memory of an owner: write it, or use up descriptors with it."""

from __future__ import annotations

import os
import signal

import pytest
from processes import COORDINATIONS, Bench, finish

FULL = bool(os.environ.get("HPRM_ACCEPTANCE"))

# Witness and vandal read one array in the memory of the owner, which waits until both are there.
VANDALISM = """\
target Python { coordination: COORDINATION, keepalive: true }
preamble {=
import ctypes, os, pathlib, time
import numpy as np
def wait_for(name):
    while not pathlib.Path(name).exists(): time.sleep(0.002)
=}
reactor Owner {
  output out
  state image = {= np.arange(100_000) =}
  timer t(0, 10 msec)
  state sent = False
  reaction(t) -> out {=
    if not self.sent and pathlib.Path("joined").exists():
        self.sent = True
        out.set(self.image)
  =}
  reaction(shutdown) {= print("unchanged", (self.image == np.arange(100_000)).all()) =}
}
reactor Witness {
  input inp
  reaction(inp) {=
    wait_for("tried")
    wait_for("dead")
    print("unchanged", (inp.value == np.arange(100_000)).all())
    request_stop()
  =}
}
reactor Vandal {
  input inp
  reaction(startup) {= pathlib.Path("joined").touch() =}
  reaction(inp) {=
    array = inp.value
    assert not array.flags.writeable and not array[::2].flags.writeable
    for attempt in (
        lambda: array.__setitem__(0, 7),
        lambda: array.setflags(write=True),
        lambda: array.sort(),
        lambda: np.copyto(array, 0),
        lambda: memoryview(array).__setitem__(0, 7),
    ):
        try:
            attempt()
        except (ValueError, TypeError):
            continue
        raise AssertionError("a reader has written")
    page = array.ctypes.data & ~4095
    read_and_write = 3
    libc = ctypes.CDLL(None, use_errno=True)
    assert libc.mprotect(ctypes.c_void_p(page), 4096, read_and_write) == -1
    assert ctypes.get_errno() == 13, "that is permission denied"
    print("refused", flush=True)
    pathlib.Path("tried").touch()
    ctypes.memset(array.ctypes.data, 7, 8)
    print("has written", flush=True)
  =}
}
federated reactor {
  owner = new Owner()
  witness = new Witness()
  @transient
  vandal = new Vandal()
  owner.out -> witness.inp
  owner.out -> vandal.inp
}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_reader_that_writes_in_spite_of_all_dies_alone(bench: Bench, coordination: str) -> None:
    text = VANDALISM.replace("COORDINATION", coordination)
    (bench.folder / "Main.lf").write_text(text)
    federation = bench.federation()
    for name in ["rti", "vandal", "witness", "owner"]:
        federation.start(name)
    vandal = finish(federation.members["vandal"])
    assert (vandal.code, vandal.out) == (-signal.SIGSEGV, "refused\n")
    (bench.folder / "dead").touch()
    for name in ["witness", "owner"]:
        outcome = finish(federation.members[name])
        assert (outcome.code, outcome.out) == (0, "unchanged True\n"), (name, outcome.err)


MESSAGES = 100 if FULL else 20
ARRAYS = 100
"""In a message; each is an object of the store."""

HOARD = """\
target Python { coordination: COORDINATION }
preamble {=
import os, resource
import numpy as np
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
=}
reactor Source {
  output out
  state count = 0
  timer t(0, 1 msec)
  reaction(t) -> out {=
    out.set([np.full(8_300, ARRAYS * self.count + at) for at in range(ARRAYS)])
    self.count += 1
    if self.count == MESSAGES: request_stop()
  =}
  reaction(shutdown) {=
    stats = lf.store_stats()
    # Watchers of other tests, which look for a federation, are some of them for a moment.
    few = len(os.listdir("/proc/self/fd")) <= stats["segments"] + 24
    print(stats["objects_sealed"], stats["inline_fallbacks"], few)
  =}
}
reactor Hoarder {
  input inp
  state kept = {= [] =}
  reaction(inp) {= self.kept += inp.value =}
  reaction(shutdown) {=
    right = [int(array[0]) for array in self.kept] == list(range(ARRAYS * MESSAGES))
    shared = not any(array.flags.writeable for array in self.kept)
    print(len(self.kept), right and shared, len(os.listdir("/proc/self/fd")) <= 16 + 32)
  =}
}
federated reactor {
  source = new Source()
  hoarder = new Hoarder()
  source.out -> hoarder.inp
}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_objects_cost_no_descriptors(bench: Bench, coordination: str) -> None:
    text = HOARD.replace("COORDINATION", coordination)
    outcome = bench.run(text.replace("ARRAYS", str(ARRAYS)).replace("MESSAGES", str(MESSAGES)))
    assert outcome.code == 0, outcome.err
    lines = sorted(outcome.out.splitlines())
    count = ARRAYS * MESSAGES
    assert lines == [f"[hoarder] {count} True True", f"[source] {count} 0 True"]
