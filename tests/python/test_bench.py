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
import picture_by_size
import plan
import run
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
        if goal.case == goals.EVERY_SIZE:
            assert tuple(sizes) == plan.POWERS, goal
        else:
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


# One picture of all sizes: W6.


def by_size(values: dict[str, dict[int, Sequence[float]]], group: str = who.SAME) -> Measurements:
    """Rounds in microseconds by contender and size, one for each repetition."""
    measurements = Measurements()
    for name, sizes in values.items():
        for size, repetitions in sizes.items():
            for at, microseconds in enumerate(repetitions):
                result = {"workload": "W6", "size": size, "times_ns": [round(1000 * microseconds)]}
                measurements.add(group, name, at, result)
    return measurements


def everywhere(microseconds: float, **others: float) -> dict[int, Sequence[float]]:
    """The same at every size, but for some: `at_64=3.0`."""
    times: dict[int, Sequence[float]] = dict.fromkeys(plan.POWERS, [microseconds])
    return times | {int(name.removeprefix("at_")): [value] for name, value in others.items()}


def verdict_by_size(measurements: Measurements, contender: str) -> goals.Verdict:
    return next(
        verdict
        for verdict in goals.judge(measurements, ["W6"])
        if (verdict.goal.contender, verdict.goal.group) == (contender, who.SAME)
    )


def test_an_array_there_and_16_bytes_back_count_as_a_whole_round() -> None:
    value = value_of({"workload": "W6", "size": 64, "times_ns": [30_000, 10_000, 20_000]})
    assert (value.value, value.rounds) == (20.0, 3)


def test_every_power_of_two_is_measured_the_small_ones_first_and_more_often() -> None:
    for group in (who.SAME, who.APART):
        cells = plan.cells(group, ["W6"], plan.FULL)
        assert [cell["size"] for cell in cells] == [2**power for power in range(6, 27)]
        for cell in cells:
            tenfold = 10 if cell["size"] < 2**20 else 1
            assert cell["rounds"] == plan.FULL.rounds * tenfold
            assert cell["warm_up"] < cell["rounds"]
    assert plan.groups_of(["W6"]) == [who.SAME, who.APART]


def test_a_picture_of_all_sizes_has_few_contenders_and_each_looks_different() -> None:
    options = run.parse(["--only", "W6"])
    taking_part = {
        group: [contender.name for contender in contenders]
        for group, contenders in run.selected(options)
    }
    on_one_core = ["hprm centralized", "hprm decentralized", "limit", "iceoryx2"]
    spinning = ["hprm spinning", "hprm spinning centralized", "limit spinning"]
    busy = [*spinning, "iceoryx2 polling"]
    assert taking_part[who.SAME] == on_one_core
    assert sorted(taking_part[who.APART]) == sorted(on_one_core + busy)
    assert set(picture_by_size.LOOKS) == set(on_one_core + busy)
    assert len(set(picture_by_size.LOOKS.values())) == len(on_one_core + busy)
    # Other workloads of these groups have all contenders, as before.
    assert not any(contender.does("W6") for contender in who.CONTENDERS if "dora" in contender.name)
    assert all(contender.does("W2") for contender in who.CONTENDERS)


def test_long_messages_have_a_session_of_their_own() -> None:
    cells = plan.cells(who.APART, plan.WORKLOADS, plan.QUICK)
    for contender in who.chosen(who.APART, None):
        parts = launch.sessions_of(contender, cells)
        workloads = [sorted({cell["workload"] for cell in part}) for part in parts]
        small = [["W2"], ["W5"]] if contender.ours else [["W2", "W5"]]
        assert workloads == [*small, ["W6"]], contender
        assert max(cell["size"] for cell in parts[0]) == max(plan.SMALL)


def test_sizes_that_are_powers_of_two_are_named_by_them() -> None:
    sizes = (64, 1024, 2**19, 2**20, 2**26, 1_000_000, 25_000_000)
    names = ["64 B", "1 KB", "512 KB", "1 MB", "64 MB", "1 MB", "25 MB"]
    assert [tables.label(size) for size in sizes] == names


