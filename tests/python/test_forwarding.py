"""Federates forward received arrays without a copy, whichever federate ends meanwhile."""

from __future__ import annotations

import pytest
from conftest import Run
from processes import COORDINATIONS

COMMON = """
preamble {=
import os
import numpy as np
N = 50_000

def full(number):
    return np.full(N, number, dtype=np.float64)
=}

/** Keeps what comes, and says at the end what of it is not what it was. */
reactor Keeper {
  input inp
  state seen = {= [] =}
  reaction(inp) {= self.seen.append((inp.value, float(inp.value[0]))) =}
  reaction(shutdown) {=
    wrong = [number for array, number in self.seen if not (array == number).all()]
    order = [number for _, number in self.seen]
    print(len(order) > 5, order == sorted(set(order)), wrong)
  =}
}
"""


def lines(out: str, federate: str) -> list[str]:
    """What a federate has printed."""
    return [line.split("] ", 1)[1] for line in out.splitlines() if line.startswith(f"[{federate}")]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_an_array_goes_on_as_it_came_and_back_to_where_it_is_from(
    launch: Run, coordination: str
) -> None:
    outcome = launch(f"""\
        target Python {{ coordination: {coordination} }}
        {COMMON}
        reactor Source {{
          input back
          output out
          state count = 0
          state kept = {{= [] =}}
          reaction(startup, back) -> out {{=
            if back.is_present:
                assert (back.value["image"] == self.count).all()
                assert not back.value["image"].flags.writeable
                self.count += 1
                # The first ones are kept, all others are used again.
                self.kept = (self.kept + [(back.value["image"], self.count - 1)])[:3]
            if self.count == 40:
                stats = lf.store_stats()
                print(stats["bytes_copied"], stats["objects_sealed"], stats["segments"])
                print(all((array == number).all() for array, number in self.kept))
                request_stop()
            else:
                out.set(full(self.count))
          =}}
        }}
        reactor Relay {{
          input inp
          output out
          output again
          reaction(inp) -> out, again {{=
            array = inp.value
            out.set(array)
            again.set({{"image": array, "shape": array.shape}})
          =}}
          reaction(shutdown) {{=
            stats = lf.store_stats()
            print(stats["bytes_copied"], stats["bytes_mapped"], stats["objects_passed_on"])
          =}}
        }}
        federated reactor {{
          source = new Source()
          relay = new Relay()
          sink = new[2] Keeper()
          source.out -> relay.inp
          (relay.out)+ -> sink.inp after 0
          relay.again -> source.back after 0
        }}
        """)
    assert outcome.code == 0, outcome.err
    assert lines(outcome.out, "sink__0") == ["True True []"]
    assert lines(outcome.out, "sink__1") == ["True True []"]
    assert lines(outcome.out, "relay") == ["0 0 40"]
    copied, sealed, segments = lines(outcome.out, "source")[0].split()
    # The readers keep forty arrays of 400 kB.
    assert (copied, sealed) == ("0", "40")
    assert int(segments) <= 2
    assert lines(outcome.out, "source")[1:] == ["True"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_arrays_outlive_a_forwarder_that_is_killed(launch: Run, coordination: str) -> None:
    """Their owner goes on, and would write over them if it did not know better."""
    outcome = launch(f"""\
        target Python {{ coordination: {coordination}, timeout: 1500 ms }}
        {COMMON}
        reactor Up {{
          output out
          timer t(0, 5 ms)
          state count = 0
          reaction(t) -> out {{=
            # Writes over whatever memory is free.
            scratch = [full(-1) for _ in range(30)]
            del scratch
            out.set(full(self.count))
            self.count += 1
          =}}
          reaction(shutdown) {{= print(lf.store_stats()["bytes_copied"]) =}}
        }}
        reactor Mid {{
          input inp
          output out
          state count = 0
          state kept = {{= [] =}}
          reaction(inp) -> out {{=
            self.count += 1
            self.kept.append(inp.value)
            out.set(inp.value)
            if self.count == 20:
                os.kill(os.getpid(), 9)
          =}}
        }}
        federated reactor {{
          up = new Up()
          @maxwait(50 ms)
          down = new Keeper()
          @transient @maxwait(50 ms)
          mid = new Mid()
          up.out -> mid.inp
          mid.out -> down.inp
        }}
        """)
    assert outcome.code == 1
    assert "federate mid was killed by signal 9" in outcome.err
    assert lines(outcome.out, "down") == ["True True []"]
    assert lines(outcome.out, "up") == ["0"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("end", ["os.kill(os.getpid(), 9)", "lf.stop()"])
def test_arrays_are_forwarded_when_their_owner_has_ended(
    launch: Run, coordination: str, end: str
) -> None:
    outcome = launch(f"""\
        target Python {{ coordination: {coordination}, timeout: 1500 ms }}
        {COMMON}
        reactor Mid {{
          output out
          timer t(0, 5 ms)
          state count = 0
          reaction(t) -> out {{=
            if self.count == 10:
                {end}
                return
            out.set(full(self.count))
            self.count += 1
          =}}
        }}
        reactor Relay {{
          input inp
          output out
          timer t(1 sec, 10 ms)
          state kept = {{= [] =}}
          reaction(inp) {{= self.kept.append(inp.value) =}}
          reaction(t) -> out {{=
            # Their owner ended long ago.
            if self.kept:
                out.set(self.kept.pop(0))
          =}}
          reaction(shutdown) {{= print(lf.store_stats()["bytes_copied"]) =}}
        }}
        federated reactor {{
          @transient
          mid = new Mid()
          @maxwait(50 ms)
          relay = new Relay()
          @maxwait(50 ms)
          down = new Keeper()
          mid.out -> relay.inp
          relay.out -> down.inp
        }}
        """)
    assert outcome.code == (1 if "kill" in end else 0), outcome.err
    assert lines(outcome.out, "down") == ["True True []"], outcome.out + outcome.err
    assert lines(outcome.out, "relay") == ["0"]
