"""Names that bodies know without an import, and what inputs are to them, as in Lingua Franca."""

from __future__ import annotations

from typing import Any

import pytest

# Lingua Franca's generated module has these before any preamble runs.
NAMES = [
    "os",
    "sys",
    "copy",
    "lf",
    "Tag",
    "port_capsule",
    "action_capsule_t",
    "get_fed_maxwait",
    "set_fed_maxwait",
    "request_stop",
    "start",
    "BILLION",
    "FOREVER",
    "NEVER",
    "instant_t",
    "interval_t",
    "NSEC",
    "NSECS",
    "USEC",
    "USECS",
    "MSEC",
    "MSECS",
    "SEC",
    "SECS",
    "MINUTE",
    "MINUTES",
    "HOUR",
    "HOURS",
    "DAY",
    "DAYS",
    "WEEK",
    "WEEKS",
    "Make",
    "ReactorBase",
]

MODULE = [
    "tag",
    "tag_compare",
    "tag_start_effective",
    "request_stop",
    "stop",
    "source_directory",
    "package_directory",
    "start",
    "get_fed_maxwait",
    "set_fed_maxwait",
    "check_deadline",
    "update_deadline",
    "register_user_trace_event",
    "tracepoint_user_event",
    "tracepoint_user_value",
    "Tag",
    "port_capsule",
    "action_capsule_t",
    "time.logical",
    "time.logical_elapsed",
    "time.physical",
    "time.physical_elapsed",
    "time.start",
]

METHODS = [
    "lf_module",
    "check_deadline",
    "update_deadline",
    "register_user_trace_event",
    "tracepoint_user_event",
    "tracepoint_user_value",
    "bank_index",
]


def test_every_name_is_there_in_preambles_and_in_bodies(run: Any) -> None:
    outcome = run(
        f"""
        target Python
        preamble {{= early = [{", ".join(NAMES)}] =}}
        main reactor {{
          reaction(startup) {{=
            assert early == [{", ".join(NAMES)}]
            {"; ".join(f"lf.{name}" for name in MODULE)}
            {"; ".join(f"self.{name}" for name in METHODS)}
            assert isinstance(lf.time, type) and self.lf_module() is lf
            import LinguaFrancaProgram
            assert LinguaFrancaProgram is lf and sys.modules["__main__"].early is early
            unknown = [name for name in ("time", "random", "math") if name in globals()]
            print("all there", unknown)
          =}}
        }}
        """
    )
    assert (outcome.code, outcome.out) == (0, "all there []\n"), outcome.err


def test_directories(run: Any, tmp_path: Any) -> None:
    program = "target Python\nmain reactor { reaction(startup) {= %s =} }\n"
    (tmp_path / "src" / "deep").mkdir(parents=True)
    (tmp_path / "src" / "deep" / "Program.lf").write_text(
        program % "print(lf.source_directory(), lf.package_directory())"
    )
    outcome = run(
        program % "os.execv(sys.executable, [sys.executable, '-m', 'hprm', 'run',"
        " 'src/deep/Program.lf'])"
    )
    assert outcome.out.split() == [str(tmp_path / "src" / "deep"), str(tmp_path)], outcome.err


@pytest.mark.parametrize(("tracing", "handles"), [("false", "0 0"), ("true", "1 2")])
def test_trace_events_have_handles_if_the_program_is_traced(
    run: Any, tracing: str, handles: str
) -> None:
    outcome = run(
        f"""
        target Python {{ tracing: {tracing} }}
        main reactor {{
          reaction(startup) {{=
            first = self.register_user_trace_event("first")
            second = lf.register_user_trace_event(self, "second")
            self.tracepoint_user_event(first)
            self.tracepoint_user_value(second, 7)
            print(first, second)
          =}}
        }}
        """
    )
    assert (outcome.code, outcome.out) == (0, f"{handles}\n"), outcome.err