def test_sizes_are_rows_and_contenders_columns_in_their_order() -> None:
    measurements = by_size(
        {
            "iceoryx2": {64: [10, 20], 2**20: [100, 100]},
            "hprm centralized": {64: [8, 12], 2**20: [120, 150]},
            "limit": {64: [5, 5]},
        }
    )
    values, ratios = tables.all_tables(measurements, ["W6"])
    assert "a whole round, both processes on one core, µs" in values.title
    assert values.columns == ["", "hprm centralized", "limit", "iceoryx2"]
    assert values.rows == [
        ["64 B", "10 (8–12)", "5 (5–5)", "15 (10–20)"],
        ["1 MB", "135 (120–150)", "-", "100 (100–100)"],
    ]
    assert "multiple of “iceoryx2”" in ratios.title
    assert ratios.columns == ["", "hprm centralized", "limit"]
    assert [row[:2] for row in ratios.rows] == [
        ["64 B", "0.7 (0.6–0.8)"],
        ["1 MB", "1.35 (1.2–1.5)"],
    ]
    alone = tables.all_tables(by_size({"limit": {64: [5]}}), ["W6"])
    assert [table.rows for table in alone] == [[["64 B", "5 (5–5)"]]]
    nothing = tables.all_tables(by_size({"iceoryx2": {64: [5]}}), ["W6"])
    assert [table.rows for table in nothing] == [[["64 B", "5 (5–5)"]], [["64 B"]]]


def test_a_goal_for_every_size_is_judged_at_the_worst_one_and_names_it() -> None:
    measurements = by_size(
        {
            "iceoryx2": everywhere(10),
            "hprm centralized": everywhere(8, at_16384=12, at_1048576=11),
            "hprm decentralized": everywhere(8, at_67108864=9.5),
        }
    )
    missed = verdict_by_size(measurements, "hprm centralized")
    assert (missed.word, missed.at, missed.measured) == ("missed", 16_384, Spread(1.2, 1.2, 1.2))
    met = verdict_by_size(measurements, "hprm decentralized")
    assert (met.word, met.at, met.measured) == ("met", 2**26, Spread(0.95, 0.95, 0.95))
    where = "W6, both processes on one core, every size"
    relation = "at most 1 of iceoryx2"
    rows = tables.of_verdicts([missed, met]).rows
    assert rows == [
        [where, "hprm centralized", relation, "1.2 (1.2–1.2) at 16 KB", "missed"],
        [where, "hprm decentralized", relation, "0.95 (0.95–0.95) at 64 MB", "met"],
    ]


def test_a_goal_for_every_size_is_not_met_where_one_is_missing() -> None:
    def some(microseconds: float) -> dict[int, Sequence[float]]:
        return {64: [microseconds], 1024: [8]}

    values = {"iceoryx2": everywhere(10), "hprm centralized": some(8)}
    verdict = verdict_by_size(by_size(values), "hprm centralized")
    assert (verdict.word, verdict.at) == ("not measured", None)
    values["hprm centralized"] = some(11)
    verdict = verdict_by_size(by_size(values), "hprm centralized")
    assert (verdict.word, verdict.at) == ("missed", 64)
    assert verdict_by_size(by_size({}), "hprm centralized").word == "not measured"


def test_a_file_has_the_size_at_which_a_goal_was_judged(tmp_path: Path) -> None:
    launcher: Any = None  # nothing is started
    done = run.Run(["W6"], [], plan.QUICK, launcher, {})
    values = {"iceoryx2": everywhere(10), "hprm centralized": everywhere(8, at_256=20)}
    done.measurements = by_size(values)
    run.report(done, {"cpu": "one"}, tmp_path)
    judged = json.loads((tmp_path / "bench.json").read_text())["goals"]
    found = {
        (goal["group"], goal["contender"]): (goal["at"], goal["measured"], goal["is"])
        for goal in judged
    }
    assert found == {
        (who.SAME, "hprm centralized"): (256, [2.0, 2.0, 2.0], "missed"),
        (who.SAME, "hprm decentralized"): (None, None, "not measured"),
        (who.APART, "hprm centralized"): (None, None, "not measured"),
        (who.APART, "hprm decentralized"): (None, None, "not measured"),
    }
    assert "<svg" in (tmp_path / "bench.html").read_text()


