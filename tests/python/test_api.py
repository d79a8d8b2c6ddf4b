"""The names that bodies use: tags, units of time, and what ports and actions say when misused."""

from __future__ import annotations

import pickle
import subprocess
import sys
from typing import Any

import pytest

import hprm
from hprm import MSEC, SEC, Make, Tag


def test_tags_are_ordered_by_time_then_by_microstep() -> None:
    tags = [Tag(2, 0), Tag(1, 5), Tag(time=1, microstep=2)]
    assert sorted(tags) == [Tag(1, 2), Tag(1, 5), Tag(2, 0)]
    assert Tag(1, 2) != Tag(1, 3)
    assert max(tags) is tags[0]


def test_tags_can_be_keys_and_travel() -> None:
    tag = Tag(time=7, microstep=1)
    assert {tag: "x"}[Tag(7, 1)] == "x"
    assert pickle.loads(pickle.dumps(tag)) == tag
    assert repr(tag) == str(tag) == "Tag(time=7, microstep=1)"


def test_a_tag_is_compared_with_tags_only() -> None:
    with pytest.raises(TypeError):
        assert Tag(1) < 2  # type: ignore[operator]


def test_units_of_time() -> None:
    assert hprm.NSEC(1) == 1
    assert SEC(2) == 2 * hprm.BILLION == 2_000_000_000
    assert hprm.WEEKS(1) == 7 * hprm.DAY(1) == 7 * 24 * hprm.HOURS(1)
    assert MSEC(1.5) == 1_500_000
    assert hprm.FOREVER == 2**63 - 1
    assert hprm.NEVER == -(2**64 - 1)


def test_make_makes_what_is_missing() -> None:
    made = Make()
    made.a.b.c = 3
    assert made.a.b.c == 3
    assert not hasattr(made, "__len__")


def test_importing_has_no_effect() -> None:
    code = (
        "import sys, threading; before = dict(vars(sys)), list(sys.path); import hprm;"
        "assert 'numpy' not in sys.modules; assert threading.active_count() == 1;"
        "assert sys.path == before[1]"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_a_program_starts_without_what_it_does_not_use(launch: Any) -> None:
    # Together they take longer than all else that a federate does until its program begins.
    modules = {"dataclasses", "inspect", "json", "numpy", "shutil", "subprocess", "tempfile"}
    if sys.version_info >= (3, 14):
        # Its `traceback` imports them.
        modules -= {"dataclasses", "inspect"}
    outcome = launch(
        f"""
        target Python {{ timeout: 0 ms }}
        reactor A {{
          reaction(startup) {{=
            import gc
            print(sorted({modules} & set(sys.modules)), gc.isenabled())
          =}}
        }}
        federated reactor {{ a = new A() }}
        """
    )
    assert (outcome.code, outcome.out, outcome.err) == (0, "[a] [] True\n", "")


PROGRAM = """
target Python {{ timeout: 1 ms }}
reactor A {{
  input a
  input[3] m
  output out
  logical action act
  physical action phy
  reaction(startup) -> out, act, phy {{=
    out.set(1)
  =}}
  reaction(a, m) -> out, act {{=
{body}
  =}}
}}
main reactor {{
  a = new A()
  b = new A()
  a.out -> b.a
}}
"""


def attempt(run: Any, statement: str) -> str:
    """The message of what a statement in a body raises."""
    body = f"""
    try:
        {statement}
    except Exception as error:
        print(type(error).__name__, error, sep=": ")
"""
    outcome = run(PROGRAM.format(body=body))
    assert outcome.code == 0, outcome.err
    return outcome.out.strip()


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("a.set(1)", "TypeError: port a cannot be set here; only the effects"),
        ("m[0].set(1)", "TypeError: port m[0] cannot be set here"),
        ("m[3]", "IndexError: m has 3 channels, from 0 to 2; there is no channel 3"),
        ("m[-4]", "IndexError: m has 3 channels, from 0 to 2; there is no channel -4"),
        ("m['x']", "TypeError: the channels of m have whole numbers, and this is a str"),
        ("m[0] = 1", "TypeError: a channel is set by its method: m[0].set(...)"),
        ("m.value", "TypeError: multiport m has no value of its own; read one of its channels"),
        ("len(a)", "TypeError: port a is not a multiport"),
        ("list(a)", "TypeError: port a is not a multiport"),
        ("a.value = 3", "AttributeError: a port is set by its method: a.set(...)"),
        ("act.value = 3", "AttributeError: the value of an action is that of its event"),
        ("out.set()", "TypeError: "),
        (
            "act.schedule(0.5)",
            "ValueError: a time is a number of nanoseconds, and 0.5 is less than",
        ),
        ("act.schedule('x')", "ValueError: a time is a number with a unit (ns, us, ms, s, min,"),
        ("act.schedule([])", "TypeError: a time must be a number of nanoseconds, such as"),
        ("self.update_deadline(-1)", "ValueError: a deadline cannot be negative, and -1 is"),
        ("Tag(1, -1)", "ValueError: a microstep is a number from 0 to 4294967295"),
        ("act.schedule(float('inf'))", "ValueError: inf is no number of nanoseconds"),
        ("lf.set_fed_maxwait(3)", "RuntimeError: there is a maxwait only in the federates"),
        ("get_fed_maxwait()", "RuntimeError: there is a maxwait only in the federates"),
        ("start([])", "RuntimeError: the program has been started already"),
    ],
)
def test_misuse_is_explained(run: Any, statement: str, message: str) -> None:
    assert attempt(run, statement).startswith(message)


