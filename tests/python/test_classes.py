"""Mistakes in reactor classes: one error each, with its place, before anything runs."""

from __future__ import annotations

import abc
import linecache
import sys
import textwrap
from itertools import count
from pathlib import Path
from typing import Generic, Protocol, TypeVar, runtime_checkable

import pytest

import hprm
import hprm.testing
from hprm import _connect, _hints
from hprm._declared import load

_numbers = count()


def error(tmp_path: Path, text: str) -> hprm.ProgramError:
    """Load a program that is wrong; a mark ``# here`` is where."""
    path = tmp_path / f"program_{next(_numbers)}.py"
    path.write_text("import hprm\n" + textwrap.dedent(text))
    lines = path.read_text().splitlines()
    linecache.checkcache()
    with pytest.raises(hprm.ProgramError) as raised:
        hprm.check(load(str(path), []))
    [number] = [at for at, line in enumerate(lines, start=1) if line.endswith("# here")]
    assert f"{path}:{number}" in str(raised.value), raised.value
    return raised.value


PORTS = """
class Main(hprm.Reactor):
    number = hprm.Input(int)
    other = hprm.Input(int)
    doubled = hprm.Output(int)
    again = hprm.Action(int)
    idle = hprm.Mode(initial=True)
    busy = hprm.Mode()
"""


@pytest.mark.parametrize(
    ("body", "message", "hint"),
    [
        (
            "self.doubled.set(2)  # here",
            "reaction double uses the output `doubled`, which it does not declare",
            "write @hprm.reaction(..., effects=[doubled])",
        ),
        (
            "print(self.other.value)  # here",
            "reaction double uses the input `other`, which it does not declare",
            "write @hprm.reaction(..., sources=[other])",
        ),
        (
            "self.again.schedule(0)  # here",
            "reaction double uses the action `again`, which it does not declare",
            "write @hprm.reaction(..., effects=[again])",
        ),
        (
            "self.busy.enter()  # here",
            "reaction double uses the mode `busy`, which it does not declare",
            "write @hprm.reaction(..., effects=[busy])",
        ),
        (
            "self.doubled.set(self.other.value + self.again.value); self.busy.enter()  # here",
            "reaction double uses the output `doubled`, the input `other`, the action `again`"
            " and the mode `busy`, which it does not declare",
            "write @hprm.reaction(..., effects=[doubled, busy], sources=[other, again])",
        ),
        (
            "self.doubled = 2  # here",
            "the output `doubled` cannot be assigned",
            "write self.doubled.set(...)",
        ),
    ],
)
def test_a_body_that_uses_what_its_reaction_does_not_declare(
    tmp_path: Path, body: str, message: str, hint: str
) -> None:
    text = (
        f"{PORTS}\n    @hprm.reaction(number, mode=idle)\n    def double(self):\n        {body}\n"
    )
    found = error(tmp_path, text)
    assert (found.message, found.hint) == (message, hint)


def test_a_method_that_a_reaction_calls_counts_as_its_body(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        f"""{PORTS}
    @hprm.reaction(number)
    def double(self):
        self.answer(2 * self.number.value)

    def answer(self, value):
        self.doubled.set(value)  # here
""",
    )
    assert found.message == "reaction double uses the output `doubled`, which it does not declare"
    assert found.code == "LF1003"


def test_a_handler_that_does_not_exist(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        f"""{PORTS}
    @hprm.reaction(number, deadline="10 ms", late="skipp")  # here
    def double(self): pass
    def skip(self): pass
""",
    )
    assert found.message == "Main has no method `skipp`, which reaction double names"


def test_a_deadline_without_a_handler(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        f"""{PORTS}
    @hprm.reaction(number, deadline="10 ms")  # here
    def double(self): pass
""",
    )
    assert found.message == "reaction double has a `deadline` and no `late`"


def test_a_reaction_without_parentheses(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        """
class Main(hprm.Reactor):
    @hprm.reaction  # here
    def double(self): pass
""",
    )
    assert found.message == "reaction double has no triggers"


def test_a_time_that_is_none(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        """
class Main(hprm.Reactor):
    tick = hprm.Timer("10 msec.")  # here
    @hprm.reaction(tick)
    def run(self): pass
""",
    )
    assert "a time is" in found.message and '"10 msec."' in found.message


