"""Processes that a body forks go on reading what was open when they were forked."""

from __future__ import annotations

import pytest
from conftest import Run
from processes import COORDINATIONS

PROGRAM = """\
target Python {{ coordination: {coordination}, timeout: 400 msec }}
preamble {{=
import multiprocessing, os
import numpy as np
N = 200_000
FORK = multiprocessing.get_context("fork")

def look(array, number, again):
    "What a child says, long after the tag: whether it still has the array that it was given."
    again.recv()
    print(number, "kept" if (array == number).all() else "changed", flush=True)
=}}
reactor Camera {{
  output image
  input echo
  timer t(0, 20 msec)
  state number = 0
  state children = {{= [] =}}
  reaction(t) -> image {{=
    image.set(np.full(N, self.number))
    self.number += 1
  =}}
  reaction(echo) {{= {in_camera} =}}
  reaction(shutdown) {{= {end} =}}
}}
reactor Saver {{
  input image
  state children = {{= [] =}}
  reaction(image) {{= {in_saver} =}}
  reaction(shutdown) {{= {end} =}}
}}
federated reactor {{
  camera = new Camera()
  saver = new Saver()
  camera.image -> saver.image
  camera.image -> camera.echo after 20 msec
}}
"""

START = """
    number = int(PORT.value[0])
    if number in (3, 6):
        end, again = FORK.Pipe()
        child = FORK.Process(target=look, args=(PORT.value, number, end))
        child.start()
        self.children.append((child, again))
"""

END = """
    for child, again in self.children:
        again.send(None)
        child.join()
"""


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("who", ["saver", "camera"])
def test_a_forked_process_keeps_the_array_that_it_has(
    launch: Run, who: str, coordination: str
) -> None:
    bodies = {
        "in_saver": START.replace("PORT", "image") if who == "saver" else "pass",
        "in_camera": START.replace("PORT", "echo") if who == "camera" else "pass",
    }
    outcome = launch(PROGRAM.format(coordination=coordination, end=END, **bodies))
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == [f"[{who}] 3 kept", f"[{who}] 6 kept"]
