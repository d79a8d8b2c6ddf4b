"""The main job end to end: arrays go out to four processes and come back, with few copies.

Runs the programs of examples/broadcast_gather as a user does, with short plans.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "broadcast_gather"))

import chart
import federation
import measurement
import summary

ROUNDS = 3
SENDS = measurement.WARM_UP_ROUNDS + ROUNDS


@pytest.fixture(scope="module", params=[1, 50], ids=lambda size: f"{size}MB")
def size_mb(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(scope="module", params=list(federation.PROGRAMS))
def results(request: pytest.FixtureRequest, size_mb: int) -> dict[str, Any]:
    """What one run of the program measured; the tests below look at different sides of it."""
    return federation.run(request.param, [size_mb], ROUNDS)


def test_every_round_is_measured(results: dict[str, Any], size_mb: int) -> None:
    latencies = results["latencies_ns"][str(size_mb)]
    assert len(latencies) == ROUNDS
    assert all(latency > 0 for latency in latencies)


def test_gathered_arrays_equal_the_one_sent(results: dict[str, Any], size_mb: int) -> None:
    assert results["equal"] == {str(size_mb): True}


def test_four_receivers_cost_one_copy(results: dict[str, Any], size_mb: int) -> None:
    size = size_mb * 1_000_000
    assert results["sends"] == SENDS
    assert results["sent_bytes"] == SENDS * size
    assert results["store"]["bytes_copied"] == SENDS * size
    assert results["store"]["objects_sealed"] == SENDS
    assert results["store"]["inline_fallbacks"] == 0


def test_clients_send_their_copies_without_another_one(
    results: dict[str, Any], size_mb: int
) -> None:
    assert len(results["clients"]) == federation.CLIENTS
    for client in results["clients"]:
        assert client["sends"] == SENDS
        assert client["sent_bytes"] == SENDS * size_mb * 1_000_000
        assert client["store"]["bytes_copied"] == 0
        assert client["store"]["objects_sealed"] == SENDS
        assert client["store"]["inline_fallbacks"] == 0


@pytest.mark.parametrize("program", list(federation.PROGRAMS))
def test_in_one_process_nothing_is_copied_but_by_the_clients(program: str) -> None:
    results = federation.run(program, [50], ROUNDS, in_process=True)
    assert results["equal"] == {"50": True}
    assert results["sends"] == SENDS
    assert len(results["latencies_ns"]["50"]) == ROUNDS
    for federate in [results, *results["clients"]]:
        assert federate["store"]["bytes_copied"] == 0
        assert federate["store"]["objects_sealed"] == 0
        assert federate["store"]["bytes_mapped"] == 0


def test_sizes_follow_each_other_in_one_run() -> None:
    shown: list[float] = []
    run = federation.run("decentralized", [1, 5], rounds=2, on_progress=shown.append)
    assert {size: len(latencies) for size, latencies in run["latencies_ns"].items()} == {
        "1": 2,
        "5": 2,
    }
    assert run["equal"] == {"1": True, "5": True}
    assert shown == sorted(shown)
    assert shown[-1] == 1.0


def test_a_malformed_plan_ends_the_run_with_its_name() -> None:
    plan = {"BROADCAST_GATHER_SIZES": "1,huge"}
    with pytest.raises(ValueError, match=r"BROADCAST_GATHER_SIZES.*1,huge"):
        measurement.Rounds.from_environment(plan)


def test_an_incomplete_round_is_an_error() -> None:
    rounds = measurement.Rounds({1: 1}, out=None, progress=False)
    array = rounds.array()
    with pytest.raises(RuntimeError, match=r"client \[2\]"):
        rounds.record(1, [array, array, None, array])


def test_a_wrong_copy_is_noticed(tmp_path: Path) -> None:
    out = tmp_path / "server.json"
    rounds = measurement.Rounds({1: 1}, out=out, progress=False)
    array = rounds.array()
    wrong = array.copy()
    wrong[-1, -1] += 1
    rounds.record(1, [array, array, array, wrong])
    rounds.save({})
    assert '"equal": {"1": false}' in out.read_text()


def test_a_percentile_is_a_round_that_was_measured() -> None:
    summarized = summary.summarize([milli * 1_000_000 for milli in range(1, 201)])
    assert summarized == summary.Summary(minimum=1, median=100.5, p99=198, rounds=200)
    assert summary.summarize([2_000_000]).p99 == 2


def test_the_picture_holds_every_median_and_stays_inside_its_frame() -> None:
    by_size = {size: summary.summarize([size * 1_000_000] * 3) for size in (1, 10, 50)}
    picture = chart.svg({"centralized": by_size, "decentralized": by_size}, "a < b", "")
    assert "a &lt; b" in picture
    assert all(picture.count(f">{size}</text>") >= 3 for size in by_size)
    assert "nan" not in picture
