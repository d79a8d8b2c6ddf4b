"""``hprm.testing``: events of physical actions at chosen times, and what a test may not give."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import textwrap
import threading
from pathlib import Path
from typing import Any

import pytest
from processes import hear

import hprm
import hprm.testing

MS = 1_000_000


class Sensing(hprm.Reactor):
    """A sensor whose readings come from outside."""

    measured = hprm.PhysicalAction(int)
    limit = hprm.Input(int)
    told = hprm.Output(int)

    def __init__(self) -> None:
        self.most = 100

    @hprm.reaction(limit)
    def keep(self) -> None:
        self.most = self.limit.value

    @hprm.reaction(measured, effects=[told])
    def tell(self) -> None:
        self.told.set(min(self.measured.value, self.most))


def test_a_physical_action_has_events_at_chosen_times() -> None:
    readings = [("0 ms", 1), ("30 ms", 2), ("35 ms", 300)]
    inputs: dict[str, Any] = {"measured": readings, "limit": [("30 ms", 200)]}
    first = hprm.testing.run(Sensing(), inputs=inputs)
    assert first.outputs["told"] == [(0, 1), (30 * MS, 2), (35 * MS, 200)]
    # The program ends when nothing is left, and a run is like any other.
    assert hprm.testing.run(Sensing(), inputs=inputs).trace == first.trace


def test_an_action_comes_a_microstep_after_inputs_of_its_time() -> None:
    inputs: dict[str, Any] = {"measured": [("5 ms", 7)], "limit": [("5 ms", 3)]}
    assert hprm.testing.run(Sensing(), inputs=inputs).outputs["told"] == [(5 * MS, 3)]


@pytest.mark.parametrize(
    ("policy", "expected"),
    [
        ("defer", [(12, 1), (22, 2), (42, 3)]),
        ("drop", [(12, 1), (42, 3)]),
        ("replace", [(12, 2), (42, 3)]),
        ("update", [(15, 2), (42, 3)]),
    ],
)
def test_the_minimum_delay_and_the_spacing_of_an_action_hold(
    policy: Any, expected: list[tuple[int, int]]
) -> None:
    class Spaced(hprm.Reactor):
        event = hprm.PhysicalAction(int, min_delay="10 ms", spacing="10 ms", policy=policy)
        told = hprm.Output(int)

        @hprm.reaction(event, effects=[told])
        def tell(self) -> None:
            self.told.set(self.event.value)

    inputs = {"event": [("2 ms", 1), ("5 ms", 2), ("32 ms", 3)]}
    told = hprm.testing.run(Spaced(), inputs=inputs).outputs["told"]
    assert told == [(time * MS, value) for time, value in expected]


class Answers(hprm.Reactor):
    """A reaction schedules its physical action, and so does a thread."""

    ask = hprm.Input(int)
    answer = hprm.PhysicalAction(int, min_delay="1 ms")
    told = hprm.Output(str)

    def __init__(self, thread: bool = False) -> None:
        self.thread = thread

    @hprm.reaction(ask, effects=[answer])
    def begin(self) -> None:
        if self.thread:
            thread = threading.Thread(target=self.answer.schedule, args=("1 ms", 5))
            thread.start()
            thread.join()
        else:
            self.answer.schedule("4 ms", self.ask.value)

    @hprm.reaction(answer, effects=[told])
    def end(self) -> None:
        self.told.set(f"answer {self.answer.get()}")


def test_what_a_reaction_schedules_follows_its_tag() -> None:
    result = hprm.testing.run(Answers(), inputs={"ask": [("20 ms", 1)]})
    assert result.outputs["told"] == [(25 * MS, "answer 1")]


class Late(hprm.Reactor):
    """Two physical connections inside, one of them with a delay."""

    value = hprm.Input(int)
    soon = hprm.Output(int)
    later = hprm.Output(int)

    def __init__(self) -> None:
        self.passing, self.delayed = Passing(), Passing()
        hprm.connect(self.value, self.passing.value)
        hprm.connect(self.value, self.delayed.value)
        hprm.connect(self.passing.passed, self.soon, physical=True)
        hprm.connect(self.delayed.passed, self.later, after="5 ms", physical=True)


class Passing(hprm.Reactor):
    value = hprm.Input(int)
    passed = hprm.Output(int)

    @hprm.reaction(value, effects=[passed])
    def act(self) -> None:
        self.passed.set(self.value.value)


def test_physical_connections_follow_virtual_time() -> None:
    result = hprm.testing.run(Late(), inputs={"value": [("0 ms", 1), ("8 s", 2)]})
    last = 8_000_000_000
    assert result.outputs["soon"] == [(0, 1), (last, 2)]
    assert result.outputs["later"] == [(5_000_000, 1), (last + 5_000_000, 2)]


def test_an_event_without_a_value() -> None:
    result = hprm.testing.run(Answers(), inputs={"answer": [("20 ms", None)]})
    assert result.outputs["told"] == [(21 * MS, "answer None")]


def test_what_a_thread_schedules_is_dropped_with_a_warning() -> None:
    inputs = {"ask": [("20 ms", 1)], "answer": [("30 ms", 9)]}
    with pytest.warns(RuntimeWarning, match="an event of answer is dropped: in a test in virtual"):
        result = hprm.testing.run(Answers(thread=True), inputs=inputs)
    assert result.outputs["told"] == [(31 * MS, "answer 9")]


def test_the_result_of_a_background_task_is_dropped_and_may_be_given() -> None:
    class Thinks(hprm.Reactor):
        answer = hprm.PhysicalAction(int)
        told = hprm.Output(int)

        @hprm.reaction(hprm.startup, effects=[answer])
        def begin(self) -> None:
            done = threading.Event()
            hprm.background(self.think(done), self.answer)
            done.wait(60)

        async def think(self, done: threading.Event) -> int:
            asyncio.get_running_loop().call_soon(done.set)
            return 1

        @hprm.reaction(answer, effects=[told])
        def end(self) -> None:
            self.told.set(self.answer.value)

    with pytest.warns(RuntimeWarning, match="an event of answer is dropped"):
        result = hprm.testing.run(Thinks(), inputs={"answer": [("5 ms", 2)]})
    assert result.outputs["told"] == [(5 * MS, 2)]


class Cell(hprm.Reactor):
    """Sensors inside: one, and a bank of two."""

    told = hprm.Output(int)
    again = hprm.Action(int)

    def __init__(self) -> None:
        self.one = Sensing()
        self.more = [Sensing(), Sensing()]

    @hprm.reaction(
        lambda self: self.one.told, lambda self: [it.told for it in self.more], effects=[told]
    )
    def tell(self) -> None:
        self.told.set(sum(it.told.get(0) for it in [self.one, *self.more]))


def test_actions_of_reactors_inside_are_named_with_dots() -> None:
    inputs = {"one.measured": [("1 ms", 1)], "more[1].measured": [("1 ms", 2), ("2 ms", 4)]}
    result = hprm.testing.run(Cell(), inputs=inputs)
    assert result.outputs["told"] == [(1 * MS, 3), (2 * MS, 4)]


def test_names_that_a_test_cannot_give_are_refused() -> None:
    known = r"one.measured, more\[0\].measured, more\[1\].measured"
    for name in ("two", "one.limit", "more.measured", "more[2].measured", "one.", "", "told"):
        with pytest.raises(ValueError, match=f"Cell has no input or physical action .*: {known}$"):
            hprm.testing.run(Cell(), inputs={name: []})
    with pytest.raises(ValueError, match="again of Cell is a logical action, which only its own"):
        hprm.testing.run(Cell(), inputs={"again": []})
    with pytest.raises(ValueError, match="the action measured has two values at 1 ms"):
        hprm.testing.run(Sensing(), inputs={"measured": [("1 ms", 1), ("1 ms", 2)]})


class Typed(hprm.Reactor):
    """Inputs with types, and one of any."""

    begin = hprm.Input(int)
    many = hprm.Input(float, width=2)
    some = hprm.Input()
    told = hprm.Output(object)

    @hprm.reaction(begin, many, some, effects=[told])
    def tell(self) -> None:
        self.told.set([self.begin.get(), [it.get() for it in self.many], self.some.get()])


@pytest.mark.parametrize(
    ("name", "value", "error", "said"),
    [
        (
            "begin",
            1.5,
            TypeError,
            "input begin accepts int, and its value at 3 ms is 1.5, of type f",
        ),
        ("begin", None, TypeError, "input begin accepts int, and its value at 3 ms is None"),
        ("many", [1, "x"], TypeError, r"input many\[1\] accepts float or int, .* at 3 ms is 'x'"),
        ("many", [1], ValueError, r"many is a multiport of width 2, .* at 3 ms is \[1\]: write"),
        ("many", 1, ValueError, "many is a multiport of width 2, .* at 3 ms is 1: write a list"),
    ],
)
def test_values_of_other_types_are_refused_before_the_run(
    name: str, value: Any, error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        hprm.testing.run(Typed(), inputs={name: [("3 ms", value)]})


def test_values_of_actions_have_types() -> None:
    with pytest.raises(TypeError, match="the action measured accepts int, .* at 1 ms is 'x'"):
        hprm.testing.run(Sensing(), inputs={"measured": [("1 ms", "x")]})


def test_inputs_that_are_left_out_are_no_mistake(capfd: pytest.CaptureFixture[str]) -> None:
    assert hprm.testing.run(Typed()).outputs["told"] == []
    inputs: dict[str, Any] = {"begin": [(0, 1)], "some": [(0, "any")]}
    assert hprm.testing.run(Typed(), inputs=inputs).outputs["told"] == [
        (0, [1, [None, None], "any"])
    ]
    assert "warning" not in capfd.readouterr().err


def test_a_time_that_stands_still_is_told_with_its_line(tmp_path: Path) -> None:
    text = """
        import hprm, hprm.testing

        class Zeno(hprm.Reactor):
            again = hprm.Action()

            @hprm.reaction(hprm.startup, again, effects=[again])
            def go(self):
                self.again.schedule(0)

        hprm.testing.run(Zeno(), timeout="1 s")
        """
    (tmp_path / "zeno.py").write_text(textwrap.dedent(text))
    process = subprocess.Popen(
        [sys.executable, "zeno.py"], cwd=tmp_path, text=True, stderr=subprocess.PIPE
    )
    told = hear(process.stderr, "time goes on\n")
    process.terminate()
    process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM
    assert "warning: the logical time of the program has stood still for" in told
    assert "reaction Bench.Zeno.go (zeno.py:7) took longest" in told
    assert told.count("warning") == 1


INTERRUPTED = """
import sys
import hprm, hprm.testing

