"""The RTI refuses federates with another program or other properties, and says what differs."""

from __future__ import annotations

import signal

import pytest
from processes import Bench, Federation, finish, hear

PROGRAM = """
target Python { timeout: 100 ms }
reactor Camera {
  output image
  timer t(0, 20 ms)
  state n = 0
  reaction(t) -> image {= image.set(b"pixels"); self.n += 1 =}
}
reactor Planner {
  input image
  state n = 0
  reaction(image) {= self.n += 1 =}
  reaction(shutdown) {= print("got", self.n) =}
}
federated reactor {
  camera = new Camera()
  planner = new Planner()
  camera.image -> planner.image
}
"""


def of(bench: Bench, *options: str) -> Federation:
    """Start an RTI for the program, and its camera."""
    return bench.by_hand(PROGRAM, "camera", options=options)


def other(federation: Federation, text: str, *options: str) -> str:
    """Start a planner of another program, and return why it was refused."""
    elsewhere = federation.bench.folder / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "Main.lf").write_text(text)
    command = ["federate", "elsewhere/Main.lf", "planner", "--rti", federation.address, *options]
    environment = {"HPRM_FEDERATION_ID": federation.id}
    planner = finish(federation.bench.call(*command, environment=environment))
    assert planner.code == 1
    planner.assert_one_error("error: the RTI refuses this federate: its program differs from ")
    assert "hint: run the same files with the same properties everywhere" in planner.err
    # The RTI says the same.
    told = hear(federation.members["rti"].stdout, "or the environment\n")
    words = planner.err.partition("its program")[2]
    assert f"refused federate planner: its program{words.rstrip()}" in told
    return planner.err


EDITS = [
    ("timer t(0, 20 ms)", "timer t(0, 50 ms)", "timer camera.t is (0, 50 ms) at federate planner"),
    (
        "self.n += 1 =}\n  r",
        "self.n += 9 =}\n  r",
        "reaction 1 of reactor Planner (Main.lf:12) diff",
    ),
    ('b"pixels"', "{1: 2}", "the body of reaction 1 of reactor Camera (Main.lf:7) differs"),
    (
        "reaction(shutdown)",
        "timer z(0)\n  reaction(z) {==}\n  reaction(shutdown)",
        "planner.z is in",
    ),
    (
        "-> planner.image",
        "-> planner.image after 5 ms",
        "camera.image -> planner.image is after 5 ms",
    ),
    (
        "timeout: 100 ms",
        "timeout: 1 s",
        "property timeout is 1 s at federate planner and 100 ms at",
    ),
]


@pytest.mark.parametrize("edit", EDITS, ids=[words for _, _, words in EDITS])
def test_another_program_is_refused(bench: Bench, edit: tuple[str, str, str]) -> None:
    federation = of(bench)
    before, after, words = edit
    assert words in other(federation, PROGRAM.replace(before, after))
    # The right one still finds its place.
    federation.start("planner")
    outcomes = federation.finish()
    assert [outcome.code for outcome in outcomes.values()] == [0, 0, 0], outcomes
    assert outcomes["planner"].out == "got 6\n"


@pytest.mark.parametrize(
    ("key", "here", "there"),
    [
        ("timeout", "1 s", "100 ms"),
        ("keepalive", "true", "false"),
        ("coordination", "decentralized", "centralized"),
        ("DNET", "false", "true"),
    ],
)
def test_other_properties_are_refused(bench: Bench, key: str, here: str, there: str) -> None:
    federation = of(bench)
    told = other(federation, PROGRAM, "--property", f"{key}={here}")
    assert f"  - property {key} is {here} at federate planner and {there} at the RTI\n" in told
    federation.start("planner")
    assert [outcome.code for outcome in federation.finish().values()] == [0, 0, 0]


def test_an_rti_with_another_coordination_refuses_all(bench: Bench) -> None:
    federation = bench.by_hand(
        PROGRAM, "camera", "planner", options=["--property", "coordination=decentralized"]
    )
    words = "property coordination is centralized at federate {} and decentralized at the RTI"
    for name, outcome in federation.finish("camera", "planner").items():
        assert outcome.code == 1
        outcome.assert_one_error(words.format(name))
    rti = federation.members["rti"]
    rti.send_signal(signal.SIGINT)
    assert finish(rti).code == 130


