"""Whole programs: scoping, parameters, instances, errors, and how they end."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest


def printed(outcome: Any) -> list[str]:
    assert outcome.code == 0, outcome.err
    return outcome.out.splitlines()


def test_parameters_are_evaluated_in_the_container(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python
            reactor Leaf(value = 0, twice = {= [0, bank_index] =}, wait = 20 ms) {
              state doubled = {= 2 * self.value =}
              state items = [1, {= self.wait =}, value]
              reaction(startup) {=
                self.twice.append(1)
                print(self.bank_index, self.value, self.doubled, self.items, self.twice)
              =}
            }
            reactor Middle(table = [7, 8]) {
              leaf = new[2] Leaf(value = {= self.table[bank_index] =})
            }
            main reactor(table = [[1, 2], [3, 4]]) {
              m = new[2] Middle(table = {= self.table[bank_index] =})
              last = new Leaf(
                value = {= max(  # of two rows
                    self.table)[0] =}
              )
            }
            """
        )
    )
    assert lines == [
        "0 1 2 [1, 20000000, 1] [0, 0, 1]",
        "1 2 4 [1, 20000000, 2] [0, 1, 1]",
        "0 3 6 [1, 20000000, 3] [0, 0, 1]",
        "1 4 8 [1, 20000000, 4] [0, 1, 1]",
        "0 3 6 [1, 20000000, 3] [0, 0, 1]",
    ]


def test_an_explicit_bank_index_wins(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python
            reactor A(bank_index = 0) { reaction(startup) {= print(self.bank_index) =} }
            main reactor { a = new[2] A()  b = new[2] A(bank_index = 9) }
            """
        )
    )
    assert lines == ["0", "1", "9", "9"]


def test_preambles_and_methods(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python { files: "lib" }
            preamble {=
              import helper
              total = 0
              def add(n):
                  global total
                  total += n
                  return total
            =}
            reactor A {
              preamble {=
                import math
                def root(self, x):
                    return self.math.isqrt(x)
              =}
              state n = 1
              method up(by) {=
                self.n += by
                return self.n
              =}
              reaction(startup) {=
                print(add(2), self.root(17), self.up(4), helper.NAME)
              =}
              reaction(shutdown) {=
                global total
                total *= 10
                print(total)
              =}
            }
            main reactor { a = new A() }
            """,
            helper_dot_py="NAME = 'beside'",
        )
    )
    assert lines == ["2 4 5 beside", "20"]


def test_read_only_parameters_and_undeclared_names(run: Any) -> None:
    outcome = run(
        """
        target Python
        main reactor(p = 3) { reaction(startup) {= self.p = 4 =} }
        """
    )
    assert outcome.code == 1
    assert "AttributeError" in outcome.err


def test_contained_instances_banks_and_multiports(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python
            reactor Gain { input x  input[2] w  output y
              reaction(x) w -> y {= y.set(x.value * sum(p.value for p in w)) =}
            }
            main reactor {
              g = new Gain()
              bank = new[3] Gain()
              reaction(startup) -> g.x, g.w, bank.x, bank.w {=
                g_x.set(2)
                for channel in g.w: channel.set(10)
                for i, member in enumerate(bank):
                    member.x.set(i)
                    member.w[0].set(1); member.w[1].set(2)
              =}
              reaction(g.y, bank.y) {=
                print(g.y.value, g_y.value, len(bank), [b.y.value for b in bank], bank[-1].y.value)
                try: g.x
                except AttributeError as error: print(error)
                try: g.y = 3
                except AttributeError as error: print(error)
              =}
            }
            """
        )
    )
    assert lines == [
        "40 40 3 [0, 3, 6] 6",
        "g.x is not a trigger, source or effect of this reaction",
        "a port is set by its method: g.y.set(...)",
    ]


def test_values_pass_by_reference_unless_mutable(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python { timeout: 1 s, fast: true }
            preamble {= import numpy as np =}
            reactor Source { output out  output[2] many
              timer t(0, 600 ms)
              state data = {= [np.zeros(3), [0]] =}
              reaction(t) -> out, many {= out.set(self.data); many[1].set(self.data[0]) =}
            }
            reactor Sink { input same
              mutable input inp
              mutable input[2] all
              reaction(same, inp, all) {=
                assert inp.is_present and inp.value is not same.value
                inp.value[0][0] += 1; inp.value[1].append(5)
                all[1].value[2] = 9
                print(all[0].is_present, all[0].value, same.value[0].tolist(), same.value[1])
              =}
            }
            main reactor {
              s = new Source()  k = new Sink()
              s.out, s.out -> k.same, k.inp
              s.many -> k.all
            }
            """
        )
    )
    assert lines == ["False None [0.0, 0.0, 0.0] [0]"] * 2


