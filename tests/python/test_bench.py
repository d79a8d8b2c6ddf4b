"""The comparison with other middleware: its arithmetic, its protocol, and how it ends processes.

Nothing is timed here, and no peer is needed.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench" / "peers"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench" / "peers" / "worker"))

import contenders as who
import environments
import goals
import launch
import page
import plan
import script
import tables
from figures import Figure, Measurements, Spread, spread, value_of

from hprm._hprm import ArrivedValue, describe_value, encode

BENCH = Path(who.__file__).parent
LATENCY = Figure("W2", who.SAME, 64)


def latency(*microseconds: float) -> dict[str, Any]:
    """A result whose one-way latencies are these."""
    return {
        "workload": "W2",
        "size": 64,
        "times_ns": [round(2000 * one_way) for one_way in microseconds],
    }


def rate(thousands: float, received: Sequence[int] = (1000,), sent: int = 1000) -> dict[str, Any]:
    seconds = min(received) / 1000 / thousands
    return {
        "workload": "W5",
        "size": 1024,
        "sent": sent,
        "received": list(received),
        "seconds": seconds,
    }


def measured(**values: Sequence[float]) -> Measurements:
    """One-way latencies by contender (underscores are spaces), one value for each repetition."""
    measurements = Measurements()
    for name, repetitions in values.items():
        for at, microseconds in enumerate(repetitions):
            result = latency(microseconds)
            measurements.add(who.SAME, name.replace("_", " "), at, result)
    return measurements


def test_a_latency_is_half_of_a_round_trip_and_its_99th_percentile_was_measured() -> None:
    value = value_of(latency(*range(1, 201)))
    assert (value.value, value.p99, value.rounds) == (100.5, 198.0, 200)


def test_a_round_counts_in_milliseconds_as_it_is() -> None:
    value = value_of({"workload": "W1", "size": 1_000_000, "times_ns": [1_500_000, 2_500_000]})
    assert (value.value, value.p99) == (2.0, 2.5)


def test_a_rate_is_that_of_the_slowest_receiver_and_tells_what_was_lost() -> None:
    value = value_of(rate(10.0, received=(1000, 900), sent=1000))
    assert value.value == pytest.approx(10.0)
    assert value.lost == 100


def test_a_spread_is_the_median_with_the_extremes() -> None:
    assert spread([3.0, 1.0, 2.0]) == Spread(2.0, 1.0, 3.0)


def test_ratios_are_taken_within_a_repetition() -> None:
    # Medians of all repetitions would give 20 / 20; the machine was slow for both in the second.
    measurements = measured(ours=[10, 40, 20], theirs=[20, 80, 10])
    assert measurements.ratio(LATENCY, "ours", "theirs") == Spread(0.5, 0.5, 2.0)


def test_a_repetition_that_one_side_lacks_gives_no_ratio() -> None:
    measurements = measured(ours=[10, 40], theirs=[20])
    assert measurements.ratio(LATENCY, "ours", "theirs") == Spread(0.5, 0.5, 0.5)
    assert measurements.ratio(LATENCY, "ours", "nobody") is None


def test_the_best_rival_may_be_another_one_in_each_repetition() -> None:
    measurements = measured(ours=[10, 10], one=[20, 40], two=[40, 20])
    best = measurements.ratio_to_best(LATENCY, "ours", ["one", "two"], most=False)
    assert best == Spread(0.5, 0.5, 0.5)
    most = measurements.ratio_to_best(LATENCY, "ours", ["one", "two"], most=True)
    assert most == Spread(0.25, 0.25, 0.25)


@pytest.mark.parametrize(
    ("ours", "word"), [([8, 8, 8], "met"), ([8, 9, 9], "missed"), ([], "not measured")]
)
def test_a_goal_is_judged_by_the_median_of_the_ratios(ours: list[float], word: str) -> None:
    measurements = measured(hprm_centralized=ours, iceoryx2=[10, 10, 10])
    verdicts = goals.judge(measurements, ["W2"])
    words = [
        verdict.word
        for verdict in verdicts
        if verdict.goal.figure == LATENCY
        and (verdict.goal.contender, verdict.goal.rival) == ("hprm centralized", "iceoryx2")
    ]
    assert words == [word]


def test_a_rate_has_to_be_ahead_of_every_peer_but_not_of_the_limit() -> None:
    measurements = Measurements()
    for name, thousands in {
        "hprm centralized": 50,
        "zenoh tcp": 40,
        "limit": 90,
        "hprm spinning": 95,
    }.items():
        measurements.add(who.FAN, name, 0, rate(thousands))
    verdict = next(
        verdict
        for verdict in goals.judge(measurements, ["W5"])
        if (verdict.goal.group, verdict.goal.contender) == (who.FAN, "hprm centralized")
    )
    assert verdict.word == "met"
    assert verdict.measured is not None
    assert verdict.measured.median == pytest.approx(1.25)


def test_goals_are_about_contenders_and_figures_that_exist() -> None:
    names = {contender.name for contender in who.CONTENDERS} | {goals.BEST_PEER, ""}
    effort = plan.QUICK
    for goal in goals.goals():
        assert {goal.contender, goal.rival} <= names, goal
        cells = plan.cells(goal.group, plan.WORKLOADS, effort)
        sizes = [cell["size"] for cell in cells if cell["workload"] == goal.workload]
        assert goal.workload == "W4" or goal.case in sizes, goal


def test_tables_show_every_contender_the_best_first() -> None:
    measurements = measured(slow=[30, 32, 31], limit=[10, 10, 10])
    values, ratios = tables.all_tables(measurements, ["W2"])
    assert values.rows == [["limit", "10 (10–10) / 10"], ["slow", "31 (30–32) / 31"]]
    assert ratios.rows == [["slow", "3.1 (3–3.2)"]]
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(tables.shown(values))
    assert "64 B" in (text := console.export_text())
    assert "10 (10–10) / 10" in text


def test_the_page_is_well_formed_and_has_a_picture_for_each_table_of_values() -> None:
    measurements = measured(hprm_centralized=[30, 32], limit=[10, 11])
    shown = tables.all_tables(measurements, ["W2"])
    text = page.html(measurements, ["W2"], shown, {"cpu": "a < b & c"}, ["a note <"])
    assert "a &lt; b &amp; c" in text
    assert "a note &lt;" in text
    pictures = page.pictures(measurements, ["W2"])
    assert len(pictures) == 1
    root = ElementTree.fromstring(pictures[0])
    assert root.tag.endswith("svg")
    shown_names = {element.text for element in root.iter() if element.tag.endswith("text")}
    assert {"hprm centralized", "limit"} <= shown_names


def test_every_group_has_cells_and_every_contender_a_way_to_start() -> None:
    for group in who.GROUPS:
        assert plan.cells(group, plan.WORKLOADS, plan.QUICK), group
        assert who.chosen(group, None), group
    for contender in who.CONTENDERS:
        assert hasattr(launch.Launcher, f"_{contender.kind}"), contender
        known = {None, *environments.REQUIREMENTS, *environments.IMPORTED}
        assert contender.environment in known, contender
        if contender.transport and who.GATHER in contender.groups:
            module = BENCH / "worker" / "transports" / f"{contender.transport}.py"
            assert module.exists(), contender


def test_a_part_of_the_workloads_needs_a_part_of_the_groups() -> None:
    assert plan.groups_of(["W1b"]) == [who.GATHER]
    assert {cell["workload"] for cell in plan.cells(who.GATHER, ["W1b"], plan.QUICK)} == {"W1b"}
    assert plan.groups_of(["W5"]) == [who.APART, who.FAN]


def test_what_needs_two_processors_is_left_out_where_there_is_one() -> None:
    assert [group for group in who.GROUPS if not plan.possible(group, 1)] == [who.APART]
    assert all(plan.possible(group, 2) for group in who.GROUPS)


# What hub and nodes say.


def cell(workload: str, size: int, rounds: int = 3) -> script.Cell:
    return script.Cell(workload, size, rounds, budget_s=0.05, warm_up=2)


def talk(
    cells: list[script.Cell], nodes: Sequence[Callable[[Any], Any]]
) -> tuple[list[dict[str, Any]], list[Any]]:
    """Lets a hub talk to nodes that are functions; the results, and the messages."""
    out = io.StringIO()
    hub = script.messages(cells, out)
    sent: list[Any] = []
    step = next(hub, None)
    while step is not None:
        message, answered = step
        sent.append(bytes(memoryview(message).cast("B")))
        replies = [node(message) for node in nodes]
        try:
            step = hub.send(replies if answered else None)
        except StopIteration:
            step = None
    return [json.loads(line) for line in out.getvalue().splitlines()], sent


def test_nodes_answer_what_the_hub_asks_for() -> None:
    nodes = [script.Answers() for _ in range(4)]
    cells = [cell("W1", 1600), cell("W1b", 1600), cell("W2", 64), cell("W5", 1024)]
    results, sent = talk(cells, [node.answer for node in nodes])
    assert [result["workload"] for result in results] == ["W1", "W1b", "W2", "W5"]
    assert all(len(result["times_ns"]) == 3 for result in results[:3])
    assert results[3]["received"] == [results[3]["sent"]] * 4
    assert all(node.stopped for node in nodes)
    numbers = [int.from_bytes(message[:8], "little") for message in sent[:-1]]
    assert numbers == list(range(1, len(sent)))


def test_a_copy_is_a_copy_and_an_echo_is_not() -> None:
    answers = script.Answers()
    array = np.zeros((10, 2))
    array.reshape(-1)[:2].view(np.int64)[:] = 1, script.COPY
    copy = answers.answer(array)
    assert copy is not array
    np.testing.assert_array_equal(copy.view(np.uint8), array.view(np.uint8))
    array.reshape(-1)[:2].view(np.int64)[:] = 2, script.ECHO
    assert answers.answer(array) is array


def test_an_old_reply_ends_the_measurement() -> None:
    replies: list[bytes] = []

    def late(message: Any) -> Any:
        replies.append(bytes(message[:64]))
        return replies[0]

    with pytest.raises(script.WrongReply, match="answered message 1 instead of 2"):
        talk([cell("W2", 64)], [late])


def test_a_changed_copy_ends_the_measurement() -> None:
    def changed(message: Any) -> Any:
        copy = message.copy()
        copy[-1, -1] += 1
        return copy

    with pytest.raises(script.WrongReply, match="node 1 sent something else"):
        talk([cell("W1", 1600)], [lambda message: message.copy(), changed])


def test_what_is_lost_shows() -> None:
    answers = script.Answers()
    seen = 0

    def lossy(message: Any) -> Any:
        nonlocal seen
        seen += 1
        return None if seen == 1 else answers.answer(message)

    results, _ = talk([cell("W5", 1024)], [lossy])
    assert value_of(results[0]).lost == 1


# How processes end.

CHILDREN = """
import os, subprocess, sys, time
sys.path.insert(0, sys.argv[1])
import descendants

