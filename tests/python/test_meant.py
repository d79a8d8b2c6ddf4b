"""What an attribute, a name or an operator was meant to be, in reactors that are classes."""

from __future__ import annotations

import linecache
import sys
import textwrap
from itertools import count
from pathlib import Path

import pytest
from processes import call

import hprm
from hprm._declared import load

_numbers = count()

BASE = """\
import functools
import hprm

class Base(hprm.Reactor):
    out = hprm.Output(int)

    def __init__(self, gain=3):
        self.gain = gain

    @hprm.reaction(hprm.startup, effects=[out])
    def send(self):
        self.out.set(self.gain)

def logged(function):
    @functools.wraps(function)
    def run(*arguments):
        return function(*arguments)
    return run

"""

PROGRAM = """
class Program(hprm.Reactor):
    def __init__(self):
        self.main = Main()

if __name__ == "__main__":
    hprm.run(Program())
"""


def refused(tmp_path: Path, text: str) -> hprm.ProgramError:
    """Load a program that is wrong in the line with a mark ``# here``."""
    path = tmp_path / f"meant_{next(_numbers)}.py"
    path.write_text(BASE + textwrap.dedent(text))
    linecache.checkcache()
    with pytest.raises(hprm.ProgramError) as raised:
        hprm.check(load(f"{path}:Main", []))
    lines = path.read_text().splitlines()
    marked = next(number for number, line in enumerate(lines, 1) if line.endswith("# here"))
    assert raised.value.place == f"{path}:{marked}"
    return raised.value


def told(tmp_path: Path, text: str) -> str:
    """Run a program that fails; return what it tells."""
    (tmp_path / "meant.py").write_text(BASE + textwrap.dedent(text) + PROGRAM)
    return call(sys.executable, "meant.py", cwd=tmp_path, code=1, timeout=60).stderr


@pytest.mark.parametrize(
    ("classes", "hint"),
    [
        ("class Main(Base):\n    def __init__(self): self.k = 2", "Main"),
        (
            "class Between(Base):\n    def __init__(self): self.k = 2\n"
            "class Main(Between):\n    def __init__(self): super().__init__()",
            "Between",
        ),
        (
            "class Mixin:\n    def __init__(self): self.k = 2\n"
            "class Main(Mixin, Base):\n    def __init__(self): super().__init__()",
            "Mixin",
        ),
        ("class Main(Base):\n    @logged\n    def __init__(self): self.k = 2", "Main"),
    ],
)
def test_a_constructor_that_leaves_out_that_of_its_base_is_named(
    tmp_path: Path, classes: str, hint: str
) -> None:
    shown = told(tmp_path, classes + "\n")
    assert "raised AttributeError: 'Main' object has no attribute 'gain'" in shown
    assert shown.count("hint:") == 1
    assert f"hint: {hint}.__init__ does not call super().__init__()\n" in shown


@pytest.mark.parametrize(
    "constructor",
    [
        "    def __init__(self): super().__init__(); del self.gain",
        "    def __init__(self): Base.__init__(self); del self.gain",
        "    @logged\n    def __init__(self): super().__init__(); del self.gain",
    ],
)
def test_a_constructor_that_calls_that_of_its_base_is_not_blamed(
    tmp_path: Path, constructor: str
) -> None:
    shown = told(tmp_path, f"class Main(Base):\n{constructor}\n")
    assert "raised AttributeError" in shown
    assert "hint: its ports: out (output)" in shown


def test_a_constructor_that_needs_what_it_leaves_out_is_told_where(tmp_path: Path) -> None:
    found = refused(
        tmp_path,
        """
        class Main(Base):
            def __init__(self):
                self.double = 2 * self.gain  # here
        """,
    )
    assert found.message == (
        "this Main has no attribute `gain`: Main.__init__ does not call super().__init__()"
    )
    assert found.hint == "write super().__init__(...) at the beginning of `__init__`"


def test_a_function_that_needs_what_a_constructor_leaves_out_has_the_hint(tmp_path: Path) -> None:
    found = refused(
        tmp_path,
        """
        class Wide(hprm.Reactor):
            def __init__(self):
                self.width = 2

        class Main(Wide):
            outs = hprm.Output(int, width=lambda self: self.width)  # here

            def __init__(self):
                self.k = 1
        """,
    )
    assert found.hint == "Main.__init__ does not call super().__init__()"


@pytest.mark.parametrize(
    ("body", "hint"),
    [
        ("out.set(1)", "did you mean `self.out`?"),
        ("print(gain)", "did you mean `self.gain`?"),
        ("print([gain for _ in range(2)])", "did you mean `self.gain`?"),
        ("send()", "did you mean `self.send`?"),
        ("print(elapsed())", "did you mean `self.elapsed`?"),
    ],
)
def test_a_name_without_self_is_looked_for_in_the_reactor(
    tmp_path: Path, body: str, hint: str
) -> None:
    shown = told(tmp_path, f"class Main(Base):\n    def send(self):\n        {body}\n")
    assert "raised NameError: name" in shown
    # From Python 3.12 on, it is in the message.
    assert hint in shown or f"Did you mean: '{hint.split('`')[1]}'" in shown


