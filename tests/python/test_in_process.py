"""Federates as threads of one process: what they share, and what each has for itself."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import runner
from processes import COORDINATIONS


@pytest.fixture(params=COORDINATIONS)
def threads(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    """Runs a program with federates that are threads."""
    command = [str(Path(sys.executable).with_name("hprm")), "run", "--in-process"]
    return runner([*command, f"--property=coordination={request.param}"], tmp_path)


def pair(
    value: str, body: str, clause: str = "", more: str = "", kept: str = "", preamble: str = ""
) -> str:
    """A program in which one federate sends VALUE twice, and another runs BODY with it as VALUE.

    The first one keeps KEPT, which is what it sends unless there is something else to keep.
    """
    return f"""\
target Python {{ timeout: 10 msec }}
preamble {{=
  import numpy as np
  import sys
  {preamble}
=}}
reactor Source {{
  output out
  timer t(0, 10 msec)
  state kept
  reaction(t) -> out {{=
    {more}
    self.kept = {kept or value}
    out.set({value if kept else "self.kept"})
  =}}
}}
reactor Sink {{
  input inp
  reaction(inp) {{=
    value = inp.value
    {body}
  =}}
}}
federated reactor {{
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp {clause}
}}
"""


def lines(outcome: Any, federate: str = "sink") -> list[str]:
    """What one federate has printed."""
    assert outcome.code == 0, outcome.err
    prefix = f"[{federate}] "
    said = outcome.out.splitlines()
    assert all(line.startswith("[") for line in said), said
    return [line.removeprefix(prefix) for line in said if line.startswith(prefix)]


def test_a_large_array_is_the_same_one_and_is_read_only(threads: Any) -> None:
    text = pair(
        "array",
        "print(value.ctypes.data, value.flags.writeable, int(value[-1]))",
        more="array = np.arange(1_000_000); print(array.ctypes.data)",
        kept="None",
    )
    outcome = threads(text)
    assert lines(outcome) == [f"{sent} False 999999" for sent in lines(outcome, "source")]


def test_what_an_array_is_a_view_of_becomes_read_only_too(threads: Any) -> None:
    body = "print(value.flags.writeable, len(memoryview(value.base)), value.base is not value)"
    text = pair("np.zeros(200_000)[10:]", body, kept="None")
    assert lines(threads(text)) == ["False 1600000 True"] * 2


# What a program may try with an array of numbers, so that it can write to it.
THAWS = [
    "value.flags.writeable = True; value[:] = 666",
    "value.setflags(write=True); value[:] = 666",
    "value[:].flags.writeable = True",
    "value.view(np.uint8).setflags(write=True)",
    "value.base.flags.writeable = True",
    "value.base[0] = 1",
    "memoryview(value)[0] = 666",
    "memoryview(value.base)[0] = 1",
    "memoryview(value).obj.base.flags.writeable = True",
    "np.frombuffer(value.base)[0] = 666",
    "np.asarray(memoryview(value.base)).flags.writeable = True",
    "np.ndarray(value.shape, value.dtype, value.base).flags.writeable = True",
    "np.lib.stride_tricks.as_strided(value, writeable=True)[0] = 666",
    "np.asarray(Like(value.__array_interface__))[0] = 666",
    "np.from_dlpack(value).flags.writeable = True",
    "(ctypes.c_double * 2).from_buffer(value)[0] = 666",
    "value.resize(5, refcheck=False)",
    "value.byteswap(inplace=True)",
    "np.copyto(value, 666, casting='unsafe')",
    "value.base.__init__()",
    "gc.get_referents(value.base)[-1].flags.writeable = True",
    "value.shape = (2, -1)",
    "value.dtype = np.uint8",
    "value.strides = (0,) * value.ndim",
    "value.data = bytearray(value.nbytes)",
    "value.__setstate__((1, (2,), np.dtype('i1'), False, b'ab'))",
]

TRY = f"""\
import ctypes, gc, warnings
  class Like:
      def __init__(self, interface): self.__array_interface__ = interface
  def thaw(value):
      warnings.simplefilter("ignore")
      for way in {THAWS!r}:
          try:
              exec(way)
          except Exception:
              pass