descendants.adopt_orphans()
# A daemon: its parent ends at once, and it ignores the first request to end.
daemon = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"
start = f"subprocess.Popen([sys.executable, '-c', {daemon!r}], stdout=-3, stderr=-3)"
parent = f"import subprocess, sys; print({start}.pid)"
done = subprocess.run([sys.executable, "-c", parent], capture_output=True, text=True, check=True)
plain = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
assert sorted(descendants.all_of(os.getpid())) == sorted([int(done.stdout), plain.pid])
descendants.end_all(0.0)
assert descendants.all_of(os.getpid()) == []
print("ended")
"""


def beside_the_harness(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs a program in a process of its own; its argument is the folder of the harness."""
    return subprocess.run(
        [sys.executable, "-c", code, str(BENCH)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_daemons_and_children_end_with_a_session() -> None:
    done = beside_the_harness(CHILDREN)
    assert done.stdout == "ended\n", done.stderr


def test_a_session_that_fails_says_why_and_leaves_nothing(tmp_path: Path) -> None:
    before = set(os.listdir("/dev/shm"))
    broken = who.Contender("broken", "processes", (who.SAME,), transport="does_not_exist")
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import contenders as who, launch, plan, pathlib\n"
        "launcher = launch.Launcher(pathlib.Path('hprm'), 20.0)\n"
        f"broken = who.{broken!r}\n"
        "try:\n"
        "    launcher.run(broken, 'same', plan.cells('same', ['W2'], plan.QUICK))\n"
        "except launch.Failed as failure:\n"
        "    print(failure)\n"
    )
    done = beside_the_harness(code, TMPDIR=str(tmp_path))
    assert "No module named 'transports.does_not_exist'" in done.stdout, done.stderr
    assert os.listdir(tmp_path) == []
    assert not [name for name in set(os.listdir("/dev/shm")) - before if "hprmbench" in name]


IMPATIENT = """
import os, signal, sys
sys.path.insert(0, sys.argv[1])
import launch

signal.signal(signal.SIGTERM, signal.default_int_handler)
try:
    with launch.undisturbed():
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGTERM)
        print("cleaned up")
except KeyboardInterrupt:
    print("stopped")
"""


def test_a_second_request_to_end_waits_for_the_clean_up_of_the_first() -> None:
    done = beside_the_harness(IMPATIENT)
    assert (done.stdout, done.stderr) == ("cleaned up\nstopped\n", "")


# The whole of it, with contenders that need nothing but the package.


def test_programs_have_no_mistakes() -> None:
    programs = sorted(str(path) for path in (BENCH / "programs").glob("*.lf"))
    assert programs
    command = [str(Path(sys.executable).with_name("hprm")), "check", *programs]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


def test_a_run_measures_every_contender_and_writes_a_page(tmp_path: Path) -> None:
    names = ["hprm centralized", "hprm decentralized", "unix + pickle"]
    command = [sys.executable, str(BENCH / "run.py"), "--quick", "--out", str(tmp_path)]
    command += ["--only", "W1b,W5", "--contenders", ",".join(names)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "bench.json").read_text())
    assert not [note for note in document["notes"] if note.startswith("failed")]
    measured = {(one["contender"], one["workload"], one["group"]) for one in document["figures"]}
    workloads = {("W1b", who.GATHER), ("W5", who.FAN)}
    if len(os.sched_getaffinity(0)) > 1:
        workloads.add(("W5", who.APART))
    assert measured == {(name, *workload) for name in names for workload in workloads}
    assert {goal["workload"] for goal in document["goals"]} == {"W1b", "W5"}
    assert all(name in (tmp_path / "bench.html").read_text() for name in names)


# What the package offers for it.


def test_a_value_is_described_without_its_large_buffers_as_it_travels() -> None:
    value = {"frame": 7, "pixels": np.arange(100_000.0)}
    head, parts = encode(value)
    assert describe_value(value) == head
    assert [len(part) for part in parts] == [800_000]


def test_what_has_arrived_may_be_decoded_again_and_again() -> None:
    value = [np.arange(100_000.0), "text", np.arange(3)]
    arrived = ArrivedValue(value)
    for _ in range(2):
        big, text, small = arrived.decode()
        np.testing.assert_array_equal(big, value[0])
        np.testing.assert_array_equal(small, value[2])
        assert text == "text"
        assert not big.flags.writeable
