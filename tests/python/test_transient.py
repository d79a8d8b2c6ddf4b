"""Transient federates: they join late, leave, join again, and replace one another."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Outcome, Run
from processes import COORDINATIONS

#: A federate that starts `mid` at a given time, and one that sends it a number every 20 ms.
REACTORS = """
reactor Starter(at = 200 ms) {
  preamble {= import subprocess =}
  timer t(at, 0)
  reaction(t) {=
    bin_dir = os.path.join(lf.package_directory(), "fed-gen", "Program", "bin")
    command = [os.path.join(bin_dir, "federate__mid"), "-i", lf.get_federation_id()]
    print("ended with", self.subprocess.run(command).returncode)
  =}
}
reactor Up {
  output out
  timer t(0, 20 ms)
  state count = 0
  reaction(t) -> out {=
    out.set(self.count)
    self.count += 1
  =}
}
reactor Down {
  input inp
  state seen = {= [] =}
  timer t(0, 10 ms)
  state ticks = 0
  reaction(t) {= self.ticks += 1 =}
  reaction(inp) {= self.seen.append(inp.value) =}
  reaction(shutdown) {=
    print("ticks", self.ticks)
    print("seen", self.seen)
  =}
}
"""


def program(coordination: str, middle: str, federates: str, timeout: str = "2 s") -> str:
    return f"""