"""


@pytest.mark.parametrize(
    ("made", "sent"),
    [
        ("None", "np.zeros(100_000)"),
        ("None", "{'in': [np.zeros(100_000), (np.zeros(200_000)[1::2],)]}"),
        ("np.zeros(100_000)", "self.kept"),
        ("np.zeros(100_000)", "[self.kept[::-1]]"),
        ("np.zeros(10)", "self.kept"),
        ("None", "(np.zeros(10),)"),
    ],
)
def test_no_federate_can_make_what_is_shared_writeable_again(
    threads: Any, made: str, sent: str
) -> None:
    """Neither the receiver of an array can, nor the sender, which has frozen and kept it."""
    outcome = threads(f"""\
        target Python {{ timeout: 20 msec }}
        preamble {{=
          import numpy as np
          {TRY.replace(chr(10), chr(10) + "        ")}
          def arrays(value):
              if isinstance(value, np.ndarray):
                  return [value]
              within = value.values() if isinstance(value, dict) else value
              return [array for each in within for array in arrays(each)]
          def looks(value):
              return [(array.sum(), array.shape, array.dtype.str) for array in arrays(value)]
        =}}
        reactor Source {{
          output out
          input late
          timer again(10 msec)
          state kept = {{= {made} =}}
          reaction(startup) -> out {{=
            if self.kept is not None:
                self.kept.flags.writeable = False
            out.set({sent})
          =}}
          reaction(late) {{= [thaw(array) for array in arrays(late.value)] =}}
          reaction(again) {{=
            if self.kept is not None:
                thaw(self.kept)
          =}}
        }}
        reactor Thief {{
          input inp
          reaction(inp) {{= [thaw(array) for array in arrays(inp.value)] =}}
        }}
        reactor Sink {{
          input inp
          state value
          timer t(20 msec)
          reaction(inp) {{= self.value = inp.value; print(looks(self.value)) =}}
          reaction(t) {{= print(looks(self.value)) =}}
        }}
        federated reactor {{
          source = new Source()
          thief = new Thief()
          sink = new Sink()
          source.out -> thief.inp
          source.out -> sink.inp
          source.out -> source.late after 5 msec
        }}
    """)
    first, second = lines(outcome)
    assert first == second
    assert "(0.0, (" in first or "(np.float64(0.0), (" in first


def test_a_read_only_view_of_what_its_owner_writes_is_copied(threads: Any) -> None:
    text = pair(
        "np.frombuffer(memoryview(self.memory).toreadonly(), np.uint8)",
        "SEEN.append(value)\n    print([int(value.max()) for value in SEEN])",
        preamble="SEEN = []",
        more="self.memory = self.memory or bytearray(100_000)\n    self.memory[5] += 1",
        kept="0",
    ).replace("  timer t", "  state memory\n  timer t", 1)
    assert lines(threads(text)) == ["[1]", "[1, 2]"]


def test_a_receiver_may_give_fields_other_names(threads: Any) -> None:
    text = pair(
        "np.zeros(10_000, [('a', 'f8'), ('in', [('b', 'f8')])])",
        "print(value.dtype.names, value.dtype['in'].names)\n"
        "    value.dtype.names = ('p', 'in'); value.dtype['in'].names = ('q',)",
        kept="None",
    )
    text = text.replace(
        "source.out -> sink.inp",
        "two = new Sink()\n  source.out -> two.inp\n  source.out -> sink.inp",
    )
    outcome = threads(text)
    assert lines(outcome) == lines(outcome, "two") == ["('a', 'in') ('b',)"] * 2


def test_a_read_only_array_is_shared_though_it_is_kept(threads: Any) -> None:
    text = pair(
        "array if self.kept is None else self.kept",
        "print(value.ctypes.data)",
        more="array = np.zeros(100_000)\n    array.flags.writeable = False\n"
        "    print((array if self.kept is None else self.kept).ctypes.data)",
    )
    outcome = threads(text)
    first, second = lines(outcome)
    assert lines(outcome, "source") == [first, second]
    assert first == second


IMAGES = {
    "an array": ("np.zeros(100_000)", "self.kept"),
    "a view of what was sent": ("np.zeros(100_000)", "self.kept[::-1]"),
    "what was sent is another view": ("np.zeros(100_000).reshape(100, -1)", "self.kept[::-1]"),
    "an array in a list": ("np.zeros(100_000)", "[self.kept][0]"),
    "a buffer": ("memoryview(np.zeros(100_000))", "np.asarray(self.kept)"),
}


@pytest.mark.parametrize("kept", IMAGES)
def test_a_federate_that_keeps_an_array_may_go_on_writing_to_it(threads: Any, kept: str) -> None:
    make, sent = IMAGES[kept]
    text = pair(
        sent,
        "SEEN.append(value)\n    print([set(value.ravel().tolist()) for value in SEEN])",
        preamble="SEEN = []",
        more=f"self.kept = {make} if self.kept is None else self.kept\n"
        "    np.asarray(self.kept)[:] += 1",
        kept="self.kept",
    )
    # The last line of the first reader shows what has become of what it got first.
    assert lines(threads(text)) == ["[{1.0}]", "[{1.0}, {2.0}]"]


def test_an_array_over_foreign_memory_is_copied(threads: Any) -> None:
    text = pair(
        "np.frombuffer(self.memory, np.uint8)",
        "print(value[0], value.flags.writeable)",
        more="self.memory = bytearray(100_000)",
    )
    # After the reaction has ended, so that only a copy keeps what was sent.
    text = text.replace("-> out {=", "-> out {=\n    if self.memory: self.memory[0] = 9").replace(
        "  timer t", "  state memory\n  timer t", 1
    )
    assert lines(threads(text)) == ["0 False"] * 2


def test_a_small_array_is_copied_so_its_owner_may_go_on(threads: Any) -> None:
    text = pair("self.kept", "print(value.tolist(), value.flags.writeable)")
    text = text.replace("self.kept = self.kept", "self.kept += 1")
    text = text.replace("state kept", "state kept = {= np.zeros(2) =}")
    assert lines(threads(text)) == ["[1.0, 1.0] False", "[2.0, 2.0] False"]


def test_containers_are_the_receivers_own_and_their_arrays_are_shared(threads: Any) -> None:
    text = pair(
        "{'list': small, 'tuple': (big, [2]), 'bytes': bytearray(b'x')}",
        "print(value['list'], value['tuple'][1], value['bytes'], value['tuple'][0].ctypes.data)\n"
        "    value['list'].append(3); value['tuple'][1].clear(); value['bytes'].clear()",
        more="small, big = [1], np.zeros(100_000)\n    print(big.ctypes.data, self.kept)",
        kept="small",
    )
    outcome = threads(text)
    (first, kept), (second, after) = (said.split(" ", 1) for said in lines(outcome, "source"))
    assert (kept, after) == ("None", "[1]")
    assert lines(outcome) == [f"[1] [2] bytearray(b'x') {big}" for big in (first, second)]


CIRCLE = """
    def circle():
        twin = []
        value = [([],), 7, twin, twin]
        value[0][0].append(value)
        return value
