"""Ways to make a value; for each it is known whether its arrays are published without a copy.

A scenario is a function in the text of a program. It gets a number, returns a value that has it in
all elements of its arrays, and may keep what it likes in ``keep``. At the next tag, everything that
was kept and can be written to is overwritten: no receiver may see that.
"""

from __future__ import annotations

# `moved` and `copied` say of a scenario what is expected.
COMMON = """
import asyncio, copy, sysconfig, threading, weakref
import numpy as np
import hprm

FREE_THREADED = bool(sysconfig.get_config_var("Py_GIL_DISABLED"))

N = 50_000
keep = []
expected = {}

def scenario(outcome):
    def enter(function):
        expected[function] = outcome
        return function
    return enter

def full(number):
    return np.full(N, number, dtype=np.float64)

moved, copied = scenario("moved"), scenario("copied")
"""

CHECKS = """
def attributes(value):
    "What an object of a class of the program has."
    names = {}
    for kind in type(value).__mro__:
        slots = vars(kind).get("__slots__", ())
        names |= dict.fromkeys([slots] if isinstance(slots, str) else slots)
    names |= getattr(value, "__dict__", {})
    return [getattr(value, name) for name in names if hasattr(value, name)]

def is_object(value):
    return type(value).__module__ == "__main__" and not isinstance(value, (np.ndarray, tuple))

def overwrite(what):
    if isinstance(what, weakref.ref):
        what = what()
    if isinstance(what, list | tuple) and what and isinstance(what[0], threading.Event):
        what[0].set()
        what[1].wait()
    elif isinstance(what, list | tuple):
        for member in list(what):
            overwrite(member)
    elif isinstance(what, np.ndarray | np.flatiter):
        what[:] = -1
    elif isinstance(what, memoryview):
        np.asarray(what)[:] = -1
    elif is_object(what):
        overwrite(attributes(what))
    elif callable(what):
        overwrite(what())
    elif hasattr(what, "__next__") and not hasattr(what, "send"):
        overwrite(list(what))
    elif hasattr(what, "send"):
        next(what)
    elif hasattr(what, "contents"):
        for at in range(N):
            what[at] = -1
    elif what is not None and not isinstance(what, str | float):
        for at in range(len(what)):
            what[at] = -1

def arrays(value):
    if isinstance(value, dict):
        value = list(value.values())
    elif is_object(value):
        value = attributes(value)
    if isinstance(value, list | tuple):
        for member in value:
            yield from arrays(member)
    elif isinstance(value, np.ndarray):
        yield value
"""

PROGRAM = """\
target Python {{ coordination: {coordination} }}
preamble {{=
{scenarios}
=}}
reactor Source {{
  output out
  logical action next(1 msec)
  state number = 0
  state before = 0
  state wrong = {{= [] =}}
  reaction(startup, next) -> out, next {{=
    scenarios = list(expected)
    copied = lf.store_stats()["bytes_copied"]
    if self.number > 0:
        last = scenarios[self.number - 1]
        was = "moved" if copied == self.before else "copied"
        if was != expected[last]:
            self.wrong.append((last.__name__, was))
        overwrite(keep)
        keep.clear()
    self.before = copied
    if self.number == len(scenarios):
        print(self.wrong)
        request_stop()
        return
    out.set(scenarios[self.number](self.number))
    self.number += 1
    next.schedule(0)
  =}}
}}
reactor Sink {{
  input inp
  state seen = {{= [] =}}
  reaction(inp) {{= self.seen.append(inp.value) =}}
  reaction(shutdown) {{=
    names = [scenario.__name__ for scenario in expected]
    changed = []
    for number, value in enumerate(self.seen):
        for array in arrays(value):
            if array.dtype.names:
                array = array["y"]
            if not (array == number).all():
                changed.append(names[number])
    print(len(self.seen) == len(names), changed)
  =}}
}}
federated reactor {{
  source = new Source()
  sink = new[2] Sink()
  (source.out)+ -> sink.inp
}}
"""


def program(scenarios: str, coordination: str) -> str:
    """The text of a program that goes through scenarios, for two receivers."""
    return PROGRAM.format(coordination=coordination, scenarios=COMMON + scenarios + CHECKS)


# What the program writes if everything is as expected.
EXPECTED = ["[sink__0] True []", "[sink__1] True []", "[source] []"]