def test_actions_pile_up_and_carry_values(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python { fast: true }
            main reactor {
              logical action a(10 ms)
              reaction(startup) -> a {=
                a.schedule(0, "first"); a.schedule(0); a.schedule(MSEC(0.5), None)
              =}
              reaction(a) {=
                print(a.is_present, a.value, lf.time.logical_elapsed(), lf.tag().microstep)
              =}
            }
            """
        )
    )
    assert lines == [
        "True first 10000000 0",
        "True None 10000000 1",
        "True None 10500000 0",
    ]


def test_deadline_handlers(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python { timeout: 1 ms, fast: true }
            preamble {= import time =}
            main reactor {
              timer t(0)
              output_of = new Sink()
              reaction(t) -> output_of.x {= print("body") =} deadline(0) {=
                print("late"); output_of.x.set(4)
              =}
              reaction(t) {=
                print(self.check_deadline(False))
                until = time.monotonic() + 0.03
                while time.monotonic() < until: pass
                print(self.check_deadline())
              =} deadline(20 ms) {= print("handled") =}
            }
            reactor Sink { input x  reaction(x) {= print(x.value) =} }
            """
        )
    )
    assert lines[0] == "late"
    assert sorted(lines[1:]) == sorted(["4", "False", "handled", "True"])


def test_a_deadline_can_be_changed_while_its_reaction_runs(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python { timeout: 2 ms, fast: true }
            main reactor {
              timer t(0, 1 ms)
              reaction(t) {=
                print("body", self.check_deadline())
                self.update_deadline(SEC(0))
                print(self.check_deadline())
                lf.update_deadline(self, 0)
              =} deadline(1 hour) {= print("handler", lf.time.logical_elapsed()) =}
              reaction(shutdown) {=
                print(self.check_deadline())
                try:
                  self.update_deadline(-1)
                except ValueError as error:
                  print(error)
              =}
            }
            """
        )
    )
    assert lines == [
        "body False",
        "handler 0",
        "True",
        "handler 1000000",
        "handler 2000000",
        "False",
        "a deadline cannot be negative, and -1 is",
    ]


def test_a_single_threaded_program_runs_the_tightest_deadline_first(run: Any) -> None:
    program = """
    target Python {{ {} }}
    reactor Lax {{ reaction(startup) {{= print("lax") =}} }}
    reactor Source {{ output out  reaction(startup) -> out {{= print("source"); out.set(1) =}} }}
    reactor Sink {{ input inp  reaction(inp) {{= print("sink") =}} deadline(1 hour) {{= =}} }}
    main reactor {{
      lax = new Lax() source = new Source() sink = new Sink()
      source.out -> sink.inp
    }}
    """
    assert printed(run(program.format(""))) == ["lax", "source", "sink"]
    single = run(program.format("single-threaded: true"))
    assert printed(single) == ["source", "sink", "lax"]


def test_classes_of_a_program_can_be_pickled(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python
            preamble {=
              import pickle
              class Point:
                  def __init__(self, x): self.x = x
            =}
            main reactor {
              reaction(startup) {=
                point = pickle.loads(pickle.dumps(Point(3)))
                print(point.x, sys.modules["__main__"].Point is Point)
              =}
            }
            """
        )
    )
    assert lines == ["3 True"]


def test_an_exception_names_the_line_of_the_lf_file(run: Any) -> None:
    outcome = run(
        """\
        target Python
        preamble {=
          def fail(x):
              return 1 / x
        =}
        reactor A {
          reaction(startup) {=

            # a comment
            text = '''
              a string =} over lines
            '''
            if len(text) > 3:
                fail(0)
          =}
        }
        main reactor { a = new[2] A() }
        """
    )
    assert outcome.code == 1
    lines = outcome.err.splitlines()
    assert lines[0] == "error: reaction Program.a[0].1 raised ZeroDivisionError: division by zero"
    assert lines[1] == "  --> Program.lf:4"
    assert '  File "Program.lf", line 14, in reaction_function_0' in lines
    assert "    fail(0)" in lines
    assert '  File "Program.lf", line 4, in fail' in lines
    assert not any("hprm" in line for line in lines)