def test_a_name_that_the_reactor_does_not_have_has_no_such_hint(tmp_path: Path) -> None:
    shown = told(tmp_path, "class Main(Base):\n    def send(self):\n        vision.set(1)\n")
    assert "raised NameError: name 'vision'" in shown
    assert "self.vision" not in shown


def test_parts_are_named_without_self_in_a_class_body(tmp_path: Path) -> None:
    found = refused(
        tmp_path,
        """
        class Main(hprm.Reactor):
            out = hprm.Output(int)

            @hprm.reaction(hprm.startup, effects=[self.out])  # here
            def begin(self):
                self.out.set(1)
        """,
    )
    assert found.message == "the body of a class has no `self`; only its methods have one"
    assert str(found.hint).startswith("write `out`, without `self.`; a port of a contained reactor")


def test_a_class_in_a_method_may_use_the_self_of_that() -> None:
    class Makes:
        name = "made"

        def make(self) -> type[hprm.Reactor]:
            class Inner(hprm.Reactor):
                called = self.name

            return Inner

    assert vars(Makes().make())["called"] == "made"


def test_a_class_body_may_use_a_global_self_and_misses_other_names() -> None:
    names: dict[str, object] = {"hprm": hprm, "self": 7}
    exec("class Inner(hprm.Reactor):\n    kept = self\n    other = len([1])\n", names)
    assert vars(names["Inner"])["kept"] == 7
    with pytest.raises(NameError, match="name 'nothing' is not defined"):
        exec("class Inner(hprm.Reactor):\n    kept = nothing\n", names)


BANKS = """
class Sink(hprm.Reactor):
    inp = hprm.Input(int)

    @hprm.reaction(inp)
    def show(self): pass

class Main(hprm.Reactor):
    def __init__(self):
        self.sources = [Base() for _ in range(3)]
        self.sink = Sink()
        {call}
"""


@pytest.mark.parametrize(
    ("call", "bank"),
    [
        ("self.sources.out >> self.sink.inp  # here", "self.sources"),
        ("hprm.connect(self.sources.out, self.sink.inp)  # here", "self.sources"),
        ("hprm.connect((Base(), Base()).out, self.sink.inp)  # here", ""),
    ],
)
def test_a_list_of_reactors_has_no_ports(tmp_path: Path, call: str, bank: str) -> None:
    found = refused(tmp_path, BANKS.format(call=call))
    reactors = 3 if bank else 2
    assert found.message == f"{bank or 'this'} is a list of {reactors} reactors, which has no `out`"
    assert found.hint == (
        f"connect all of them, hprm.connect([it.out for it in {bank or 'BANK'}], ...), or one at a"
        " time in a loop"
    )


def test_a_reaction_that_names_a_port_of_a_list_has_the_hint(tmp_path: Path) -> None:
    text = BANKS.format(call="pass") + (
        "\n    @hprm.reaction(lambda self: self.sources.out)  # here\n    def go(self): pass\n"
    )
    found = refused(tmp_path, text)
    assert str(found.hint).startswith("it is a list of 3 reactors: name the ports of all of them")


def test_other_attribute_errors_of_a_constructor_stay_as_they_are() -> None:
    class Main(hprm.Reactor):
        def __init__(self, thing: object) -> None:
            thing.out  # type: ignore[attr-defined]  # noqa: B018

    for thing in ([], [1, hprm.Reactor()], {}, None):
        with pytest.raises(AttributeError, match="has no attribute 'out'"):
            Main(thing)


@pytest.mark.parametrize(
    ("call", "hint"),
    [
        ("self.sink.inp << self.source.out  # here", "self.source.out >> self.sink.inp"),
        ("(self.sink.inp<<self.source.out)  # here", "self.source.out >> self.sink.inp"),
        ("[self.sink.inp] << self.source.out  # here", "self.source.out >> [self.sink.inp]"),
        ("self.sink.inp << self.source  # here", "self.source >> self.sink.inp"),
    ],
)
def test_ports_are_connected_in_the_direction_of_messages(
    tmp_path: Path, call: str, hint: str
) -> None:
    text = BANKS.replace("self.sources = [Base() for _ in range(3)]", "self.source = Base()")
    found = refused(tmp_path, text.format(call=call))
    assert found.message == "`<<` connects no ports; `>>` does"
    if sys.version_info < (3, 11):
        hint = "SOURCE >> DESTINATION"
    assert found.hint == f"write {hint}: the port that sends comes first"
