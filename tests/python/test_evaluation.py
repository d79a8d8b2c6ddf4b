"""The paper's evaluation: its arithmetic, its page, and a little of all that it measures.

Nothing is timed here. `tests/ros2` stands for ROS 2.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))

import evaluate
from evaluation import inference, page, record
from evaluation.drives import CONTENDERS, ROLES, dataflow, models
from evaluation.experiment import ExperimentError
from evaluation.record import Cell, Record, RecordError, load

ROOT = Path(__file__).resolve().parents[2]
MACHINE = {"date": "2026-01-01T00:00:00Z", "cpu": "a < b & c", "cpus": 2}


def made(experiment: str, *cells: Cell, **more: Any) -> Record:
    return Record(experiment, "full", MACHINE, 61.4, list(cells), **more)


def cell(contender: str, case: str, *values: float) -> Cell:
    return Cell(contender, case, "ms", dict(enumerate(values)))


def run(*words: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    argv = [sys.executable, str(ROOT / "bench" / "evaluate.py"), "--out", str(folder), *words]
    environment = os.environ | variables
    return subprocess.run(
        argv, capture_output=True, text=True, timeout=400, check=False, env=environment
    )


def without(module: str, folder: Path) -> str:
    """A folder for PYTHONPATH with which a module cannot be imported, wherever it is installed."""
    (folder / "missing").mkdir()
    (folder / "missing" / f"{module}.py").write_text("raise ImportError\n")
    return str(folder / "missing")


# Records.


def test_a_record_is_the_same_after_it_was_written_and_read(tmp_path: Path) -> None:
    cells = [cell("hprm", "1 MB", 1.0, 2.0), cell("ros2", "1 MB", 3.0)]
    cells[0].p99, cells[0].samples, cells[0].counts = {0: 4.0}, [1.0, 2.0], {"messages": 7}
    saved = made("gather", *cells, absent={"ray": "no wheel"}, notes=["a note"])
    assert saved.save(tmp_path) == tmp_path / "gather.json"
    assert load(tmp_path, "gather") == saved


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "there is no "),
        ("{", "cannot be read: "),
        ("[]", "cannot be read: "),
        ('{"format": 0, "experiment": "gather"}', "was written by another version"),
        ('{"format": 1, "experiment": "gather", "cells": [{}]}', "cannot be read: "),
        ('{"format": 1, "experiment": "store"}', "was written by another version"),
    ],
)
def test_a_file_without_a_record_is_an_error_that_says_what_to_do(
    text: str | None, said: str, tmp_path: Path
) -> None:
    if text is not None:
        (tmp_path / "gather.json").write_text(text)
    with pytest.raises(RecordError, match=re.escape(said)) as caught:
        load(tmp_path, "gather")
    assert str(tmp_path / "gather.json") in str(caught.value)
    assert str(caught.value).endswith("hint: measure it: python bench/evaluate.py --only gather")


def test_ratios_are_taken_within_a_repetition() -> None:
    both = made("gather", cell("slow", "1 MB", 10, 80, 30), cell("quick", "1 MB", 1, 10))
    # Medians of all repetitions would give 30 / 5.5.
    assert both.ratio("slow", "quick", "1 MB") == 9.0
    assert both.ratio("slow", "nobody", "1 MB") is None
    assert both.ratio("slow", "quick", "5 MB") is None


# What frames amount to.


def told(latencies: list[int], agent: list[int], detector: list[int]) -> dict[str, Any]:
    return {
        "simulator": {"latencies_ns": latencies},
        "agent": {"computed_ns": agent},
        "detector": {"computed_ns": detector},
    }


def test_communication_is_what_is_left_without_the_longer_computation() -> None:
    said = told([9, 4_000_000, 10_000_000], [1_000_000, 5_000_000], [2_000_000, 1_000_000])
    took, shares = inference.of_frames(said, warm_up=1)
    assert took.tolist() == [4.0, 10.0]
    assert shares.tolist() == [0.5, 0.5]


@pytest.mark.parametrize("said", [told([1, 2], [1], [1]), told([1, 2, 3, 4], [1], [1, 2, 3, 4])])
def test_a_journey_that_ends_too_soon_is_an_error(said: dict[str, Any]) -> None:
    with pytest.raises(ExperimentError, match="ended too soon, after"):
        inference.of_frames(said, warm_up=2)


def test_contenders_that_drive_another_way_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    ways = iter(["frame 3: 1.0 m", "frame 3: 2.0 m"])

    def drive(launcher: Any, contender: Any, frames: int) -> list[dict[str, Any]]:
        said = told([10] * frames, [5] * frames, [5] * frames)
        said["simulator"] |= {"drove": next(ways), "models": "agent a, detector b"}
        return [{"role": role} | it for role, it in said.items()]

    monkeypatch.setattr(inference.DrivingLauncher, "drive", drive)
    with pytest.raises(ExperimentError, match="contenders drove different ways"):
        inference.measure(evaluate.Effort(quick=True))


def test_networks_drive_where_their_files_are(tmp_path: Path) -> None:
    assert models(tmp_path) == []
    (tmp_path / "detector.onnx").touch()
    assert models(tmp_path) == ["--detector", "network"]
    (tmp_path / "policy.onnx").touch()
    assert models(tmp_path) == ["--agent", "policy", "--detector", "network"]


def test_the_dataflow_has_an_output_for_every_input() -> None:
    nodes = {node["id"]: node for node in dataflow()["nodes"]}
    assert list(nodes) == list(ROLES)
    sources = [source.split("/") for node in nodes.values() for source in node["inputs"].values()]
    outputs = {(name, output) for name, node in nodes.items() for output in node["outputs"]}
    assert {(node, output) for node, output in sources} == outputs


# The page.


def test_the_page_has_what_the_paper_has_what_was_measured_and_why_something_is_missing() -> None:
    ours = [cell("hprm centralized", "50 MB", 6.0), cell("hprm decentralized", "50 MB", 5.0)]
    gathered = made("gather", *ours, cell("ros2", "50 MB", 500.0), absent={"ray": "no <wheel>"})
    gathered.command = evaluate.Effort(True, 2, ["hprm", "ros2 +"]).command("gather")
    text = page.html({"gather": gathered}, {"store": "there is no file"}, evaluate.EXPERIMENTS)
    assert "a &lt; b &amp; c" in text
    assert "<li>ray: no &lt;wheel&gt;</li>" in text
    assert "The object store (store): there is no file" in text
    command = "--only gather --quick --repetitions 2 --contenders &#x27;hprm,ros2 +&#x27;"
    assert f"{command}</code> 2026-01-01T00:00:00Z, 1 min 1 s." in text
    # The claim of the paper, and the ratio of here: 500 to 5.
    assert re.search(r"50 MB: “ros2”[^\n]*<td>173x</td><td>100x</td>", text)
    assert re.search(r"50 MB: “ros2 \+ shm”[^\n]*<td>3.0x</td><td>not measured</td>", text)
    assert text.count("<svg") == 1 and "nan" not in text
    assert "quick form" not in text


def test_every_experiment_has_numbers_of_the_paper_and_says_what_differs() -> None:
    for experiment in evaluate.EXPERIMENTS:
        case = inference.CASE if experiment.name == "inference" else "10 MB"
        counts = {"messages": 10, "unnoticed": 1, "seconds": 1.0}
        one = Cell("hprm decentralized", case, "ms", {0: 2.0}, {0: 3.0}, [2.0, 3.0], counts)
        section = experiment.section(made(experiment.name, one))
        assert all(len(row) == len(section.paper.columns) for row in section.paper.rows)
        for table in section.tables:
            assert table.rows and all(len(row) == len(table.columns) for row in table.rows)
        assert section.claims and section.differences


# The command.


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--only", "gathering"],
            "argument --only: 'gathering': must be some of gather, inference",
        ),
        (["--only", ","], "argument --only: ',': must be some of gather, inference"),
        (["--repetitions", "0"], "argument --repetitions: '0': must be a whole number above 0"),
        (["--only", "store", "--contenders", "nobody"], "error: store: no contender has one of"),
        (["--only", "ordering", "--contenders", "nobody"], "error: ordering: no contender has one"),
        (["--only", "inference", "--contenders", "nobody"], "error: inference: no contender has"),
        (["--page"], "has no results\n  hint: measure first: make evaluation\n"),
    ],
)
def test_bad_input_is_one_clear_error(words: list[str], said: str, tmp_path: Path) -> None:
    done = run(*words, folder=tmp_path / "out")
    assert done.returncode != 0
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.rglob("*.html"))


def test_a_folder_that_cannot_be_written_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = run("--quick", "--only", "serialization", folder=tmp_path / "file" / "out")
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: cannot write into {tmp_path / 'file' / 'out'}: ")
    assert "Traceback" not in done.stderr


def test_an_experiment_without_results_says_why(tmp_path: Path) -> None:
    words = ["--quick", "--only", "serialization", "--contenders", "ros2_numpy"]
    done = run(*words, folder=tmp_path / "out", PYTHONPATH=without("ros2_numpy", tmp_path))
    assert done.returncode == 1
    assert "error: serialization: nothing could be measured\n  ros2_numpy: Python" in done.stderr
    assert "Traceback" not in done.stderr
    assert list((tmp_path / "out").iterdir()) == []


def test_the_quick_form_measures_everything_and_writes_the_page(tmp_path: Path) -> None:
    done = run("--quick", folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    records = {name: load(tmp_path, name) for name in evaluate.NAMES}
    assert [it.absent for it in records.values()] == [{}] * len(records)
    assert all(cell.values for it in records.values() for cell in it.cells)
    assert records["gather"].cases() == ["1 MB", "10 MB"]
    assert set(inference._QUICK) == set(records["inference"].contenders())
    assert "All contenders drove the same way: frame 20: " in records["inference"].notes[0]
    tagged = [it for it in records["ordering"].cells if it.contender.startswith("hprm")]
    assert len(tagged) == 4 and all(it.counts["unnoticed"] == 0 for it in tagged)
    text = (tmp_path / "index.html").read_text()
    assert all(f'<h2 id="{name}">' in text for name in evaluate.NAMES)
    assert "The quick form was run" in text
    assert "Experiments without results" not in text
    # From these files alone, the page is written again; what is gone is named.
    record.file_of(tmp_path, "store").unlink()
    again = run("--page", folder=tmp_path)
    assert (again.returncode, again.stderr) == (0, "")
    assert "The object store (store): there is no " in (tmp_path / "index.html").read_text()


def test_a_request_to_end_ends_all_processes_and_leaves_nothing(tmp_path: Path) -> None:
    sessions, out = tmp_path / "sessions", tmp_path / "out"
    sessions.mkdir()
    argv = [sys.executable, str(ROOT / "bench" / "evaluate.py"), "--only", "inference"]
    argv += ["--contenders", "unix", "--out", str(out)]
    variables = os.environ | {"TMPDIR": str(sessions)}
    process = subprocess.Popen(argv, env=variables, stderr=subprocess.PIPE, text=True)
    try:
        # The simulator listens for the controls once its process runs.
        deadline = time.monotonic() + 100
        while not list(sessions.glob("hb-*/control")):
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.01)
        (session,) = sessions.glob("hb-*")
        assert len(of_session(session)) > 1
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, errors) == (130, "stopped\n")
    # What else is there is a mark of ONNX Runtime, which remembers its session.
    left = [*sessions.glob("hb-*"), *out.iterdir()]
    assert left == []
    assert of_session(session) == []


def of_session(session: Path) -> list[str]:
    """The processes that were told of a session by their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # It has ended, or is another user's.
            if str(session).encode() in (process / "environ").read_bytes():
                found.append(process.name)
    return found