@pytest.mark.parametrize(
    ("statement", "result"),
    [
        ("print(m.width, len(m), a.width)", "3 3 -2"),
        ("print(m[0].get(), m[0].get(7), a.get(7), act.get(7), m[0].value)", "None 7 1 7 None"),
        ("print([p.is_present for p in m], m.is_present, bool(m))", "[False] * 3 False True"),
        ("print(len(m[1:]), repr(m[-1]), a[0].value)", "2 <port m[2]> 1"),
        (
            "print(list(reversed(m))[0] is m[2], m[1] in m, m[::2] == (m[0], m[2]))",
            "True True True",
        ),
        (
            "print(self.register_user_trace_event('x'), lf.tag_start_effective() == lf.tag())",
            "0 True",
        ),
        ("out.set(None); print(out.is_present, out.value)", "True None"),
        ("out.set(1); out.set(2); print(out.value)", "2"),
        ("print(a.intended_tag == lf.tag(), a.physical_time_of_arrival < 0)", "True True"),
        ("print(act.is_present, act.value)", "False None"),
        ("print(lf.tag_compare(lf.tag(), Tag(0)), lf.tag_compare(Tag(0), Tag(0)))", "1 0"),
        ("print(lf.time.logical() - lf.time.start(), lf.time.logical_elapsed())", "0 0"),
        ("print(lf.time.physical() > lf.time.start() > 10**18)", "True"),
        ("print(self.lf_module() is lf, self.bank_index, type(self).__name__)", "True 0 _A"),
        ("print(os.path.dirname(__file__) == lf.source_directory(), __name__)", "True __main__"),
        ("print(lf.store_stats()['objects_sealed'])", "0"),
    ],
)
def test_what_bodies_see(run: Any, statement: str, result: str) -> None:
    expected = result.replace("[False] * 3", "[False, False, False]")
    assert attempt(run, statement) == expected


def test_a_port_is_an_argument_and_nothing_to_keep(run: Any) -> None:
    outcome = run(
        """
        target Python { timeout: 1 s, fast: true }
        preamble {= import threading; kept = [] =}
        reactor A {
          input a
          output out
          logical action act
          reaction(startup) -> out, act {=
            kept.append(out)
            def work():
              for use in (lambda: out.set(2), lambda: out.value, lambda: out.is_present):
                try: use()
                except RuntimeError as error: print(error)
            if len(kept) == 1:
              thread = threading.Thread(target=work)
              thread.start()
              thread.join()
            out.set(1)
            act.schedule(0)
          =}
          reaction(act) {=
            try: kept[0].set(2)
            except RuntimeError as error: print(error)
          =}
          reaction(a) -> out {= kept[0].set(3) =}
        }
        main reactor { x = new A()  y = new A()  y.out -> x.a after 1 ms }
        """,
    )
    assert outcome.code == 1
    kept = "port Program.x.out is an argument of reaction Program.x.1, but reaction Program"
    thread = "port Program.x.out can be used only on the thread that runs reaction Program.x.1"
    lines = [line.partition(",")[0] for line in outcome.out.splitlines()]
    assert lines == [thread] * 3 + [kept.partition(",")[0]] * 2, outcome.err
    assert f"{kept}.x.3 is running" in outcome.err


def test_threads_reach_physical_actions_only(run: Any) -> None:
    outcome = run(
        """
        target Python { timeout: 10 s }
        preamble {= import threading =}
        main reactor {
          logical action log
          physical action phy
          reaction(startup) -> log, phy {=
            def work(log=log, phy=phy):
                try: log.schedule(0)
                except RuntimeError as error: print(error)
                for i in range(3): phy.schedule(i, i)
            self.thread = threading.Thread(target=work)
            self.thread.start()
          =}
          reaction(phy) {=
            print(phy.value)
            if phy.value == 2: request_stop()
          =}
        }
        """
    )
    assert outcome.code == 0, outcome.err
    lines = outcome.out.splitlines()
    assert "logical action log can be scheduled only inside a reaction" in lines[0]
    assert lines[1:] == ["0", "1", "2"]


def test_an_action_is_not_scheduled_in_the_past(run: Any) -> None:
    outcome = run(
        """
        target Python
        main reactor {
          logical action a
          timer t(0, 1 ms)
          reaction(startup) -> a {=
            for _ in range(3):
              a.schedule(-5)
            try:
              a.schedule(2**70)
            except OverflowError as error:
              print(error)
          =}
          reaction(a) {= print("scheduled", lf.tag().microstep); lf.request_stop() =}
        }
        """
    )
    assert outcome.code == 0
    assert "scheduled 1" in outcome.out
    assert "a time has at most 9223372036854775807 nanoseconds" in outcome.out
    assert outcome.err.count("RuntimeWarning: a.schedule(-5): the past cannot be changed") == 1
    assert "Program.lf:8: " in outcome.err