def test_what_a_machine_may_have_of_its_own_is_not_compared(bench: Bench) -> None:
    (bench.folder / "robot").mkdir()
    text = PROGRAM.replace("timer t", "\n  // every 20 ms\n  timer t").replace(
        "+= 1", "+=  1 # one\n"
    )
    (bench.folder / "robot" / "Other.lf").write_text(text)
    federation = of(bench)
    options = ["--workers", "2", "--spin", "off", "--store-limit", "64MB"]
    command = ["federate", *options, "robot/Other.lf", "planner", "--rti", federation.address]
    planner = finish(bench.call(*command, environment={"HPRM_FEDERATION_ID": federation.id}))
    assert (planner.code, planner.out) == (0, "got 6\n"), planner
    assert [outcome.code for outcome in federation.finish().values()] == [0, 0]


TRANSIENT = """
target Python { timeout: 60 s }
reactor Source {
  output out
  timer t(0, 10 ms)
  reaction(t) -> out {= out.set(1) =}
}
reactor Mid {
  input inp
  output out
  reaction(inp) -> out {= out.set(inp.value) =}
}
reactor Sink {
  input inp
  reaction(inp) {=
    print(inp.value, flush=True)
    if inp.value == 200:
        request_stop()
  =}
}
federated reactor {
  source = new Source()
  @transient
  mid = new Mid()
  sink = new Sink()
  source.out -> mid.inp
  mid.out -> sink.inp
}
"""


def test_another_version_of_a_transient_federate_takes_over(bench: Bench) -> None:
    federation = bench.by_hand(TRANSIENT, "mid", "source", "sink")
    hear(federation.members["sink"].stdout, "1\n")
    new = TRANSIENT.replace(
        "reaction(inp) -> out {= out.set(inp.value) =}",
        "state n = 198\n  timer t(0, 1 ms)\n  reaction(t) {= =}\n"
        "  reaction(inp) -> out {= self.n += inp.value; out.set(self.n) =}",
    )
    (bench.folder / "Main.lf").write_text(new)
    old = federation.members["mid"]
    federation.start("mid")
    assert finish(old).code == 0
    outcomes = federation.finish()
    assert [outcome.code for outcome in outcomes.values()] == [0, 0, 0, 0], outcomes
    # The old version sends 1, the new one what it has added to 198.
    assert "\n1\n199\n200\n" in outcomes["sink"].out


def test_a_transient_federate_with_other_ports_is_refused(bench: Bench) -> None:
    federation = bench.by_hand(TRANSIENT, "mid", "source", "sink")
    hear(federation.members["sink"].stdout, "1\n")
    (bench.folder / "Main.lf").write_text(
        TRANSIENT.replace("out {= out.set(inp.value) =}", "out {= =} output x")
    )
    first = federation.members["mid"]
    federation.start("mid")
    refused = federation.finish("mid")["mid"]
    assert refused.code == 1
    refused.assert_one_error("port mid.x is in the program of federate mid, not in that of the RTI")
    assert first.poll() is None, "the one that runs goes on"
    federation.members["rti"].send_signal(signal.SIGINT)
    assert finish(first).code == 0
    federation.finish("source", "sink", "rti")


def test_a_module_beside_the_program_is_compared(bench: Bench) -> None:
    text = PROGRAM.replace("reactor Camera {", "preamble {= import helper =}\nreactor Camera {", 1)
    (bench.folder / "helper.py").write_text("X = 1\n")
    (bench.folder / "elsewhere").mkdir()
    (bench.folder / "elsewhere" / "Main.lf").write_text(text)
    (bench.folder / "elsewhere" / "helper.py").write_text("X = 2\n")
    federation = bench.by_hand(text, "camera")
    command = ["federate", "elsewhere/Main.lf", "planner", "--rti", federation.address]
    planner = finish(bench.call(*command, environment={"HPRM_FEDERATION_ID": federation.id}))
    planner.assert_one_error("  - module helper differs\n")
    # A machine need not have a module at all, as long as what runs there does without.
    federation.start("planner")
    assert [outcome.code for outcome in federation.finish().values()] == [0, 0, 0]