def test_ros_2_takes_part_where_it_can_be_imported(tmp_path: Path) -> None:
    (tmp_path / "messages").mkdir()
    variables = {
        "PYTHONPATH": str(ROOT / "tests" / "ros2"),
        "ROS_STAND_IN": str(tmp_path / "messages"),
    }
    words = ["--quick", "--only", "gather,inference", "--contenders", "ros2"]
    done = run(*words, folder=tmp_path, **variables)
    assert done.returncode == 0, done.stdout + done.stderr
    forms = ["ros2", "ros2, array", "ros2 + shm"]
    for name in ("gather", "inference"):
        measured = load(tmp_path, name)
        assert (measured.absent, measured.contenders()) == ({}, forms)


def test_a_peer_that_is_not_there_is_named_with_the_reason(tmp_path: Path) -> None:
    words = ["--quick", "--only", "inference", "--contenders", "ros2,in one process"]
    done = run(*words, folder=tmp_path, PYTHONPATH=without("rclpy", tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    measured = load(tmp_path, "inference")
    assert measured.contenders() == ["hprm in one process"]
    assert list(measured.absent) == ["ros2", "ros2, array", "ros2 + shm"]
    assert "cannot import rclpy; if ROS 2 is there, source its setup" in measured.absent["ros2"]
    assert "ros2 + shm: Python cannot import" in (tmp_path / "index.html").read_text()


def test_programs_have_no_mistakes() -> None:
    programs = sorted(str(path) for path in (ROOT / "bench" / "driving").glob("*.lf"))
    assert len(programs) == 2
    command = [str(Path(sys.executable).with_name("hprm")), "check", *programs]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr


def test_every_transport_of_the_driving_application_has_a_module() -> None:
    edges = ROOT / "bench" / "driving" / "worker" / "edges"
    modules = {path.stem for path in edges.glob("[a-z]*.py")}
    assert {it.transport for it in CONTENDERS if it.transport} == modules