"""


def test_what_refers_to_itself_arrives_as_it_was(threads: Any) -> None:
    text = pair(
        "circle()",
        "print(value is value[0][0][0], value[2] is value[3], value[1])",
        preamble="from circle import circle",
    )
    assert lines(threads(text, circle_dot_py=CIRCLE)) == ["True True 7"] * 2


def test_two_receivers_do_not_see_what_the_other_does(threads: Any) -> None:
    text = pair("[0]", "value.append(1)\n    print(value)").replace(
        "source.out -> sink.inp",
        "other = new Sink()\n  source.out, source.out -> sink.inp, other.inp",
    )
    outcome = threads(text)
    assert lines(outcome) == lines(outcome, "other") == ["[0, 1]"] * 2


POINT = """\
class Point:
      latest = None

      def __init__(self, x):
          self.x = x
          Point.latest = self
"""


def test_an_object_becomes_one_of_the_receivers_class(threads: Any) -> None:
    body = "print(type(value) is Point, value.x, value is Point.latest, Point.latest)"
    text = pair("Point(7)", body, preamble=POINT)
    assert lines(threads(text)) == ["True 7 False None"] * 2


def test_an_immutable_value_is_handed_over(threads: Any) -> None:
    preamble = "import datetime, decimal"
    value = "[decimal.Decimal('1.50'), datetime.datetime(2026, 1, 1), 1j, range(3)]"
    more = f"sys.sent = sys.__dict__.get('sent') or {value}"
    body = "print(value, all(one is other for one, other in zip(value, sys.sent)))"
    expected = "[Decimal('1.50'), datetime.datetime(2026, 1, 1, 0, 0), 1j, range(0, 3)] True"
    text = pair("sys.sent", body, preamble=preamble, more=more)
    assert lines(threads(text)) == [expected] * 2


def test_a_named_serializer_is_called(threads: Any) -> None:
    outcome = threads(
        pair("(1, 2)", "print(value)", clause='serializer "as_json"'),
        as_json_dot_py="""\
            import json

            class Serializer:
                def serialize(self, value):
                    return json.dumps(value).encode()

                def deserialize(self, data):
                    return json.loads(data)
        """,
    )
    assert lines(outcome) == ["[1, 2]"] * 2


def test_a_value_that_cannot_be_sent_is_named(threads: Any) -> None:
    outcome = threads(pair("(x for x in [])", "pass"))
    assert outcome.code == 1
    assert "sending a value on connection Program.source.out -> Program.sink.inp" in outcome.err


def test_each_federate_has_its_own_preamble_and_its_own_lf(threads: Any) -> None:
    text = pair(
        "1",
        "import __main__, LinguaFrancaProgram\n    loaded.append('sink')\n"
        "    print(loaded, __main__.loaded is loaded, LinguaFrancaProgram.tag() == lf.tag())",
        preamble="loaded = []",
        more="loaded.append('source')",
    )
    assert lines(threads(text)) == [
        "['sink'] True True",
        "['sink', 'sink'] True True",
    ]


def test_a_module_that_is_imported_is_one_for_all(threads: Any) -> None:
    outcome = threads(
        pair("1", "print(shared.seen)", preamble="import shared", more="shared.seen.append(1)"),
        shared_dot_py="seen = []\n",
    )
    assert lines(outcome)[-1] == "[1, 1]"


def test_workers_belong_to_their_federates(tmp_path: Path) -> None:
    command = [str(Path(sys.executable).with_name("hprm")), "run", "--in-process", "--workers=3"]
    body = "print(__import__('__main__').loaded is loaded)"
    text = pair("1", body, preamble="loaded = []").replace(
        "sink = new Sink()", "sink = new Several()"
    )
    several = "reactor Several {\n  input inp\n  s = new[4] Sink()\n  (inp)+ -> s.inp\n}\n"
    outcome = runner(command, tmp_path)(text.replace("federated", several + "federated"))
    assert lines(outcome) == ["True"] * 8


def test_output_without_an_end_is_shown(threads: Any) -> None:
    text = pair("1", "print('a', end=''); print('b', end='')")
    assert lines(threads(text)) == ["abab"]


def test_arguments_reach_the_program(threads: Any) -> None:
    outcome = threads(pair("1", "print(sys.argv[1:])"), "--", "--rounds", "3")
    assert lines(outcome) == ["['--rounds', '3']"] * 2


def test_a_program_without_federates_runs_as_ever(threads: Any) -> None:
    outcome = threads("target Python\nmain reactor {\n  reaction(startup) {= print(1) =}\n}\n")
    assert (outcome.code, outcome.out) == (0, "1\n")


def test_transient_federates_are_refused(threads: Any) -> None:
    outcome = threads(pair("1", "pass").replace("  sink = new", "  @transient\n  sink = new"))
    assert outcome.code == 1
    assert outcome.err.startswith("error: federate sink is transient")
    assert "hint: run the program without --in-process" in outcome.err


def test_no_process_can_join_threads(threads: Any) -> None:
    outcome = threads(pair("1", "lf.get_federation_id()"))
    assert outcome.code == 1
    assert "federates that are threads form a federation that no process can join" in outcome.err


def test_what_a_thread_of_the_program_schedules_arrives(threads: Any) -> None:
    outcome = threads("""\
        target Python { keepalive: true }
        preamble {=
          import threading
        =}
        reactor Source {
          physical action came
          output out
          reaction(startup) -> came {=
            threading.Thread(target=came.schedule, args=(0, "hello")).start()
          =}
          reaction(came) -> out {=
            out.set(came.value)
            lf.request_stop()
          =}
        }
        reactor Sink {
          input inp
          reaction(inp) {= print(inp.value, inp.physical_time_of_arrival > 0) =}
        }
        federated reactor {
          source = new Source()
          sink = new Sink()
          source.out -> sink.inp
        }
    """)
    assert lines(outcome) == ["hello True"]


def test_a_thread_belongs_to_the_federate_that_has_started_it(threads: Any) -> None:
    outcome = threads("""\
        target Python
        preamble {=
          import threading
          class Named(threading.Thread):
              def run(self):
                  import __main__
                  print(__main__.who, self.run.__name__)
        =}
        reactor Part {
          reaction(startup) {=
            global who
            who = f"part {self.bank_index}"
            inner = lambda: threading.Thread(target=print, args=("inner",)).start()
            for thread in (Named(), threading.Thread(target=inner)):
                thread.start()
                thread.join()
          =}
        }
        federated reactor { part = new[2] Part() }
    """)
    assert (outcome.code, outcome.err) == (0, "")
    said = sorted(outcome.out.splitlines())
    assert said == [f"[part__{n}] {line}" for n in "01" for line in ("inner", f"part {n} run")]


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_every_federate_may_use_other_processes(threads: Any, method: str) -> None:
    outcome = threads(f"""\
        target Python
        preamble {{=
          import multiprocessing
          from concurrent.futures import ProcessPoolExecutor
          def doubled(number): return 2 * number
        =}}
        reactor Part {{
          reaction(startup) {{=
            context = multiprocessing.get_context("{method}")
            with ProcessPoolExecutor(1, mp_context=context) as executor:
                print(executor.submit(doubled, 4).result())
          =}}
        }}
        federated reactor {{ part = new[2] Part() }}
    """)
    assert (outcome.code, outcome.err) == (0, "")
    assert sorted(outcome.out.splitlines()) == ["[part__0] 8", "[part__1] 8"]