target Python {{ coordination: {coordination}, timeout: {timeout} }}
{REACTORS}
reactor Mid {{
  input inp
  output out
  {middle}
}}
federated reactor {{
  up = new Up()
  @maxwait(50 ms)
  down = new Down()
  @transient @maxwait(50 ms)
  mid = new Mid()
  up.out -> mid.inp
  mid.out -> down.inp
  {federates}
}}
"""


def lines(outcome: Outcome, federate: str) -> list[str]:
    """What a federate has printed, line by line."""
    start = f"[{federate}] "
    return [line.removeprefix(start) for line in outcome.out.splitlines() if start in line]


def seen(outcome: Outcome) -> list[int]:
    """What `down` has received."""
    assert outcome.code == 0, (outcome.out, outcome.err)
    text = next(line for line in lines(outcome, "down") if line.startswith("seen"))
    return [int(number) for number in re.findall(r"-?\d+", text)]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_one_leaves_and_comes_back(launch: Run, coordination: str) -> None:
    middle = """
    state count = 0
    reaction(inp) -> out {=
      self.count += 1
      out.set(inp.value)
      if self.count == 3: lf.stop()
    =}
    reaction(shutdown) {= print("left after", self.count) =}
    """
    outcome = launch(program(coordination, middle, "starter = new Starter()", "3 s"))
    numbers = seen(outcome)
    # Three of each instance, one after the other; between the two, no instance forwarded numbers.
    assert len(numbers) == 6, numbers
    first, second = numbers[:3], numbers[3:]
    assert first == list(range(first[0], first[0] + 3))
    assert second == list(range(second[0], second[0] + 3))
    assert second[0] >= 10
    # The others never stopped.
    assert lines(outcome, "down")[0] == "ticks 301"
    assert lines(outcome, "mid") == ["left after 3"]
    assert lines(outcome, "starter") == ["left after 3", "ended with 0"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize("delay", ["", "after 0", "after 1 ms", "after 30 ms"])
def test_one_comes_back_to_a_cycle(launch: Run, coordination: str, delay: str) -> None:
    outcome = launch(f"""
    target Python {{ coordination: {coordination}, timeout: 3 s }}
    {REACTORS}
    reactor Camera {{
      output out
      input inp
      state seen = {{= [] =}}
      timer t(0, 10 ms)
      state ticks = 0
      reaction(t) -> out {{=
        self.ticks += 1
        out.set(self.ticks)
      =}}
      reaction(inp) {{= self.seen.append(inp.value) =}}
      reaction(shutdown) {{=
        print("ticks", self.ticks)
        print("seen", self.seen)
      =}}
    }}
    reactor Mid {{
      input inp
      output out
      state count = 0
      reaction(inp) -> out {{=
        out.set(inp.value)
        self.count += 1
        if self.count == 5: lf.stop()
      =}}
    }}
    federated reactor {{
      down = new Camera()
      @transient
      mid = new Mid()
      starter = new Starter()
      down.out -> mid.inp
      mid.out -> down.inp {delay}
    }}
    """)
    numbers = seen(outcome)
    # Each instance forwards five successive numbers; the camera continues between the two.
    first, second = numbers[0], numbers[5]
    assert numbers == [*range(first, first + 5), *range(second, second + 5)]
    assert lines(outcome, "down")[0] == "ticks 301"
    assert lines(outcome, "starter") == ["ended with 0"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_second_instance_takes_over(launch: Run, coordination: str) -> None:
    middle = """
    reaction(startup) {= print("begins") =}
    reaction(inp) -> out {= out.set(inp.value) =}
    reaction(shutdown) {= print("leaves") =}
    """
    outcome = launch(program(coordination, middle, "starter = new Starter()", "3 s"))
    numbers = seen(outcome)
    # It has loaded its program before the other one leaves: hardly a number is lost.
    assert numbers == sorted(set(numbers))
    assert numbers[-1] >= 149
    assert len(numbers) > 100, numbers
    assert lines(outcome, "mid") == ["begins", "leaves"]
    assert lines(outcome, "starter") == ["begins", "leaves", "ended with 0"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_its_time_begins_when_it_joins(launch: Run, coordination: str) -> None:
    middle = """
    timer t(10 ms, 0)
    reaction(startup) {=
      start = lf.tag_start_effective()
      assert start == lf.tag()
      print(start.time > lf.time.start())
    =}
    reaction(t) -> out {=
      print(lf.time.logical() - lf.tag_start_effective().time)
      out.set(0)
      lf.stop()
    =}
    """
    outcome = launch(program(coordination, middle, "starter = new Starter()"))
    assert seen(outcome) == [0, 0]
    assert lines(outcome, "starter") == ["True", "10000000", "ended with 0"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
@pytest.mark.parametrize(
    ("end", "code", "words"),
    [
        ("raise ValueError('no')", 1, "ValueError: no"),
        ("os._exit(3)", 3, "federate mid exited with code 3"),
        ("os.kill(os.getpid(), 9)", 1, "federate mid was killed by signal 9 (SIGKILL)"),
    ],
)
def test_the_others_survive_its_failure(
    launch: Run, coordination: str, end: str, code: int, words: str
) -> None:
    middle = f"""
    reaction(inp) -> out {{=
      import os
      out.set(inp.value)
      if inp.value >= 3: {end}
    =}}
    """
    outcome = launch(program(coordination, middle, ""))
    assert lines(outcome, "down")[0] == "ticks 201", outcome
    assert outcome.err.count("error: ") == 1, outcome.err
    assert words in outcome.err
    assert outcome.code == code


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_any_federate_may_stop_alone(launch: Run, coordination: str) -> None:
    outcome = launch(f"""
    target Python {{ coordination: {coordination}, timeout: 100 ms }}
    {REACTORS}
    reactor Short {{
      output out
      timer t(0, 10 ms)
      state count = 0
      reaction(t) -> out {{=
        out.set(self.count)
        self.count += 1
        if self.count == 3: lf.stop()
      =}}
      reaction(shutdown) {{= print("stops", lf.time.logical_elapsed(), lf.tag().microstep) =}}
    }}
    federated reactor {{
      short = new Short()
      down = new Down()
      short.out -> down.inp
    }}
    """)
    assert seen(outcome) == [0, 1, 2]
    assert lines(outcome, "down")[0] == "ticks 11"
    assert lines(outcome, "short") == ["stops 20000000 1"]


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_large_arrays_find_the_new_instance(launch: Run, coordination: str) -> None:
    outcome = launch(f"""
    target Python {{ coordination: {coordination}, timeout: 3 s }}
    preamble {{= import numpy as np =}}
    {REACTORS}
    reactor Source {{
      output out
      timer t(0, 20 ms)
      state count = 0
      reaction(t) -> out {{=
        out.set(np.full(100_000, self.count))
        self.count += 1
      =}}
    }}
    reactor Mid {{
      input inp
      output out
      state count = 0
      reaction(inp) -> out {{=
        out.set(int(inp.value.min()) if inp.value.min() == inp.value.max() else -1)
        self.count += 1
        if self.count == 5: lf.stop()
      =}}
    }}
    federated reactor {{
      source = new Source()
      @maxwait(50 ms)
      down = new Down()
      @transient @maxwait(50 ms)
      mid = new Mid()
      source.out -> mid.inp
      mid.out -> down.inp
      starter = new Starter()
    }}
    """)
    numbers = seen(outcome)
    assert len(numbers) == 10, numbers
    assert numbers == sorted(set(numbers))
    assert numbers[0] >= 0


def test_it_is_too_late_after_the_end(launch: Run, tmp_path: Path) -> None:
    outcome = launch(program("centralized", "reaction(startup) {= lf.stop() =}", ""))
    assert outcome.code == 0, outcome.err
    assert not (tmp_path / "fed-gen").exists()
    command = shutil.which("hprm", path=str(Path(sys.executable).parent))
    options = ["-i", "0" * 32, "--rti", "unix:@hprm-nobody", "--connect-timeout", "0.1"]
    done = subprocess.run(
        [str(command), "federate", tmp_path / "Program.lf", "mid", *options],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert "no RTI at unix:@hprm-nobody" in done.stderr