def test_a_mutable_input_is_a_copy_of_its_own(run: Any) -> None:
    outcome = run(
        """
        target Python { timeout: 1 ms }
        preamble {= original = [0] =}
        reactor Source {
          output out
          output[2] many
          reaction(startup) -> out, many {=
            out.set(original)
            many[1].set(original)
          =}
        }
        reactor Changes {
          mutable input x
          mutable input[2] m
          output out
          reaction(x) m -> out {=
            x.value.append("changed")
            m[1].value.append("too")
            assert x.is_present and m[1].is_present and not m[0].is_present
            assert (len(m), m[0].value) == (2, None)
            out.set(x.value)
            x.value = None
          =} deadline(100 s) {= =}
          reaction(x) {= assert x.value == [0] =}
        }
        reactor Late {
          mutable input x
          reaction(x) {=
            self.check_deadline()
            assert x.value == [0]
          =} deadline(0) {= x.value.append("late") =}
          reaction(x) {= print("late", x.value) =}
        }
        reactor Reads {
          input same
          input changed
          reaction(same, changed) {=
            print(same.value is original, same.value, changed.value)
          =}
        }
        main reactor {
          s = new Source()  c = new Changes()  l = new Late()  r = new Reads()
          s.out -> c.x
          s.many -> c.m
          s.out -> l.x
          s.out -> r.same
          c.out -> r.changed
        }
        """
    )
    assert outcome.code == 0, outcome.err
    assert sorted(outcome.out.splitlines()) == ["True [0] [0, 'changed']", "late [0]"]


def test_a_reaction_without_triggers_reacts_to_any_input(run: Any) -> None:
    outcome = run(
        """
        target Python { timeout: 2 ms, fast: true }
        reactor Source {
          output out
          timer t(0, 1 ms)
          reaction(t) -> out {= out.set(lf.time.logical_elapsed()) =}
        }
        reactor Sink {
          input a
          input[2] b
          reaction() {= print(a.value, [p.value for p in b]) =}
        }
        main reactor {
          one = new Source()  two = new Source()  sink = new Sink()
          one.out -> sink.a after 1 ms
          two.out -> sink.b after 2 ms
        }
        """
    )
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == ["0 [None, None]", "1000000 [0, None]"]


def test_maxwait_can_be_changed(launch: Any) -> None:
    outcome = launch(
        """
        target Python { coordination: decentralized, timeout: 60 s }
        preamble {=
          def refused(wait):
              try: set_fed_maxwait(wait)
              except (TypeError, ValueError) as error: print(error)
        =}
        reactor Silent { output out  reaction(startup) -> out {= pass =} }
        reactor Waits {
          input inp
          timer t(0, 10 ms)
          state least = {= [0, MSEC(30), 0] =}
          reaction(t) inp {=
            # Nothing ever comes, so each tag waits for as long as it was told to.
            if lf.time.physical() < lf.time.logical() + self.least.pop(0): exit(1)
            if self.least:
                print(get_fed_maxwait())
                set_fed_maxwait(self.least[0])
            else:
                refused(-1); refused("x"); refused(FOREVER)
                print(get_fed_maxwait())
                request_stop()
          =}
        }
        federated reactor {
          silent = new Silent()
          @maxwait(0)
          waits = new Waits()
          silent.out -> waits.inp
        }
        """
    )
    assert outcome.code == 0, outcome.err
    lines = [line.removeprefix("[waits] ") for line in outcome.out.splitlines()]
    assert lines == [
        "0",
        "30000000",
        "a maxwait cannot be negative, and -1 is",
        "a time is a number with a unit (ns, us, ms, s, min, h, d or week), such as "
        '"10 ms", and "x" is not',
        "a maxwait that has no end must be stated in the program: @maxwait(forever)",
        "0",
    ]


def test_stopping_the_whole(run: Any) -> None:
    outcome = run(
        """
        target Python { keepalive: true }
        main reactor {
          reaction(startup) {= lf.stop() =}
          reaction(shutdown) {= print(lf.tag().microstep) =}
        }
        """
    )
    assert (outcome.code, outcome.out) == (0, "1\n"), outcome.err
