"""Programs with several workers."""

import re
from typing import Any

import pytest

MEETING = """
target Python {{ {properties} }}
preamble {{=
  import threading
  barrier = threading.Barrier(2)
  threads = set()
=}}
reactor Guest {{
  reaction(startup) {{=
    threads.add(threading.get_ident())
    {body}
  =}}
}}
main reactor {{
  a = new Guest()
  b = new Guest()
  reaction(shutdown) {{= print(len(threads)) =}}
}}
"""
MEET = "barrier.wait(timeout=60)"


def test_reactions_of_one_level_meet(run: Any) -> None:
    outcome = run(MEETING.format(properties="workers: 2", body=MEET))
    assert (outcome.code, outcome.out) == (0, "2\n"), outcome.err


def test_the_command_overrides_the_program(launch: Any) -> None:
    outcome = launch(MEETING.format(properties="workers: 1", body=MEET), "--workers", "2")
    assert (outcome.code, outcome.out) == (0, "2\n"), outcome.err


@pytest.mark.parametrize("properties", ["fast: true", "single-threaded: true"])
def test_one_thread_runs_everything(run: Any, properties: str) -> None:
    outcome = run(MEETING.format(properties=properties, body="pass"))
    assert (outcome.code, outcome.out) == (0, "1\n"), outcome.err


def test_of_two_failures_the_first_in_the_program_is_told(run: Any) -> None:
    outcome = run(
        """
        target Python { workers: 2 }
        preamble {=
          import threading
          failed = threading.Event()
        =}
        reactor First {
          reaction(startup) {=
            assert failed.wait(timeout=60)
            raise ValueError("first")
          =}
        }
        reactor Second {
          reaction(startup) {=
            failed.set()
            raise ValueError("second")
          =}
        }
        main reactor {
          a = new First()
          b = new Second()
        }
        """
    )
    assert outcome.code == 1
    assert "Main.a" in outcome.err or "Program.a" in outcome.err
    assert "first" in outcome.err and "second" not in outcome.err


def test_leaving_from_a_worker_gives_the_exit_code(run: Any) -> None:
    outcome = run(
        """
        target Python { workers: 3 }
        reactor Guest(index = 0) {
          reaction(startup) {=
            if self.index == 1:
                exit(7)
          =}
        }
        main reactor { g = new[3] Guest(index={= bank_index =}) }
        """
    )
    assert (outcome.code, outcome.err) == (7, "")


WIDE = """
target Python {{ workers: {workers}, timeout: 30 ms, fast: true }}
preamble {{=
  import sys, zlib
=}}
reactor Mixer(bank_index = 0) {{
  input[3] inp
  output out
  logical action again
  timer t(0, 2 ms)
  state log = {{= [] =}}
  reaction(t, inp, again) -> out, again {{=
    seen = (lf.tag(), again.value, [port.value for port in inp])
    self.log.append((lf.time.logical_elapsed(), lf.tag().microstep, *seen[1:]))
    mixed = zlib.crc32(repr((self.log, self.bank_index)).encode())
    if mixed % 3:
        out.set(mixed % 1000)
        assert out.value == mixed % 1000
    if mixed % 4 == 0:
        again.schedule(MSEC(mixed % 5), mixed % 7)
    if mixed % 1009 == 0:
        lf.request_stop()
  =}}
  reaction(shutdown) {{= sys.stdout.write(f"{{self.bank_index}} {{self.log}}\\n") =}}
}}
main reactor {{
  first = new[6] Mixer()
  second = new[6] Mixer()
  first.out, first.out, first.out -> second.inp
  second.out, second.out, second.out -> first.inp after 1 ms
}}
"""


def test_the_number_of_workers_does_not_show(run: Any) -> None:
    outcomes = [run(WIDE.format(workers=workers)) for workers in (1, 2, 8)]
    assert [outcome.code for outcome in outcomes] == [0, 0, 0], outcomes[0].err
    # A reaction that ends first may write first; `print` would write its newline separately.
    one, two, eight = (sorted(outcome.out.splitlines()) for outcome in outcomes)
    assert len(one) == 12 and len(outcomes[0].out) > 2000
    assert one == two == eight


def test_ports_of_others_stay_out_of_reach(run: Any) -> None:
    outcome = run(
        """
        target Python { workers: 2 }
        preamble {=
          import sys
          import threading
          barrier = threading.Barrier(2)
          ports = {}
        =}
        reactor Guest(name = "") {
          output out
          reaction(startup) -> out {=
            ports[self.name] = out
            barrier.wait(timeout=60)
            other = ports["b" if self.name == "a" else "a"]
            out.set(self.name)
            barrier.wait(timeout=60)
            # Its own reaction runs, but not here.
            # One write, since `print` writes the line and its end apart and both reactions print.
            try:
                sys.stdout.write(f"{other.value}\\n")
            except RuntimeError as error:
                sys.stdout.write(f"{error}\\n")
            assert out.value == self.name
            barrier.wait(timeout=60)
          =}
        }
        main reactor {
          a = new Guest(name="a")
          b = new Guest(name="b")
          reaction(a.out, b.out) {=
            print(a.out.value, b.out.value)
            try:
                ports["a"].set("late")
            except RuntimeError as error:
                print(error)
          =}
        }
        """
    )
    assert outcome.code == 0, outcome.err
    *refused, first, second = outcome.out.splitlines()
    assert len(refused) == 2 and first == "a b"
    stored = re.compile(r"port Program\.[ab]\.out is an argument of reaction Program\.[ab]\.1")
    for line in [*refused, second]:
        assert stored.search(line)