def test_carets_point_into_the_lf_file(run: Any) -> None:
    outcome = run(
        """\
        target Python
        main reactor {
          reaction(startup) {=
              x = {}
              y = 1 + x["missing"] + 2
          =}
        }
        """
    )
    lines = outcome.err.splitlines()
    at = lines.index('    y = 1 + x["missing"] + 2')
    # Older interpreters print no carets; the line they print is right all the same.
    if lines[at + 1].strip().startswith(("~", "^")):
        assert lines[at + 1] == "            ~^^^^^^^^^^^"


def test_a_chain_of_exceptions_is_shown(run: Any) -> None:
    outcome = run(
        """
        target Python
        main reactor {
          reaction(startup) {=
            try: {}["k"]
            except KeyError as error: raise RuntimeError("wrapped") from error
          =}
        }
        """
    )
    assert "RuntimeError: wrapped" in outcome.err.splitlines()[0]
    assert "KeyError: 'k'" in outcome.err
    assert "direct cause" in outcome.err


def test_a_syntax_error_shows_the_line(run: Any) -> None:
    outcome = run(
        """\
        target Python
        main reactor {
          reaction(startup) {=
            x = 1
            if x ==:
                pass
          =}
        }
        """
    )
    assert outcome.code == 1
    lines = outcome.err.splitlines()
    assert lines[0] == "error[LF1001]: invalid syntax"
    assert lines[1].endswith("--> Program.lf:5:12")
    assert lines[3] == "5 |     if x ==:"
    assert lines[4].index("^") == lines[3].index("==:") + 2


@pytest.mark.parametrize(("start", "beside"), [("{= x = 1", True), ("{=\n  x = 1", False)])
def test_a_body_that_begins_beside_its_brace_is_helped(run: Any, start: str, beside: bool) -> None:
    outcome = run(f"target Python\nmain reactor {{ reaction(startup) {start}\n    x = 2\n=}} }}\n")
    assert outcome.code == 1
    hint = ": the first line stands beside `{=`; put it on a line of its own"
    assert outcome.err.startswith(
        "error[LF1001]: unexpected indent" + (hint if beside else "") + "\n"
    )


def test_a_syntax_error_that_only_the_compiler_finds(run: Any) -> None:
    outcome = run(
        """\
        target Python
        main reactor(p = {= yield 3 =}) {
          reaction(startup) {= break =}
        }
        """
    )
    assert outcome.code == 1
    assert "Program.lf:" in outcome.err


def test_a_failing_preamble_is_named(run: Any) -> None:
    outcome = run(
        """\
        target Python
        preamble {= import nowhere_to_be_found =}
        main reactor { reaction(startup) {= =} }
        """
    )
    assert outcome.code == 1
    lines = outcome.err.splitlines()
    assert lines[0].startswith("error: loading Program raised ModuleNotFoundError")
    assert lines[1] == "  --> Program.lf:2"


def body(statement: str) -> str:
    return f"target Python\nmain reactor {{ reaction(startup) {{= {statement} =}} }}\n"


def test_exit_codes(run: Any) -> None:
    assert run(body("pass")).code == 0
    for statement, code, err in [
        ("sys.exit(3)", 3, ""),
        ("exit(0)", 0, ""),
        ("sys.exit()", 0, ""),
        ("sys.exit('reason')", 1, "reason\n"),
        ("raise KeyboardInterrupt", 130, ""),
        ("os._exit(5)", 5, ""),
    ]:
        outcome = run(body(statement))
        assert (outcome.code, outcome.err) == (code, err), statement


def test_daemons_do_not_keep_a_program_alive(run: Any) -> None:
    outcome = run(
        """
        target Python
        preamble {=
          import atexit, threading
          atexit.register(print, "exit handler")
        =}
        main reactor {
          reaction(startup) {=
            threading.Thread(target=threading.Event().wait, daemon=True).start()
            print("no newline", end="")
          =}
        }
        """
    )
    assert outcome.code == 0, outcome.err
    assert outcome.out == "no newlineexit handler\n"


def test_arguments_reach_the_program(run: Any) -> None:
    outcome = run(body("print(sys.argv)"), "--rounds", "3", "x")
    assert printed(outcome) == ["['Program.lf', '--rounds', '3', 'x']"]