def texts_of(svg: str) -> list[str]:
    root = ElementTree.fromstring(svg)
    assert root.tag.endswith("svg")
    return ["".join(it.itertext()) for it in root.iter() if it.tag.endswith("text")]


def test_one_picture_shows_all_sizes_in_both_groups() -> None:
    values = {"iceoryx2": everywhere(10), "hprm centralized": everywhere(8)}
    measurements = by_size(values)
    by_itself = page.pictures(measurements, ["W6"])
    for name, size_times in {**values, "hprm spinning": everywhere(2)}.items():
        for size, (microseconds,) in size_times.items():
            result = {"workload": "W6", "size": size, "times_ns": [round(1000 * microseconds)]}
            measurements.add(who.APART, name, 0, result)
    both = page.pictures(measurements, ["W6"])
    assert (len(by_itself), len(both)) == (1, 1)
    texts = texts_of(both[0])
    assert {"both processes on one core", "one core each", "multiple of iceoryx2"} <= set(texts)
    assert {"64 B", "1 KB", "64 KB", "1 MB", "64 MB"} <= set(texts)
    # Each is in the legend once, and not more often where there are two groups.
    assert [texts.count(name) for name in ("iceoryx2", "hprm centralized", "hprm spinning")] == [
        1
    ] * 3
    assert "one core each" not in texts_of(by_itself[0])


def test_a_picture_needs_no_rival_and_not_every_size() -> None:
    (svg,) = page.pictures(by_size({"limit": everywhere(5), "new": {64: [7], 256: [8]}}), ["W6"])
    texts = texts_of(svg)
    assert {"limit", "new"} <= set(texts)
    assert "multiple of iceoryx2" not in texts
    assert page.pictures(Measurements(), ["W6"]) == []


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


@pytest.mark.parametrize("size", [64, 128, 2**20])
def test_an_array_has_its_size_and_16_bytes_come_back(size: int) -> None:
    answers = script.Answers()
    replies: list[Any] = []

    def node(message: Any) -> Any:
        reply = answers.answer(message)
        if reply is not None:
            assert isinstance(message, np.ndarray)
            replies.append(reply)
        return reply

    results, sent = talk([cell("W6", size)], [node])
    assert [(result["workload"], result["size"]) for result in results] == [("W6", size)]
    assert {len(message) for message in sent[:-1]} == {size}
    assert {(type(reply), len(reply)) for reply in replies} == {(bytes, 16)}


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


ON_ONE_PROCESSOR = """
import os, sys

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


def test_a_run_on_one_processor_measures_every_size_and_draws_them(tmp_path: Path) -> None:
    names = ["hprm decentralized", "limit"]
    command = [sys.executable, "-c", ON_ONE_PROCESSOR, str(BENCH / "run.py"), "--quick"]
    command += ["--out", str(tmp_path), "--only", "W6", "--contenders", ",".join(names)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "bench.json").read_text())
    assert not [note for note in document["notes"] if note.startswith("failed")]
    assert "skipped: ping-pong and rate, one core each: too few processors" in document["notes"]
    measured = [(one["contender"], one["group"], one["case"]) for one in document["figures"]]
    assert sorted(measured) == [(name, who.SAME, size) for name in names for size in plan.POWERS]
    # There is nothing to compare with.
    assert {goal["is"] for goal in document["goals"]} == {"not measured"}
    assert "<svg" in (tmp_path / "bench.html").read_text()


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
