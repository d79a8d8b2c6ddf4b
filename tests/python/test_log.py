"""The log for debugging, which `HPRM_LOG` turns on (docs/concepts/failures.md)."""

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


def logged(bench: Bench, level: str, coordination: str, *options: str) -> str:
    """What a run with a log writes to the standard error stream."""
    (bench.folder / "Main.lf").write_text(PROGRAM.replace("COORDINATION", coordination))
    environment = {"HPRM_LOG": level}
    outcome = finish(bench.call("run", *options, "Main.lf", environment=environment))
    assert (outcome.code, outcome.out) == (0, "")
    return outcome.err


@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_a_log_shows_how_federates_are_coordinated(
    bench: Bench, coordination: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Federates that read boards need no grants.
    monkeypatch.setenv("HPRM_BOARDS", "off")
    log = logged(bench, "hprm_federated=debug", coordination)
    line = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z DEBUG hprm_federated::"
    assert re.search(rf"^\[planner\] {line}federate: from the RTI: Start ", log, re.M), log
    assert re.search(rf"^{line}rti: from FederateId\(0\): Ready ", log, re.M), log
    assert "TRACE" not in log and "Message" not in log
    assert ("TagAdvanceGrant" in log) == (coordination == "centralized")


@pytest.mark.parametrize("options", [(), ("--in-process",)], ids=["processes", "threads"])
def test_a_detailed_log_shows_messages_and_waits_and_no_values(
    bench: Bench, options: tuple[str, ...]
) -> None:
    log = logged(bench, "trace", "centralized", *options)
    assert re.search(r"Message on ChannelId\(0\) for \(10000000 ns, 0\), \d+ bytes", log), log
    assert "waits, Running, for tag" in log
    assert "begins tag (10000000 ns, 0)" in log
    assert "FederateId(1) is planner" in log
    assert "ChannelId(0) is Main.camera.image -> Main.planner.image" in log
    assert "secret" not in log
    if options:
        assert re.search(r"TRACE +camera hprm::federate_loop: begins tag", log), log


def test_without_it_nothing_is_written(bench: Bench) -> None:
    assert logged(bench, "", "centralized") == ""


@pytest.mark.parametrize("level", ["debgu", "federated=debug", "hprm_federated::rit=debug"])
def test_a_slip_is_an_error(bench: Bench, level: str) -> None:
    (bench.folder / "Main.lf").write_text(PROGRAM.replace("COORDINATION", "centralized"))
    outcome = finish(bench.call("run", "Main.lf", environment={"HPRM_LOG": level}))
    assert outcome.code == 2
    outcome.assert_one_error(
        f"HPRM_LOG={level} is wrong: `{level}` names no events", "hprm_federated=debug"
    )
