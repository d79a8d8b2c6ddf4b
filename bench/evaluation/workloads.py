"""Workloads of the comparison with other middleware (`../peers`) as records."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path

import contenders as who
import federation
import machine
import plan
import run as peers
from figures import UNITS
from launch import Launcher
from tables import label

from .experiment import Effort, ExperimentError
from .record import Cell, Record

_QUICK = plan.Effort(
    1, rounds=3, budget_s=0.05, session_limit_s=30, total_limit_s=60, sizes_mb=(1, 10)
)
_FULL = dataclasses.replace(plan.FULL, total_limit_s=12 * 60)


def hprm() -> Path:
    """The command that belongs to the running Python."""
    try:
        return federation.command()
    except federation.FederationError as error:
        raise ExperimentError(str(error)) from None


def taking_part(
    experiment: str, contenders: Iterable[who.Contender], effort: Effort, quick: Sequence[str]
) -> list[who.Contender]:
    """The contenders that are to be measured; in the quick form these few, if none are named.

    Raises:
        ExperimentError: none is left.

    """
    names = effort.contenders
    if effort.quick and not names:
        chosen = [it for it in contenders if it.name in quick]
    else:
        chosen = [it for it in contenders if not names or any(name in it.name for name in names)]
    if not chosen:
        raise ExperimentError(f"{experiment}: no contender has one of these names: {names}")
    return chosen


def measure(
    experiment: str, workload: str, group: str, effort: Effort, quick: Sequence[str]
) -> Record:
    """Measures a workload with the contenders of a group in turn."""
    able = [it for it in who.chosen(group, None) if it.does(workload)]
    chosen = taking_part(experiment, able, effort, quick)
    wanted = _QUICK if effort.quick else _FULL
    if effort.repetitions:
        wanted = dataclasses.replace(wanted, repetitions=effort.repetitions)
    sessions = [(group, chosen)]
    missing = peers.prepare(sessions)
    launcher = Launcher(hprm(), wanted.session_limit_s)
    run = peers.Run([workload], sessions, wanted, launcher, missing)
    run.all()
    absent = {it.name: missing[it.environment] for it in chosen if it.environment in missing}
    absent |= {name: reasons[-1] for (_, name), reasons in run.failures.items()}
    return Record(
        experiment,
        effort.form,
        machine.describe(hprm()),
        run.seconds,
        [_cell(it) for it in run.measurements.as_json()],
        absent,
        [f"{run.repetitions} of {wanted.repetitions} repetitions."],
    )


def _cell(figure: dict[str, object]) -> Cell:
    repetitions = figure["repetitions"]
    assert isinstance(repetitions, list)
    return Cell(
        str(figure["contender"]),
        label(figure["case"]),  # type: ignore[arg-type]
        UNITS[str(figure["workload"])],
        {it["repetition"]: it["value"] for it in repetitions},
        {it["repetition"]: it["p99"] for it in repetitions},
    )
