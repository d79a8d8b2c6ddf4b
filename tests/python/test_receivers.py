"""A large array for several receivers: one place in memory for all of them, and at most one copy.

How long that takes is for ``bench/receivers.py``. Here it is proved of what the time consists: with
a loan no byte is copied, otherwise each byte once, whether one federate receives it or eight.
"""

from __future__ import annotations

import json

import pytest
from conftest import Run
from processes import COORDINATIONS
from snippets import PLACE

SIZE = 10_000_000
"""Bytes of an array."""

ROUNDS = 5

# The arrays are loans, or made by NumPy in a body, or belong to the program, which keeps them.
WAYS = {
    "loan": ("hprm.empty(SIZE, np.uint8)", 0),
    "made": ("np.empty(SIZE, np.uint8)", 0),
    "kept": ("self.kept", SIZE * ROUNDS),
}

PROGRAM = """\
target Python { coordination: COORDINATION }
preamble {=
import json
import numpy as np
import hprm
SIZE = ARRAY_BYTES
PLACE
=}
reactor Source {
  output out
  input replies
  logical action next(1 msec)
  state kept = {= np.empty(SIZE, np.uint8) =}
  state places = {= [] =}
  reaction(startup, next) -> out, next {=
    array = ARRAY
    array.fill(len(self.places))
    self.places.append(place(array))
    out.set(array)
    if len(self.places) < ROUNDS: next.schedule(0)
    else: request_stop()
  =}
  reaction(shutdown) {= print(json.dumps([self.places, lf.store_stats()])) =}
}
reactor Receiver {
  input inp
  state places = {= [] =}
  state right = True
  reaction(inp) {=
    array = inp.value
    assert not array.flags.writeable
    self.right = self.right and bool((array == len(self.places)).all())
    self.places.append(place(array))
  =}
  reaction(shutdown) {= print(json.dumps([self.places, lf.store_stats(), self.right])) =}
}
federated reactor {
  source = new Source()
  receiver = new[RECEIVERS] Receiver()
  (source.out)+ -> receiver.inp
}
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("receivers", [1, 5])
def test_an_array_is_in_one_place_however_many_receive_it(
    launch: Run, receivers: int, way: str, coordination: str
) -> None:
    array, copied = WAYS[way]
    text = PROGRAM.replace("PLACE", PLACE).replace("ARRAY_BYTES", str(SIZE)).replace("ARRAY", array)
    text = text.replace("COORDINATION", coordination)
    text = text.replace("RECEIVERS", str(receivers)).replace("ROUNDS", str(ROUNDS))
    outcome = launch(text)
    assert outcome.code == 0, outcome.err
    said = dict(line.split("] ", 1) for line in outcome.out.splitlines())
    places, stats = json.loads(said.pop("[source"))
    assert len(said) == receivers
    assert (stats["objects_sealed"], stats["bytes_copied"]) == (ROUNDS, copied)
    assert stats["inline_fallbacks"] == 0
    received = [json.loads(line) for line in said.values()]
    first = received[0][0]
    assert len(first) == ROUNDS
    for theirs, own, right in received:
        assert right
        # The same bytes of the same file as for all others; no receiver can write them.
        assert theirs == first
        assert all(mode == "r--s" and "memfd:hprm-store" in name for _, _, mode, name in theirs)
        assert (own["bytes_copied"], own["objects_sealed"], own["bytes_mapped"]) == (0, 0, 0)
    if way != "kept":
        # And the sender has written them there.
        assert [place[:2] for place in first] == [place[:2] for place in places]
