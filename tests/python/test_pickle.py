"""`HPRM_PICKLE`: which federates exchange pickles, and the error where they may not."""

from __future__ import annotations

import functools
import shutil
import sys
from pathlib import Path

import pytest
from conftest import Run, Spawn
from test_network import finish, listening

PROGRAM = """\
target Python {{ coordination: {coordination}, timeout: 0 sec }}
preamble {{=
import pathlib
class Plain:
    pass
class Witness:
    def __reduce__(self):
        return pathlib.Path.touch, (pathlib.Path("unpickled"),)
=}}
reactor Source {{
  output out
  reaction(startup) -> out {{=
    plain = Plain()
    plain.x = 7
    out.set({value})
  =}}
}}
reactor Sink {{
  input inp
  reaction(inp) {{= print("got", inp.value["a"][1].x) =}}
}}
federated reactor {{
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}}
"""

NESTED = '{"a": [0, plain]}'
GOT = "got 7\n"


def text(value: str = NESTED, coordination: str = "centralized") -> str:
    return PROGRAM.format(value=value, coordination=coordination)


def test_objects_of_any_class_pass_between_neighbours(launch: Run) -> None:
    assert GOT in launch(text()).out


@pytest.mark.parametrize("inside", [(), ("--in-process",)], ids=["processes", "threads"])
def test_deny_means_never(
    launch: Run, inside: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HPRM_PICKLE", "deny")
    outcome = launch(text(), *inside)
    assert outcome.code == 1
    assert "`value['a'][1]` is of the type Plain, which only pickle can carry" in outcome.err
    assert "HPRM_PICKLE=deny" in outcome.err
    assert "connection Program.source.out -> Program.sink.inp" in outcome.err
    assert "Program.lf:12" in outcome.err
    assert "got" not in outcome.out


@pytest.mark.parametrize("inside", [(), ("--in-process",)], ids=["processes", "threads"])
@pytest.mark.parametrize(
    "value", ["lambda: 1", "[__import__('threading').Lock()]", "(n for n in [])"]
)
def test_what_pickle_cannot_carry_has_a_hint(
    launch: Run, value: str, inside: tuple[str, ...]
) -> None:
    outcome = launch(text(value), *inside)
    assert outcome.code == 1
    assert outcome.err.count("hint: ") == 1, outcome.err
    assert "hint: pickle carries no locks, open files or generators" in outcome.err
    assert "; the first part that needs a pickle is `value" in outcome.err


def test_an_error_of_a_method_that_pickle_calls_has_no_hint_about_pickle(launch: Run) -> None:
    method = "def __getstate__(self):\n        return self.missing"
    program = text().replace("class Plain:\n    pass", f"class Plain:\n    {method}")
    outcome = launch(program)
    assert (outcome.code, "has no attribute 'missing'" in outcome.err) == (1, True), outcome.err
    assert "pickle carries" not in outcome.err


def test_what_needs_no_pickle_passes_always(launch: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HPRM_PICKLE", "deny")
    program = text().replace("class Plain:\n    pass", DATACLASS).replace("Plain()", "Plain(7)")
    outcome = launch(program)
    assert (outcome.code, outcome.err) == (0, "")
    assert GOT in outcome.out


DATACLASS = """\
import dataclasses
@dataclasses.dataclass
class Plain:
    x: int"""


CLASSES = """\
target Python {{ timeout: 0 sec, coordination: {coordination} }}
preamble {{=
import dataclasses, enum
from typing import Any, NamedTuple
import numpy as np
class Colour(enum.Enum):
    RED = 1
class Point(NamedTuple):
    x: float
    y: float
@dataclasses.dataclass(frozen=True)
class Box:
    at: Point
    colour: Colour
    pixels: Any = None
=}}
reactor Source {{
  output out
  reaction(startup) -> out {{=
    out.set({{Box(Point(1, 2), Colour.RED): [Box(Point(3, 4), Colour.RED, np.ones(50_000))]}})
  =}}
}}
reactor Sink {{
  input inp
  reaction(inp) {{=
    [(key, [box])] = inp.value.items()
    assert type(key) is Box and type(box) is Box and type(box.at) is Point
    assert key == Box(Point(1, 2), Colour.RED) and box.colour is Colour.RED
    assert box.pixels.sum() == 50_000 and not box.pixels.flags.writeable
    print("same")
  =}}
}}
federated reactor {{
  source = new Source()
  sink = new Sink()
  source.out -> sink.inp
}}
"""


@pytest.mark.parametrize("coordination", ["centralized", "decentralized"])
@pytest.mark.parametrize("inside", [(), ("--in-process",)], ids=["processes", "threads"])
def test_classes_of_the_program_need_no_pickle(
    launch: Run, inside: tuple[str, ...], coordination: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HPRM_PICKLE", "deny")
    outcome = launch(CLASSES.format(coordination=coordination), *inside)
    assert (outcome.code, outcome.err) == (0, "")
    assert "same" in outcome.out


def test_a_word_that_means_nothing_is_an_error(
    launch: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HPRM_PICKLE", "yes")
    outcome = launch(text())
    assert outcome.code == 2
    assert "HPRM_PICKLE=yes is wrong: not `deny`, `local` or `allow`" in outcome.err


@pytest.fixture
def start(spawn: Spawn) -> Spawn:
    command = shutil.which("hprm", path=str(Path(sys.executable).parent))
    assert command is not None, "make build puts hprm beside python"
    return functools.partial(spawn, command)


def over_tcp(
    start: Spawn, folder: Path, program: str, source: str = "", sink: str = ""
) -> dict[str, tuple[str, str, int]]:
    """Runs a program whose source joins over TCP; what `HPRM_PICKLE` is for each federate."""
    (folder / "Fed.lf").write_text(program)
    secret = ["--federation-file", "secret"]
    unix = f"unix:{folder}/rti"
    rti = start("rti", "Fed.lf", "--listen", unix, "--listen", "127.0.0.1:0", *secret)
    assert listening(rti) == unix
    tcp = listening(rti)
    reached = ["--advertise", "127.0.0.1"]
    federates = {
        "source": start("federate", "Fed.lf", "source", "--rti", tcp, *secret, HPRM_PICKLE=source),
        "sink": start(
            "federate", "Fed.lf", "sink", "--rti", unix, *reached, *secret, HPRM_PICKLE=sink
        ),
    }
    return {name: finish(process) for name, process in federates.items()} | {"rti": finish(rti)}


BOTH = pytest.mark.parametrize("coordination", ["centralized", "decentralized"])


@BOTH
def test_nothing_is_pickled_for_another_machine(
    start: Spawn, tmp_path: Path, coordination: str
) -> None:
    ends = over_tcp(start, tmp_path, text(coordination=coordination))
    _, errors, code = ends["source"]
    assert code == 1
    assert "`value['a'][1]` is of the type Plain" in errors
    assert "HPRM_PICKLE=local" in errors
    assert "HPRM_PICKLE=allow" in errors
    assert "got" not in ends["sink"][0]


@BOTH
def test_allow_means_other_machines_too(start: Spawn, tmp_path: Path, coordination: str) -> None:
    ends = over_tcp(start, tmp_path, text(coordination=coordination), "allow", "allow")
    assert ends["sink"] == (GOT, "", 0)


@BOTH
def test_what_may_not_come_is_not_unpickled(
    start: Spawn, tmp_path: Path, coordination: str
) -> None:
    program = text("Witness()", coordination)
    ends = over_tcp(start, tmp_path, program, "allow", "local")
    _, errors, code = ends["sink"]
    assert code == 1
    assert "a pickle has arrived and was not read" in errors
    assert not (tmp_path / "unpickled").exists()
    # It would have run what the sender likes.
    over_tcp(start, tmp_path, program, "allow", "allow")
    assert (tmp_path / "unpickled").exists()


THREE = """\
target Python {{ timeout: 0 sec }}
preamble {{=
class Plain:
    pass
=}}
reactor Source {{
  output out
  reaction(startup) -> out {{= out.set([Plain()]) =}}
}}
reactor Relay {{
  input inp
  output out
  reaction(inp) -> out {{= {relay} =}}
}}
reactor Sink {{
  input inp
  reaction(inp) {{= print("got", type(inp.value[0]).__name__, flush=True) =}}
}}
federated reactor {{
  source = new Source()
  relay = new Relay()
  sink = new Sink()
  {connections}
}}
"""


@pytest.mark.parametrize(
    ("sender", "relay", "connections"),
    [
        # The same value, to a neighbour and to another federate.
        ("source", "inp.value", "source.out, source.out -> relay.inp, sink.inp"),
        # A value that has come from a neighbour.
        ("relay", "out.set(inp.value)", "source.out, relay.out -> relay.inp, sink.inp"),
    ],
    ids=["to both", "passed on"],
)
def test_a_pickle_for_a_neighbour_goes_no_further(
    start: Spawn, tmp_path: Path, sender: str, relay: str, connections: str
) -> None:
    (tmp_path / "Fed.lf").write_text(THREE.format(relay=relay, connections=connections))
    secret = ["--federation-file", "secret"]
    unix = f"unix:{tmp_path}/rti"
    rti = start("rti", "Fed.lf", "--listen", unix, "--listen", "127.0.0.1:0", *secret)
    assert listening(rti) == unix
    addresses = {"source": unix, "relay": unix, "sink": listening(rti)}
    federates = {
        name: start("federate", "Fed.lf", name, "--rti", address, *secret)
        for name, address in addresses.items()
    }
    ends = {name: finish(federate) for name, federate in federates.items()}
    _, errors, code = ends[sender]
    assert code == 1
    assert "`value[0]` is of the type Plain" in errors
    assert "-> Fed.sink.inp" in errors
    assert "got" not in ends["sink"][0]