@pytest.mark.parametrize(
    "made",
    [
        "source = Source()  # here",
        "self.many = [[Source()]]  # here",
        "self.source = Source()  # here\n        self.source = Source()",
    ],
)
def test_a_reactor_that_is_in_no_attribute_would_never_run(tmp_path: Path, made: str) -> None:
    found = error(
        tmp_path,
        f"""
class Source(hprm.Reactor):
    out = hprm.Output(int)

class Main(hprm.Reactor):
    def __init__(self):
        {made}
""",
    )
    assert found.message == "Main makes this Source and does not contain it, so it would never run"
    assert found.hint is not None and "assign it to an attribute of self" in found.hint


def test_a_port_of_a_reactor_that_is_elsewhere(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        """
class Source(hprm.Reactor):
    out = hprm.Output(int)

class Sink(hprm.Reactor):
    into = hprm.Input(int)

class Inner(hprm.Reactor):
    def __init__(self):
        self.source = Source()

class Main(hprm.Reactor):
    def __init__(self):
        self.inner = Inner()
        self.sink = Sink()
        hprm.connect(self.inner.source.out, self.sink.into)  # here
""",
    )
    assert "output Source.out is not of Main" in found.message
    assert found.hint is not None and "assign the Source to an attribute" in found.hint


def test_reactors_without_end(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        """
class Main(hprm.Reactor):
    def __init__(self):
        self.inner = Main()  # here
""",
    )
    assert found.message == "reactors are nested more than 200 deep"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("number = hprm.Input(int)\n    number = hprm.Output(int)  # here", "the input `number`"),
        ("number = hprm.Input(int)\n    def number(self): pass  # here", "the input `number`"),
        (
            "@hprm.reaction(hprm.startup)\n    def go(self): pass\n    def go(self): pass  # here",
            "the reaction `go`",
        ),
    ],
)
def test_a_name_that_would_be_lost(tmp_path: Path, body: str, message: str) -> None:
    found = error(tmp_path, f"class Main(hprm.Reactor):\n    {body}\n")
    assert found.message.startswith(f"this replaces {message}, which line ")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("tick = hprm.Timer  # here", "`tick` is the class hprm.Timer, not one of its objects"),
        (
            "ticks = [hprm.Timer()]  # here",
            "this timer is in the list `ticks`, and has no name of its own",
        ),
        (
            "tick = hprm.Timer()  # here\n    tock = tick",
            "this timer has two names, tick and tock",
        ),
        (
            'tick = hprm.Timer(mode="idle")  # here',
            "`mode` is a mode of the class, not 'idle'",
        ),
        (
            "tick = hprm.Timer(mode=hprm.Mode())  # here",
            "the mode ? that `mode` names is not of Main",
        ),
        (
            "image = hprm.Input(3)  # here",
            "the type of this input is 3, which is a value",
        ),
        (
            "@hprm.reaction(hprm.startup)  # here\n    @classmethod\n    def go(cls): pass",
            "@hprm.reaction(...) is above a classmethod, not above a method",
        ),
        (
            "@staticmethod  # here\n    @hprm.reaction(hprm.startup)\n    def go(self): pass",
            "reaction go is a staticmethod, not a method",
        ),
        (
            "@hprm.reaction(hprm.startup)  # here\n    @hprm.reaction(hprm.shutdown)\n"
            "    def go(self): pass",
            "this method is a reaction already",
        ),
        (
            "def __init__(self):\n        self.image = hprm.Input()  # here",
            "the constructor of Main declares the input `image`",
        ),
    ],
)
def test_slips_in_a_class_body(tmp_path: Path, body: str, message: str) -> None:
    assert error(tmp_path, f"class Main(hprm.Reactor):\n    {body}\n").message == message


