"""Programs whose bodies are Python functions: ports, actions and modes as attributes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from declaring import Script, line_of, ok, runner


@pytest.fixture
def script(tmp_path: Path) -> Script:
    return runner(tmp_path)


def test_ports_are_attributes_of_their_reactors(script: Script) -> None:
    out = ok(
        script(
            """
            class Source(Reactor):
                ports = ("output x", "output[2] many")
                reactions = ({"name": "begin", "triggers": ["startup"], "effects": ["x", "many"]},)
                def begin(self):
                    self.x.set(3)
                    self.many[1].set("one")
                    print(self.x.value, self.x.is_present, self.many.width, repr(self.many[1]))

            class Sink(Reactor):
                ports = ("input x", "input y", "input[2] many")
                reactions = (
                    {"name": "first", "triggers": ["x"], "sources": ["y"]},
                    {"name": "second", "triggers": ["x", "many"]},
                )
                def first(self):
                    print("first", self.x.value, self.y.is_present, self.y.get(), self.y.get(7))
                def second(self):
                    print("second", self.x.get(0), [it.get() for it in self.many], len(self.many))
                    print(self.many.is_present, self.many[0].is_present, repr(self.x))

            class Main(Reactor):
                connections = (("source.x", "sink.x"), ("source.many", "sink.many"))
                def __init__(self):
                    self.source, self.sink = Source(), Sink()

            go(Main())
            """
        )
    )
    assert out.splitlines() == [
        "3 True 2 <port many[1]>",
        "first 3 False None 7",
        "second 3 [None, 'one'] 2",
        "True False <port x>",
    ]


MISUSE = """
class Other(Reactor):
    ports = ("input inp", "output out")
    reactions = ({"name": "react", "triggers": ["inp"], "effects": ["out"]},)
    def react(self):
        pass

class Main(Reactor):
    ports = ("input a", "input b", "output out")
    actions = ({"name": "act"}, {"name": "phy", "physical": True})
    modes = ("Calm", "Busy")
    types = {"out": (int, float), "act": str}
    reactions = (
        {"name": "go", "triggers": ["startup"], "effects": ["out"]},
        {"name": "rest", "triggers": ["b", "act", "phy"], "mode": 0,
         "sources": ["a", "right.out"], "effects": ["act", "left.inp", "Busy"]},
    )
    def __init__(self):
        self.left, self.right = Other(), Other()
    def go(self):
        self.out.set(1)
        try:
            %s
        except Exception as error:
            print(f"{type(error).__name__}: {error}")
    def rest(self):
        pass

class Top(Reactor):
    connections = (("main.out", "main.a"), ("main.out", "main.b"))
    def __init__(self):
        self.main = Main()