class Slow(hprm.Reactor):
    tick = hprm.Timer("1 us")

    @hprm.reaction(hprm.startup)
    def begin(self):
        print("running", file=sys.stderr, flush=True)

    @hprm.reaction(tick)
    def step(self):
        pass
"""


def _interrupted(tmp_path: Path, text: str, *command: str) -> tuple[int, str]:
    """Run a program that says when it runs, interrupt it, and return how it ended."""
    (tmp_path / "test_it.py").write_text(INTERRUPTED + text)
    process = subprocess.Popen(
        [sys.executable, *command],
        cwd=tmp_path,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    hear(process.stderr, "running\n")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    return process.returncode, out + err


def test_ctrl_c_stops_pytest(tmp_path: Path) -> None:
    tests = """
        def test_slow():
            hprm.testing.run(Slow(), timeout="1000 days")

        def test_next():
            open("reached", "w").close()
        """
    options = ("-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", "test_it.py")
    code, told = _interrupted(tmp_path, textwrap.dedent(tests), *options)
    assert (code, (tmp_path / "reached").exists()) == (2, False), told
    assert "KeyboardInterrupt" in told or "ProgramInterrupted" in told


def test_ctrl_c_in_a_script_is_a_keyboard_interrupt(tmp_path: Path) -> None:
    handled = """
        try:
            hprm.run(Slow(), timeout="1000 days")
        except KeyboardInterrupt as error:
            print(error)
        """
    assert _interrupted(tmp_path, textwrap.dedent(handled), "test_it.py") == (
        0,
        "the program was stopped by Ctrl-C (exit code 130)\n",
    )


def test_a_script_that_does_not_handle_ctrl_c_ends_quietly(tmp_path: Path) -> None:
    run = 'hprm.run(Slow(), timeout="1000 days")\n'
    assert _interrupted(tmp_path, run, "test_it.py") == (130, "")


class Watched(hprm.Federation):
    """A federation with a sensor."""

    def __init__(self) -> None:
        self.sensing = hprm.federate(Sensing(), maxwait="1 s")
        self.limit = Limit()
        hprm.connect(self.limit.value, self.sensing.limit)


class Limit(hprm.Reactor):
    """What sets the limit of a sensor."""

    value = hprm.Output(int)

    @hprm.reaction(hprm.startup, effects=[value])
    def begin(self) -> None:
        self.value.set(3)


def test_actions_of_federates_are_named_too() -> None:
    inputs = {"sensing.measured": [("1 ms", 2), ("2 ms", 5)]}
    first = hprm.testing.run(Watched(), inputs=inputs)
    told = [line for line in first.trace if '"reaction":"Bench.Watched.sensing.2"' in line]
    assert [line.partition(',"reaction')[0] for line in told] == [
        '{"tag":[1000000,1]',
        '{"tag":[2000000,1]',
    ]
    assert hprm.testing.run(Watched(), inputs=inputs).trace == first.trace