@pytest.mark.parametrize(
    ("keyword", "message"),
    [
        ("bound=3", "`bound` is how many messages may wait, and what happens to the next, not 3"),
        ("serializer=3", "`serializer` is the name of a module, not 3"),
        (
            'after="3"',
            "`after`: a time is a number with a unit (ns, us, ms, s, min, h, d or week), such as"
            ' "10 ms", and "3" is not',
        ),
    ],
)
def test_slips_in_a_connection(tmp_path: Path, keyword: str, message: str) -> None:
    found = error(
        tmp_path,
        f"""{PORTS}
    def __init__(self):
        hprm.connect(self.number, self.doubled, {keyword})  # here
""",
    )
    assert found.message == message


def test_parentheses_forgotten_where_a_reactor_is_made(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        """
class Source(hprm.Reactor):
    out = hprm.Output(int)

class Main(hprm.Reactor):
    out = hprm.Output(int)
    def __init__(self):
        self.source = Source
        self.source.out >> self.out  # here
""",
    )
    assert found.message.startswith("the source of this connection is the output `out` of a class")
    assert found.hint is not None and "with parentheses" in found.hint


def test_decorators_above_and_below_a_reaction_run_and_its_body_is_still_checked(
    tmp_path: Path,
) -> None:
    decorated = """
import functools

said = []

def noted(function):
    @functools.wraps(function)
    def wrapper(*arguments):
        said.append(function.__name__)
        return function(*arguments)
    return wrapper

class Main(hprm.Reactor):
    out = hprm.Output(int)

    @noted
    @hprm.reaction(hprm.startup)
    def above(self): pass

    @hprm.reaction(hprm.startup)
    @noted
    def below(self): BODY

    other = hprm.reaction(hprm.startup)(lambda self: said.append("other"))
"""
    names: dict[str, object] = {"hprm": hprm}
    path = tmp_path / "right.py"
    path.write_text(decorated.replace("BODY", "pass"))
    exec(compile(path.read_text(), str(path), "exec"), names)
    hprm.testing.run(names["Main"]())  # type: ignore[operator]
    assert names["said"] == ["above", "below", "other"]
    found = error(tmp_path, decorated.replace("BODY", "self.out.set(1)  # here"))
    assert found.message == "reaction below uses the output `out`, which it does not declare"


def test_reactors_may_be_abstract() -> None:
    class Base(hprm.Reactor):
        @abc.abstractmethod
        def gain(self) -> int: ...

    class Whole(Base, abc.ABC):
        def gain(self) -> int:
            return 2

    assert Whole().gain() == 2
    with pytest.raises(TypeError, match="abstract"):
        Base()


T = TypeVar("T")


@runtime_checkable
class Gains(Protocol):
    def gain(self) -> int: ...


def test_reactors_may_extend_protocols_and_be_generic() -> None:
    class Amplifier(hprm.Reactor, Gains, timeout="1 s"):
        out = hprm.Output(int)

        def __init__(self, factor: int) -> None:
            self.factor = factor

        def gain(self) -> int:
            return self.factor

    class First(Gains, hprm.Reactor):
        def gain(self) -> int:
            return 1

    class Generic_(Generic[T], hprm.Reactor):
        pass

    class Whole(hprm.Reactor, Generic[T]):
        def __init__(self, value: T) -> None:
            self.value = value

    amplifier = Amplifier(3)
    assert amplifier.gain() == 3
    for reactor in (amplifier, First()):
        assert isinstance(reactor, hprm.Reactor) and isinstance(reactor, Gains)
    assert not isinstance(Whole(1), Gains) and not issubclass(Gains, hprm.Reactor)
    assert Amplifier._hprm_place_.path == First._hprm_place_.path == __file__
    assert Generic_._hprm_place_.path == __file__
    hprm.check(Whole[int](1))


def test_a_reactor_in_two_places(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        """
class Part(hprm.Reactor):
    pass

class Main(hprm.Reactor):
    def __init__(self):
        self.first = Part()  # here
        self.second = self.first
""",
    )
    assert "is contained in Main already" in found.message


def test_ports_of_different_types(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        """
class Source(hprm.Reactor):
    out = hprm.Output(str)

class Sink(hprm.Reactor):
    into = hprm.Input(int)

class Main(hprm.Reactor):
    def __init__(self):
        self.source, self.sink = Source(), Sink()
        self.source.out >> self.sink.into  # here
""",
    )
    assert (
        found.message == "output Source.out has values of type str, and input Sink.into takes int"
    )


