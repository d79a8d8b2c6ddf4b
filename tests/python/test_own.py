"""A receiver may write to an array in the sender's memory, and no other process sees a write.

That is how tensors of PyTorch arrive, which knows no read-only memory. The same is done here with
arrays, so that it is tested without PyTorch, too.
"""

from __future__ import annotations

import pytest
from conftest import Run
from processes import COORDINATIONS
from snippets import PLACE

# How a value is made of a number, and how the receiver comes to an array that it may write to.
WAYS = {
    "array": ("np.full(N, number)", "own(value)"),
    "reshaped": ("np.full((N // 10, 10), number, order='F')", "own(value)"),
    "tensor": ("torch.full((N,), number)", "value.numpy()"),
    "bfloat16": (
        "torch.full((4 * N,), number).to(torch.bfloat16)",
        "value.view(torch.int64).numpy()",
    ),
}

COMMON = """\
preamble {=
import os
import numpy as np
from hprm._hprm import own
try:
    import torch
except ImportError:
    pass
N = 300_000
SOME = [0, 511, 512, 100_000]

def make(number):
    return MAKE

def writable(value):
    return WRITABLE

PLACE
def mode(array):
    _, _, mode, name = place(array)
    return mode, "memfd:hprm-store" in name

def is_all(value, number):
    return bool((value == make(number)).all())
=}
"""

PROGRAM = """\
target Python { coordination: COORDINATION, store-limit: "64 MB" }
COMMON
reactor Source {
  output out
  input done
  state count = 0
  reaction(startup, done) -> out {=
    # Writes over whatever memory is free.
    scratch = [np.full(N, -1) for _ in range(3)]
    del scratch
    if self.count == 60:
        stats = lf.store_stats()
        print(stats["inline_fallbacks"], stats["bytes_in_use"] < 32_000_000)
        request_stop()
    else:
        out.set(make(self.count))
        self.count += 1
  =}
}
reactor Writer {
  input inp
  output done
  state kept = {= [] =}
  state wrong = {= [] =}
  state modes = {= set() =}
  state count = 0
  reaction(inp) -> done {=
    value = inp.value
    array = writable(value)
    self.modes.add(mode(array))
    if not is_all(value, self.count) or not array.flags.writeable:
        self.wrong.append(self.count)
    # Some is written and the rest is not, at both ends of a page.
    flat = array.ravel(order="K")
    before = flat[-1]
    flat[SOME] = -7
    self.kept = [*self.kept[-3:], (self.count, flat, before)]
    for count, flat, before in self.kept:
        if (flat[SOME] != -7).any() or (np.delete(flat, SOME) != before).any():
            self.wrong.append(("kept", count))
    self.count += 1
    done.set(self.count)
  =}
  reaction(shutdown) {=
    print(self.count, self.wrong, self.modes, lf.store_stats()["bytes_copied"])
  =}
}
reactor Witness {
  input inp
  state count = 0
  state wrong = {= [] =}
  reaction(inp) {=
    if not is_all(inp.value, self.count):
        self.wrong.append(self.count)
    self.count += 1
  =}
  reaction(shutdown) {= print(self.count, self.wrong) =}
}
federated reactor {
  source = new Source()
  writer = new Writer()
  witness = new Witness()
  source.out -> writer.inp
  source.out -> witness.inp
  writer.done -> source.done after 1 msec
}
"""


def program(text: str, coordination: str, way: str) -> str:
    """The text of a program; the test is skipped without PyTorch if it needs that."""
    make, writable = WAYS[way]
    if "torch" in make:
        pytest.importorskip("torch")
    text = (
        text.replace("COMMON", COMMON).replace("PLACE", PLACE).replace("COORDINATION", coordination)
    )
    return text.replace("MAKE", make).replace("WRITABLE", writable)


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("way", WAYS)
def test_no_other_process_sees_what_a_receiver_writes(
    launch: Run, coordination: str, way: str
) -> None:
    outcome = launch(program(PROGRAM, coordination, way))
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == [
        "[source] 0 True",
        "[witness] 60 []",
        "[writer] 60 [] {('rw-p', True)} 0",
    ]


FORK = """\
target Python { coordination: COORDINATION, store-limit: "32 MB" }
COMMON
reactor Source {
  output out
  input done
  state count = 0
  reaction(startup, done) -> out {=
    out.set(make(self.count))
    self.count += 1
    if self.count == 40: request_stop()
  =}
}
reactor Forker {
  input inp
  state count = 0
  state wrong = 0
  output done
  state child = {= None =}
  reaction(inp) -> done {=
    if self.count == 3:
        array = writable(inp.value)
        array.ravel(order="K")[0] = -7
        again, said = os.pipe(), os.pipe()
        if os.fork() == 0:
            # Looks when its parent has long dropped the array, and its owner has used the memory.
            os.close(again[1])
            os.read(again[0], 1)
            flat = array.ravel(order="K")
            right = flat[0] == -7 and (flat[1:] == 3).all()
            os.write(said[1], b"y" if right else b"n")
            os._exit(0)
        os.close(again[0])
        self.child = (again[1], said)
    self.count += 1
    done.set(self.count)
  =}
  reaction(shutdown) {=
    again, said = self.child
    os.close(again)
    print(self.count, os.read(said[0], 1))
    os.wait()
  =}
}
federated reactor {
  source = new Source()
  forker = new Forker()
  source.out -> forker.inp
  forker.done -> source.done after 1 msec
}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_forked_process_has_it_as_it_was(launch: Run, coordination: str) -> None:
    outcome = launch(program(FORK, coordination, "array"))
    assert outcome.code == 0, outcome.err
    assert outcome.out == "[forker] 40 b'y'\n"
