"""The frame log: which frames each federate and the RTI sent and received.

The handbook has it in docs/howto/debugging.md.
"""

from __future__ import annotations

import re

import pytest
from processes import COORDINATIONS, Bench, finish

PROGRAM = """\
target Python { coordination: COORDINATION, timeout: 20 ms }
reactor Camera {
  output image
  timer t(0, 10 ms)
  reaction(t) -> image {= image.set("a secret") =}
}
reactor Planner {
  input image
  reaction(image) {= pass =}
}
federated reactor {
  camera = new Camera()
  planner = new Planner()
  camera.image -> planner.image
}
"""

LINE = re.compile(
    r"(?P<time>[+-]\d+\.\d{6}|\d\d:\d\d:\d\d\.\d{6})  "
    r"(?P<me>\w+) (?P<way>to|from) (?P<other>\w+)  (?P<kind>\w+)(?P<rest>.*)"
)
CHANNEL = "  camera.image -> planner.image  "


def program(bench: Bench, coordination: str) -> None:
    (bench.folder / "Main.lf").write_text(PROGRAM.replace("COORDINATION", coordination))


def parsed(log: str) -> list[dict[str, str]]:
    """The lines of a log, without the names that a launcher puts before them."""
    lines = [LINE.fullmatch(re.sub(r"^\[\w+\] ", "", line)) for line in log.splitlines()]
    assert all(lines), log
    return [line.groupdict() for line in lines if line]


def logged(bench: Bench, coordination: str, *options: str) -> list[dict[str, str]]:
    """The lines that a run appends to a file."""
    program(bench, coordination)
    run = bench.call("run", "--log-frames-to", "frames.log", *options, "Main.lf")
    outcome = finish(run)
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    return parsed((bench.folder / "frames.log").read_text())


def of(lines: list[dict[str, str]], me: str, way: str, other: str) -> list[str]:
    """The frames that one has sent to or received from another: kind, and what is said of it."""
    ends = (me, way, other)
    return [
        line["kind"] + line["rest"]
        for line in lines
        if (line["me"], line["way"], line["other"]) == ends
    ]


@pytest.mark.parametrize("threads", [False, True], ids=["processes", "threads"])
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_each_frame_is_logged_where_it_is_sent_and_where_it_is_received(
    bench: Bench, coordination: str, threads: bool
) -> None:
    lines = logged(bench, coordination, *(["--in-process"] if threads else []))
    # Threads take the RTI for their grants and messages; processes on one machine read boards.
    by_rti = coordination == "centralized" and threads
    through, source = ("rti", "rti") if by_rti else ("planner", "camera")
    sent = [text for text in of(lines, "camera", "to", through) if text.startswith("Message")]
    size = "by reference" if threads else r"\d+ bytes"
    for text, tag in zip(sent, [0, 10_000_000, 20_000_000], strict=True):
        assert re.fullmatch(rf"Message  \({tag} ns, 0\){CHANNEL}{size}", text), text
    received = of(lines, "planner", "from", source)
    assert [text for text in received if text.startswith("Message")] == sent
    # What one end sends, the other one receives in the same order, until all is over.
    for federate in ("camera", "planner"):
        at_rti = of(lines, "rti", "from", federate)
        assert at_rti == of(lines, federate, "to", "rti")[: len(at_rti)]
        assert at_rti[0] == f"Hello  {federate}"
        at_federate = of(lines, federate, "from", "rti")
        assert at_federate == of(lines, "rti", "to", federate)[: len(at_federate)]
        assert "Start  (0 ns, 0)" in at_federate
    assert "secret" not in str(lines)
    assert by_rti == any("TagAdvanceGrant" in text for text in of(lines, "rti", "to", "planner"))


def test_times_count_from_the_start_as_soon_as_it_is_known(bench: Bench) -> None:
    lines = [line for line in logged(bench, "centralized") if line["me"] == "camera"]
    kinds = [line["kind"] for line in lines]
    start = kinds.index("Start")
    assert all(":" in line["time"] for line in lines[:start])
    times = [float(line["time"]) for line in lines[start:]]
    assert times == sorted(times)
    second = next(line for line in lines if "Message  (10000000 ns" in line["kind"] + line["rest"])
    assert float(second["time"]) >= 0.01


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_filter_selects_federates_and_kinds(bench: Bench, coordination: str) -> None:
    only = logged(bench, coordination, "--log-frames=Message")
    assert only and {line["kind"] for line in only} == {"Message"}
    only = logged(bench, coordination, "--log-frames=planner,nexteventtag,Loaded")
    assert {line["kind"] for line in only} <= {"NextEventTag", "Loaded"}
    assert all("planner" in (line["me"], line["other"]) for line in only)
    assert of(only, "planner", "to", "rti")[0] == "Loaded"


def test_without_a_file_lines_go_to_the_standard_error(bench: Bench) -> None:
    program(bench, "centralized")
    outcome = finish(bench.call("run", "--log-frames", "Main.lf"))
    assert (outcome.code, outcome.out) == (0, "")
    assert re.search(r"^\[planner\] \S+  planner from rti  Start", outcome.err, re.M), outcome.err
    assert parsed(outcome.err)


def test_a_run_empties_the_file_and_the_variables_append(bench: Bench) -> None:
    first = logged(bench, "centralized", "--log-frames=Start")
    again = logged(bench, "centralized", "--log-frames=Start")
    assert len(again) == len(first)
    path = str(bench.folder / "frames.log")
    environment = {"HPRM_LOG_FRAMES": "Start", "HPRM_LOG_FRAMES_TO": path}
    assert finish(bench.call("run", "Main.lf", environment=environment)).code == 0
    assert len(parsed((bench.folder / "frames.log").read_text())) == 2 * len(first)


@pytest.mark.parametrize("word", ["camrea", "Mesage", ""])
def test_a_word_that_names_nothing_is_one_error(bench: Bench, word: str) -> None:
    program(bench, "centralized")
    filters = f"camera,{word}"
    for options in (["--log-frames-to=frames.log", f"--log-frames={filters}"], []):
        environment = {} if options else {"HPRM_LOG_FRAMES": filters}
        outcome = finish(bench.call("run", *options, "Main.lf", environment=environment))
        assert outcome.code == 1, outcome.err
        outcome.assert_one_error(f"`{word}` is no federate of Main and no kind of frames")
        where = "--log-frames" if options else "the environment variable HPRM_LOG_FRAMES"
        assert outcome.err.startswith(f"error: {where}={filters} is wrong: "), outcome.err
    assert not (bench.folder / "frames.log").exists()


def test_an_empty_filter_is_an_error(bench: Bench) -> None:
    program(bench, "centralized")
    outcome = finish(bench.call("run", "--log-frames=", "Main.lf"))
    assert outcome.code == 2
    assert "a value is required for '--log-frames[=<FILTER>]'" in outcome.err


def test_a_file_that_cannot_be_written_is_one_error(bench: Bench) -> None:
    program(bench, "centralized")
    outcome = finish(bench.call("run", "--log-frames-to=nowhere/frames.log", "Main.lf"))
    assert outcome.code == 1
    outcome.assert_one_error("nowhere/frames.log", "No such file or directory")


def test_a_program_without_federates_has_no_frames(bench: Bench) -> None:
    (bench.folder / "Main.lf").write_text("target Python\nmain reactor {}\n")
    outcome = finish(bench.call("run", "--log-frames", "Main.lf"))
    assert outcome.code == 1
    outcome.assert_one_error("Main.lf has no frames to log")