TYPED = """
class Source(hprm.Reactor):
    number = hprm.Output(int)
    numbers = hprm.Output(int, width=lambda self: self.width)
    text = hprm.Output(str)

    def __init__(self, width=2):
        self.width = width

class Sink(hprm.Reactor):
    number = hprm.Input(int)
    numbers = hprm.Input(int, width=3)
    text = hprm.Input(str)

class Main(hprm.Reactor):
    def __init__(self):
        self.source, self.sink = Source(), Sink()
        self.sources = [Source(1), Source(2)]
        self.sinks = [Sink(), Sink()]
"""


@pytest.mark.parametrize(
    "connection",
    [
        "[self.source.number, self.source.text], [self.sink.number, self.sink.text]",
        "[self.source.numbers, self.source.number, self.source.text],"
        " [self.sink.numbers, self.sink.text]",
        "[*(it.numbers for it in self.sources), self.source.text],"
        " [self.sink.numbers, self.sink.text]",
        "[self.source.text, self.source.numbers[1], self.source.numbers[0]],"
        " [self.sink.text, self.sink.numbers[2], self.sink.number]",
        "[self.source.number, self.source.text],"
        " [self.sinks[0].number, self.sinks[0].text, self.sinks[1].number, self.sinks[1].text],"
        " repeated=True",
        "self.source.text, [it.text for it in self.sinks], repeated=True",
    ],
)
def test_types_are_compared_in_the_order_of_the_channels(tmp_path: Path, connection: str) -> None:
    path = tmp_path / f"typed_{next(_numbers)}.py"
    path.write_text(f"import hprm\n{TYPED}        hprm.connect({connection})\n")
    hprm.check(load(f"{path}:Main", []))


@pytest.mark.parametrize(
    ("connection", "message"),
    [
        (
            "[self.source.text, self.source.number], [self.sink.number, self.sink.text]",
            "output Source.text has values of type str, and input Sink.number takes int",
        ),
        (
            "[self.source.numbers, self.source.text], [self.sink.numbers, self.sink.text]",
            "output Source.text has values of type str, and input Sink.numbers takes int",
        ),
        (
            "[self.source.number, self.source.text],"
            " [it.number for it in self.sinks], repeated=True",
            "output Source.text has values of type str, and input Sink.number takes int",
        ),
    ],
)
def test_channels_of_different_types(tmp_path: Path, connection: str, message: str) -> None:
    path = tmp_path / f"typed_{next(_numbers)}.py"
    path.write_text(f"import hprm\n{TYPED}        hprm.connect({connection})\n")
    with pytest.raises(hprm.ProgramError) as raised:
        hprm.check(load(f"{path}:Main", []))
    assert raised.value.message == message


def test_each_channel_is_compared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    class Source(hprm.Reactor):
        out = hprm.Output(int)

        @hprm.reaction(hprm.startup, effects=[out])
        def begin(self) -> None:
            self.out.set(1)

    class Sink(hprm.Reactor):
        into = hprm.Input(int)

    class Main(hprm.Reactor):
        def __init__(self) -> None:
            self.sources = [Source() for _ in range(50)]
            self.sinks = [Sink() for _ in range(50)]
            hprm.connect([it.out for it in self.sources], [it.into for it in self.sinks])

    compared = []
    check_pair = _connect._check_pair
    monkeypatch.setattr(
        _connect, "_check_pair", lambda *pair: (compared.append(pair), check_pair(*pair))
    )
    hprm.check(Main())
    assert len(compared) == 50


def test_a_connection_outside_of_a_constructor(tmp_path: Path) -> None:
    found = error(
        tmp_path,
        """
class Source(hprm.Reactor):
    out = hprm.Output(str)

hprm.connect(Source().out, Source().out)  # here
""",
    )
    assert "ports are connected in the constructor" in found.message