go(Top(), timeout={"time": 2 * MS})
"""


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        (
            "self.a.value",
            "RuntimeError: reaction Top.main.go reads port a, which it does not declare: "
            "add it to its triggers or to sources=[...]",
        ),
        ("self.b.is_present", "RuntimeError: reaction Top.main.go reads port b, which it does not"),
        ("self.a.get()", "RuntimeError: reaction Top.main.go reads port a, which it does not"),
        (
            "self.left.inp.set(1)",
            "RuntimeError: reaction Top.main.go sets port left.inp, which it does not declare: "
            "add it to effects=[...]",
        ),
        (
            "self.right.out.value",
            "RuntimeError: reaction Top.main.go reads port right.out, which it does not declare: "
            "add it to its triggers or to sources=[...]",
        ),
        (
            "self.a.set(1)",
            "TypeError: reaction Top.main.go sets port a, which is an input: only a connection or "
            "its container sets it",
        ),
        (
            "self.right.out.set(1)",
            "TypeError: reaction Top.main.go sets port right.out, which is an output of right: "
            "only that sets it",
        ),
        (
            "self.out.set('x')",
            "TypeError: port out accepts int or float, and reaction Top.main.go gives it a value "
            "of type str",
        ),
        (
            "self.act.schedule(0, 'x')",
            "RuntimeError: reaction Top.main.go schedules action act, which it does not declare as "
            "an effect: add it to effects=[...]",
        ),
        (
            "self.act.schedule(0, 3)",
            "TypeError: action act accepts str, and reaction Top.main.go gives it a value of type "
            "int",
        ),
        (
            "self.act.value",
            "RuntimeError: reaction Top.main.go reads action act, which it does not declare: "
            "add it to its triggers or to sources=[...]",
        ),
        (
            "self.Busy.enter()",
            "RuntimeError: reaction Top.main.go enters mode Busy, which it does not declare: "
            "add it to effects=[...]",
        ),
        ("self.Busy.set()", "RuntimeError: reaction Top.main.go enters mode Busy, which"),
        ("self.out.value = 3", "AttributeError: a port is set by its method: out.set(...)"),
        ("self.phy.schedule('1 ms'); print('fine')", "fine"),
    ],
)
def test_a_reaction_uses_what_it_declares(script: Script, statement: str, message: str) -> None:
    out = ok(script(MISUSE % statement))
    assert out.splitlines()[0].startswith(message)


def test_an_absent_port_or_action_has_no_value(script: Script) -> None:
    out = ok(
        script(
            """
            class Silent(Reactor):
                ports = ("output never",)
                reactions = ({"name": "begin", "triggers": ["startup"], "effects": ["never"]},)
                def begin(self):
                    pass
            class Main(Reactor):
                ports = ("input x", "input[2] m")
                actions = ({"name": "act"},)
                reactions = (
                    {"name": "begin", "triggers": ["startup"], "sources": ["x", "m", "act"],
                     "effects": ["act"]},
                    {"name": "later", "triggers": ["act"]},
                )
                def begin(self):
                    for part in (self.x, self.m[1], self.act):
                        try:
                            part.value
                        except ValueError as error:
                            print(error)
                    print(self.x.get("none"), self.act.get("none"), self.act.is_present)
                    self.act.schedule(0)
                def later(self):
                    print(self.act.value, self.act.get("none"), self.act.is_present)
            class Top(Reactor):
                connections = (("silent.never", "main.x"),)
                def __init__(self):
                    self.main, self.silent = Main(), Silent()
            go(Top())
            """
        )
    )
    assert out.splitlines() == [
        "port x is absent at this tag, so reaction Top.main.begin cannot read its value: "
        "ask x.is_present first, or read x.get(default)",
        "port m[1] is absent at this tag, so reaction Top.main.begin cannot read its value: "
        "ask m[1].is_present first, or read m[1].get(default)",
        "action act is absent at this tag, so reaction Top.main.begin cannot read its value: "
        "ask act.is_present first, or read act.get(default)",
        "none none False",
        "None None True",
    ]


def test_times_are_numbers_texts_or_timedeltas(script: Script) -> None:
    out = ok(
        script(
            """
            for time in (5, True, 5.0, 0.25, -5, "10 ms", "1.5s", "2 min",
                         timedelta(milliseconds=3), "forever", "10", "1 parsec", "0.5 ns",
                         "300 years", "20000 weeks", [1], timedelta.max):
                try:
                    print(_hprm.nanoseconds(time))
                except Exception as error:
                    print(f"{type(error).__name__}: {error}")

            class Main(Reactor):
                actions = ({"name": "act"},)
                reactions = (
                    {"name": "begin", "triggers": ["startup"], "effects": ["act"],
                     "deadline": 10**12},
                    {"name": "later", "triggers": ["act"]},
                )
                def begin(self):
                    self.act.schedule("1 ms", "a")
                    self.act.schedule(timedelta(milliseconds=2), "b")
                    self.act.schedule(3.0 * MS, "c")
                    self.api.update_deadline("0 ns")
                    print(self.api.check_deadline())
                def begin_late(self):
                    print("late")
                def later(self):
                    print(self.act.value, self.api.logical_elapsed())
            go(Main(), fast=True)
            """
        )
    )
    expected = 'a time is "10 ms", a timedelta, or a whole number of nanoseconds'
    assert out.splitlines() == [
        "5",
        f"TypeError: {expected}, and this is True",
        f'TypeError: {expected}, and this is the float 5.0: write "5 s"',
        f'TypeError: {expected}, and this is the float 0.25: write "0.25 s"',
        "ValueError: a time counts forward, and -5 is negative",
        "10000000",
        "1500000000",
        "120000000000",
        "3000000",
        str(2**63 - 1),
        *(
            "ValueError: a time is a number with a unit (ns, us, ms, s, min, h, d or week), such "
            f'as "10 ms", and {text} is not'
            for text in ('"10"', '"1 parsec"')
        ),
        'ValueError: a time is a whole number of nanoseconds, and "0.5 ns" is not',
        "ValueError: a time is a number with a unit (ns, us, ms, s, min, h, d or week), such "
        'as "10 ms", and "300 years" is not',
        f"ValueError: a time has at most {2**63 - 1} nanoseconds, which is 292 years, and this is "
        '"20000 weeks"',
        f"TypeError: {expected}, and this is a list",
        f"ValueError: a time has at most {2**63 - 1} nanoseconds, which is 292 years, and this "
        "is 999999999 days, 23:59:59.999999",
        "late",
        "True",
        "a 1000000",
        "b 2000000",
        "c 3000000",
    ]


def test_banks_multiports_and_ports_of_contained_reactors(script: Script) -> None:
    out = ok(
        script(
            """
            class Car(Reactor):
                ports = ("input[2] wheels", "output sum")
                reactions = ({"name": "add", "triggers": ["wheels"], "effects": ["sum"]},)
                def __init__(self, factor):
                    self.factor = factor
                def add(self):
                    self.sum.set(self.factor * sum(it.get(0) for it in self.wheels))

            class Main(Reactor):
                reactions = (
                    {"name": "drive", "triggers": ["startup"], "effects": ["cars.wheels"]},
                    {"name": "tell", "triggers": ["cars.sum"]},
                )
                def __init__(self):
                    self.cars = [Car(1), Car(10), Car(100)]
                def drive(self):
                    for car in self.cars[:2]:
                        for wheel in car.wheels:
                            wheel.set(1)
                    self.cars[2].wheels[1].set(5)
                def tell(self):
                    print([car.sum.value for car in self.cars])
            go(Main())
            """
        )
    )
    assert out == "[2, 20, 500]\n"


def test_a_mutable_input_gives_each_reaction_a_copy(script: Script) -> None:
    out = ok(
        script(
            """
            class Source(Reactor):
                ports = ("output x",)
                reactions = ({"name": "begin", "triggers": ["startup"], "effects": ["x"]},)
                def begin(self):
                    self.x.set([1])

            class Sink(Reactor):
                ports = ("mutable x",)
                reactions = (
                    {"name": "one", "triggers": ["x"]}, {"name": "two", "triggers": ["x"]},
                )
                def one(self):
                    self.x.value.append(2)
                    print(self.x.value, self.x.get())
                def two(self):
                    print(self.x.value)

            class Main(Reactor):
                connections = (("source.x", "sink.x"),)
                def __init__(self):
                    self.source, self.sink = Source(), Sink()
            go(Main())
            """
        )
    )
    assert out == "[1, 2] [1, 2]\n[1]\n"


def test_timers_modes_history_and_reset(script: Script) -> None:
    out = ok(
        script(
            """
            class Main(Reactor):
                modes = ("Calm", "Busy")
                timers = (("calm", MS, 2 * MS), ("busy", MS, 2 * MS))
                options = {"calm": {"mode": 0}, "busy": {"mode": 1}}
                reactions = (
                    {"name": "rest", "triggers": ["calm"], "effects": ["Busy.history"], "mode": 0},
                    {"name": "work", "triggers": ["busy"], "effects": ["Calm"], "mode": 1},
                    {"name": "again", "triggers": ["reset"], "mode": 0},
                )
                def rest(self):
                    print("rest", self.api.logical_elapsed() // MS, repr(self.Busy))
                    self.Busy.enter()
                def work(self):
                    print("work", self.api.logical_elapsed() // MS)
                    self.Calm.set()
                def again(self):
                    print("reset", self.api.logical_elapsed() // MS)
            go(Main(), fast=True, timeout={"time": 7 * MS})
            """
        )
    )
    assert out.splitlines() == [
        "rest 1 <mode Busy>",
        "work 2",
        "reset 2",
        "rest 3 <mode Busy>",
        "work 5",
        "reset 5",
        "rest 6 <mode Busy>",
    ]


def test_a_missed_deadline_runs_its_handler(script: Script) -> None:
    out = ok(
        script(
            """
            class Main(Reactor):
                reactions = ({"name": "begin", "triggers": ["startup"], "deadline": 0},)
                def begin(self):
                    print("in time")
                def begin_late(self):
                    print("late", self.api.tag().microstep)
            go(Main(), fast=False)
            """
        )
    )
    assert out == "late 0\n"


FAILING = """
import json
import numpy
import helper

class Main(Reactor):
    reactions = ({"name": "begin", "triggers": ["startup"]},)
    def begin(self):
        %s  # here

_hprm.tell_programs()
go(Main())
"""


@pytest.mark.parametrize(
    ("statement", "message", "place"),
    [
        ("1 / 0", "raised ZeroDivisionError: division by zero", "app.py"),
        ("json.loads('{')", "raised JSONDecodeError: Expecting", "app.py"),
        ("helper.fail()", "raised KeyError: 'x'", "helper.py:3"),
        ("self.nothing", "raised AttributeError: 'Main' object has no attribute", "app.py"),
        # What is compiled names a file that is elsewhere: in no folder, or where libraries are.
        ("numpy.random.default_rng(1).integers(5, 1)", "raised ValueError: low >= high", "app.py"),
        ("exec(compile('1 / 0', 'zoo/ape.pyx', 'exec'))", "raised ZeroDivisionError", "app.py"),
        ("exec(compile('1 / 0', 'json/decoder.py', 'exec'))", "raised ZeroDivisionError", "app.py"),
    ],
)
def test_a_failure_names_the_users_own_line(
    script: Script, statement: str, message: str, place: str
) -> None:
    text = FAILING % statement
    outcome = script(text, helper="import json\ndef fail():\n    {}['x']\n")
    assert outcome.code == 1
    report = json.loads(outcome.err.splitlines()[-1])
    assert report["message"].startswith(f"reaction Main.begin {message}")
    file, _, line = place.partition(":")
    assert report["file"] == file
    assert report["line"] == (int(line) if line else line_of("# here", text))


def test_a_failure_without_a_frame_is_about_its_reaction(script: Script) -> None:
    text = """
        import functools, json

        class Main(Reactor):
            reactions = ({"name": "begin", "triggers": ["startup"]},)
            def begin(self):  # here
                pass

        class Native(Declared):
            def bodies(self, *which):
                instance, _ = super().bodies(*which)
                return instance, (int, None, None)

        _hprm.tell_programs()
        sys.exit(_hprm.run_declared(Native(Main())))
        """
    outcome = script(text)
    report = json.loads(outcome.err.splitlines()[-1])
    assert (outcome.code, report["line"]) == (1, line_of("# here", text))


def test_equal_runs_have_equal_traces(script: Script, tmp_path: Path) -> None:
    text = """
        class Count(Reactor):
            ports = ("output x",)
            timers = (("tick", 0, MS),)
            reactions = ({"name": "count", "triggers": ["tick"], "effects": ["x"]},)
            def count(self):
                self.x.set({"count": self.api.logical_elapsed()})
        class Main(Reactor):
            reactions = ({"name": "take", "triggers": ["counts.x"]},)
            def __init__(self):
                self.counts = [Count(), Count()]
            def take(self):
                assert [it.x.value["count"] for it in self.counts]
        workers = ["workers=2"] if sys.argv[1:] else []
        for name in "ab":
            main = Declared(Main(), fast=True, timeout={"time": 9 * MS})
            assert _hprm.run_declared(main, workers, logical_trace=name) == 0
        """
    ok(script(text))
    first, second = ((tmp_path / name).read_bytes() for name in "ab")
    assert first == second
    assert b"count" in first
    ok(script(text, "workers"))
    assert (tmp_path / "a").read_bytes() == first