def test_request_stop_runs_shutdown_at_the_next_microstep(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python
            main reactor {
              timer t(0, 1 s)
              logical action a
              reaction(t) -> a {= request_stop(); a.schedule(0, 1); a.schedule(1, 2) =}
              reaction(a) {= print("a", a.value) =}
              reaction(shutdown) {= print(lf.tag().microstep, lf.time.logical_elapsed()) =}
            }
            """
        )
    )
    assert lines == ["a 1", "1 0"]


def test_an_error_in_the_program_is_a_diagnostic(run: Any) -> None:
    outcome = run("target Python\nmain reactor { a = new Missing() }\n")
    assert outcome.code == 1
    assert "Missing" in outcome.err
    assert "Program.lf:2" in outcome.err
    assert "Traceback" not in outcome.err


def test_a_federated_program_runs_in_one_process(run: Any) -> None:
    lines = printed(
        run(
            """
            target Python { timeout: 10 ms, coordination: decentralized }
            reactor A { output out  reaction(startup) -> out {= out.set([1]) =} }
            reactor B { input inp  reaction(inp) {= print(inp.value, self.bank_index) =} }
            federated reactor { a = new A()  b = new[2] B()  (a.out)+ -> b.inp after 1 ms }
            """
        )
    )
    assert lines == ["[1] 0", "[1] 1"]


PAIR = """
target Python {{ coordination: {coordination} }}
preamble {{=
  import numpy as np
  class Frame:
      def __init__(self, number, pixels): self.number, self.pixels = number, pixels
=}}
reactor Camera {{ output out
  reaction(startup) -> out {{= out.set({value}) =}}
}}
reactor Viewer {{ input inp
  reaction(inp) {{=
    {body}
    request_stop()
  =}}
}}
federated reactor {{
  camera = new Camera()
  viewer = new Viewer()
  camera.out -> viewer.inp {clause}
}}
"""


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
def test_objects_of_the_program_travel_with_their_arrays_in_place(
    launch: Any, coordination: str
) -> None:
    text = PAIR.format(
        coordination=coordination,
        value="Frame(7, np.arange(20_000.0)[::-1])",
        body=(
            "pixels = inp.value.pixels; "
            "print(inp.value.number, pixels[0], pixels.flags.writeable, pixels.flags.owndata, "
            "inp.value is inp.value, inp.physical_time_of_arrival > lf.time.start())"
        ),
        clause="",
    )
    assert printed(launch(text)) == ["[viewer] 7 19999.0 False False True True"]


SERIALIZER = """
import json
class Serializer:
    def serialize(self, obj): return bytearray(json.dumps(obj).encode())
    def deserialize(self, data):
        assert type(data) is bytes
        return json.loads(data)
"""


@pytest.mark.parametrize("length", [1, 100_000])
def test_a_program_brings_its_own_serializer(launch: Any, length: int) -> None:
    text = PAIR.format(
        coordination="decentralized",
        value=f"('tuple', 'x' * {length})",
        body="print(type(inp.value).__name__, len(inp.value[1]))",
        clause='serializer "as_json"',
    )
    outcome = launch(text, as_json_dot_py=SERIALIZER)
    assert printed(outcome) == [f"[viewer] list {length}"]


def test_a_missing_serializer_is_named(launch: Any) -> None:
    text = PAIR.format(
        coordination="centralized", value="1", body="pass", clause='serializer "nowhere"'
    )
    outcome = launch(text)
    assert outcome.code == 1
    assert 'loading the serializer "nowhere"' in outcome.err
    assert "Program.camera.out -> Program.viewer.inp" in outcome.err


def test_a_value_that_cannot_travel_is_named_with_its_connection(launch: Any) -> None:
    text = PAIR.format(coordination="centralized", value="lambda: 1", body="pass", clause="")
    outcome = launch(text)
    assert outcome.code == 1
    assert "sending a value on connection Program.camera.out -> Program.viewer.inp" in outcome.err


def test_interrupting_a_program_ends_it_in_order(tmp_path: Path) -> None:
    program = tmp_path / "Program.lf"
    program.write_text(
        """
        target Python { keepalive: true }
        main reactor {
          reaction(startup) {= print("ready", flush=True) =}
          reaction(shutdown) {= print("in order") =}
        }
        """
    )
    command = [sys.executable, "-m", "hprm", "run", str(program)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, b"in order\n", b"")


def test_a_body_that_would_never_run_is_an_error(run: Any) -> None:
    outcome = run(
        """
        target Python
        main reactor {
            reaction(startup) {=
                print("before")
                yield 3
            =}
        }
        """
    )
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith("error[LF1001]: `yield` makes a generator of this body")
    assert "Program.lf:6:9" in outcome.err