# What the rules of the language find, as they do in `.lf` files.
@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("hprm.connect(self.a.into, self.b.out)  # here", "LF0305"),
        (
            "hprm.connect(self.a.out, self.b.into)\n"
            "        hprm.connect(self.c.out, self.b.into)  # here",
            "LF0502",
        ),
        (
            "hprm.connect(self.a.out, self.b.into)\n        hprm.connect(self.b.out, self.a.into)",
            "LF0503",
        ),
    ],
)
def test_the_rules_of_the_language(tmp_path: Path, text: str, code: str) -> None:
    mark = "" if "# here" in text else "  # here"
    found = error(
        tmp_path,
        f"""
class Part(hprm.Reactor):
    into = hprm.Input(int)
    out = hprm.Output(int)

    @hprm.reaction(into, effects=[out]){mark}
    def forward(self):
        self.out.set(self.into.value)

class Main(hprm.Reactor):
    def __init__(self):
        self.a, self.b, self.c = Part(), Part(), Part()
        {text}
""",
    )
    assert f"error[{code}]" in str(found)


def test_several_programs_in_one_file(tmp_path: Path) -> None:
    path = tmp_path / "several.py"
    path.write_text("import hprm\nclass A(hprm.Reactor): pass\nclass B(hprm.Reactor): pass\n")
    with pytest.raises(hprm.ProgramError, match="defines several reactors: A, B") as found:
        load(str(path), [])
    assert f"hint: name the program: {path}:A or {path}:B" in str(found.value)
    assert type(load(f"{path}:B", []).main).__name__ == "B"
    with pytest.raises(hprm.ProgramError, match="has no C"):
        load(f"{path}:C", [])


def test_the_program_of_a_file_is_the_only_class_without_ports(tmp_path: Path) -> None:
    path = tmp_path / "wholes.py"
    port = "    x = hprm.Input(int)\n"
    path.write_text(
        f"import hprm\nclass A(hprm.Reactor):\n{port}class B(hprm.Reactor): pass\n"
        f"class C(hprm.Reactor):\n{port}"
    )
    assert type(load(str(path), []).main).__name__ == "B"


def test_a_program_is_named_by_its_file_and_a_class(tmp_path: Path) -> None:
    folder = tmp_path / "old.py:new"
    folder.mkdir()
    text = "import hprm\n\nclass Main(hprm.Reactor):\n    pass\n\nclass Other(Main):\n    pass\n"
    (folder / "named.py").write_text(text)
    assert type(load(f"{folder}/named.py", []).main).__name__ == "Main"
    assert type(load(f"{folder}/named.py:Other", []).main).__name__ == "Other"
    with pytest.raises(hprm.ProgramError) as raised:
        load(f"{folder}/named.py:", [])
    assert raised.value.message == f"{folder}/named.py: ends with a colon, and names no reactor"
    assert raised.value.hint == f"write {folder}/named.py:NAME, or {folder}/named.py alone"


def test_a_program_may_be_in_a_package(tmp_path: Path) -> None:
    package = tmp_path / "robot" / "parts"
    package.mkdir(parents=True)
    (tmp_path / "robot" / "__init__.py").touch()
    (package / "__init__.py").touch()
    (package / "arm.py").write_text("import hprm\nclass Arm(hprm.Reactor): pass\n")
    (tmp_path / "robot" / "program.py").write_text(
        "import hprm\nfrom .parts.arm import Arm\n"
        "class Robot(hprm.Federation):\n    def __init__(self):\n        self.arm = Arm()\n"
    )
    main = load(str(tmp_path / "robot" / "program.py"), []).main
    assert type(main).__module__ == "robot.program"
    hprm.check(main)


def test_parameters_are_read_by_their_types(tmp_path: Path) -> None:
    path = tmp_path / "parameters.py"
    path.write_text(
        "import hprm\n"
        "class Main(hprm.Reactor):\n"
        "    def __init__(self, rate: int, gain: float = 1.0, on=False, name: str = 'a'):\n"
        "        self.all = rate, gain, on, name\n"
    )
    stated = ["main.rate=3", "main.gain=2", "main.on=true", 'main.name="b"', "timeout=1 s"]
    main = load(str(path), stated).main
    assert vars(main)["all"] == (3, 2.0, True, "b")
    with pytest.raises(hprm.ProgramError, match="--rate fast: the parameter is an int"):
        load(str(path), ["main.rate=fast"])
    with pytest.raises(hprm.ProgramError, match="--speed 3 is neither an option"):
        load(str(path), ["main.speed=3"])


def test_decorators_and_functions_with_a_self_of_their_own_are_understood(tmp_path: Path) -> None:
    path = tmp_path / "decorated.py"
    path.write_text(
        textwrap.dedent(
            """
            import functools
            import hprm

            def logged(function):
                @functools.wraps(function)
                def wrapper(*arguments):
                    print("before")
                    return function(*arguments)
                return wrapper

            class Main(hprm.Reactor):
                number = hprm.Output(int)

                @hprm.reaction(hprm.startup, effects=[number])
                @logged
                def begin(self):
                    class Other:
                        def number_of(self):
                            return self.other
                    self.number.set(1)

                @hprm.reaction(hprm.startup)
                def more(self):
                    class Other:
                        number = 3
                        def get(self):
                            return self.number
                    print(Other().get())
            """
        )
    )
    main = load(str(path), []).main
    assert hprm.testing.run(main).outputs["number"] == [(0, 1)]
    path.write_text(path.read_text().replace("startup, effects=[number]", "startup"))
    del sys.modules["decorated"]
    linecache.checkcache()
    with pytest.raises(hprm.ProgramError, match="reaction begin uses the output `number`"):
        load(str(path), [])


@pytest.mark.parametrize("name", ["elapsed", "tag", "lag", "_hprm_parts_"])
def test_what_every_reactor_has_is_not_assigned(tmp_path: Path, name: str) -> None:
    text = f"""
        class Base(hprm.Reactor):
            def __init__(self):
                self.count = 0
                self.{name} = 3  # here

        class Main(Base):
            def __init__(self, more=1):
                super().__init__()
                self.register = more
        """
    found = error(tmp_path, text)
    assert found.message == (
        f"the constructor of Main assigns to `{name}`, which every reactor has already"
    )
    assert found.hint == "give the attribute another name"


def test_a_constructor_that_assigns_to_a_part_is_told_where(tmp_path: Path) -> None:
    text = """
        class Source(hprm.Reactor):
            out = hprm.Output(int)

            def __init__(self):
                self.count = 0
                self.out = 3  # here

        class Main(hprm.Reactor):
            def __init__(self):
                self.source = Source()
        """
    found = error(tmp_path, text)
    assert found.message == "the constructor of Source assigns to the output `out`"


CAMERA = """
class Camera(hprm.Reactor):
    image = hprm.Output(int)
    light = hprm.Input(int)

class Empty(hprm.Reactor):
    pass

class Main(hprm.Reactor):
    def __init__(self):
        self.camera, self.empty = Camera(), Empty()
"""
CAMERA_PORTS = "its ports: image (output), light (input)"


@pytest.mark.parametrize(
    ("connection", "side", "what", "hint"),
    [
        ("self.camera >> self.empty", "source", "a Camera", f"name one of {CAMERA_PORTS}"),
        ("self.camera.image >> self.camera", "destination", "a Camera", CAMERA_PORTS),
        ("[self.camera] >> self.camera", "source", "a Camera", CAMERA_PORTS),
        ("self.empty >> self.camera", "source", "an Empty", "name a port of a contained reactor"),
    ],
)
def test_reactors_are_not_connected_but_their_ports(
    tmp_path: Path, connection: str, side: str, what: str, hint: str
) -> None:
    found = error(tmp_path, f"{CAMERA}        {connection}  # here\n")
    assert found.message == f"the {side} of this connection is {what}, not a port of a reactor"
    assert hint in str(found.hint)


def test_a_port_that_is_not_there_is_told_with_those_that_are() -> None:
    class Camera(hprm.Reactor):
        image = hprm.Output(int)
        light = hprm.Input(int)

    class Empty(hprm.Reactor):
        pass

    # Not by the reactor itself: a class that looks for missing attributes is slow with all of them.
    assert "__getattr__" not in dir(hprm.Reactor)
    for reactor, hint in (Camera(), CAMERA_PORTS), (Empty(), "it has no ports"):
        with pytest.raises(AttributeError) as raised:
            reactor.imag  # type: ignore[attr-defined]  # noqa: B018
        assert _hints.of(raised.value) == hint
