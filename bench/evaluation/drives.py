"""Starts the driving application over each transport, as sessions of `../peers/launch.py`."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import environments
import numpy as np
from contenders import Contender
from launch import Command, Launcher, Result

from . import ROOT

DRIVING = ROOT / "bench" / "driving"
WORKER = DRIVING / "worker" / "main.py"
MODELS = ROOT / "examples" / "driving" / "models"
_NETWORKS = {
    "policy.onnx": ["--agent", "policy"],
    "detector.onnx": ["--detector", "network"],
}
GROUP = "drive"
ROLES = ("simulator", "agent", "detector", "fusion")


def _hprm(name: str, coordination: str, *arguments: str) -> Contender:
    options = {"coordination": coordination}
    return Contender(f"hprm {name}", "hprm", (GROUP,), options=options, arguments=arguments)


def _peer(name: str, transport: str, environment: str | None = None, **options: Any) -> Contender:
    kind = "dora" if transport == "dora" else "processes"
    return Contender(name, kind, (GROUP,), transport, environment, options)


CONTENDERS = (
    _hprm("centralized", "centralized"),
    _hprm("decentralized", "decentralized"),
    _hprm("in one process", "decentralized", "--in-process"),
    _peer("unix + pickle", "unix_pickle"),
    _peer("zenoh tcp", "zenoh", "zenoh"),
    _peer("zenoh shm", "zenoh", "zenoh", shm=True),
    _peer("dora", "dora", "dora"),
    _peer("cyclonedds", "cyclonedds", "cyclonedds"),
    _peer("ros2", "ros2", "ros2"),
    _peer("ros2, array", "ros2", "ros2", form="array"),
    _peer("ros2 + shm", "ros2", "ros2", form="shm"),
)
"""What forms `ros2` has is in `../peers/worker/transports/ros2.py`."""


class DrivingLauncher(Launcher):
    """Runs a drive at a time."""

    def drive(self, contender: Contender, frames: int) -> list[Result]:
        """What the programs said at their ends: latencies, times of computing, how far it went.

        Raises:
            Failed: a process ended with an error, or the session took too long.

        """
        cell = {"workload": GROUP, "size": 0, "frames": frames}
        return self._session(self._with_packages(contender), GROUP, [cell])

    @staticmethod
    def _with_packages(contender: Contender) -> Contender:
        # The folder of the harness's packages: peers take what the models need from there.
        packages = str(Path(np.__file__).resolve().parents[1])
        return dataclasses.replace(contender, options=contender.options | {"packages": packages})

    def _describe(self, *arguments: Any) -> dict[str, Any]:
        session = super()._describe(*arguments)
        frames = str(session["plan"][0]["frames"])
        measured = str(Path(session["directory"]) / "measured")
        session["options"]["arguments"] = [*models(), "--frames", frames, "--measure", measured]
        return session

    def _processes(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        python = str(environments.python_of(contender.environment))
        return [Command([python, str(WORKER), role]) for role in ROLES]

    def _dora(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        description = Path(session["directory"]) / "dataflow.yml"
        description.write_text(json.dumps(dataflow()))  # JSON is YAML
        dora = environments.python_of("dora").parent / "dora"
        return [Command([str(dora), "run", str(description)])]

    def _hprm(self, contender: Contender, session: dict[str, Any]) -> list[Command]:
        program = DRIVING / f"Measured{contender.options['coordination'].capitalize()}.lf"
        words = [str(self._command), "run", *contender.arguments, str(program), "--"]
        return [Command([*words, *session["options"]["arguments"]])]


def models(folder: Path = MODELS) -> list[str]:
    """Options of the application that choose its networks, as far as their files are there."""
    words: list[str] = []
    for file, chosen in _NETWORKS.items():
        words += chosen if (folder / file).exists() else []
    return words


def dataflow() -> dict[str, Any]:
    """The four programs as nodes of dora. Pixels have outputs of their own."""
    outputs = {
        "simulator": ["birdview", "birdview_pixels", "picture", "picture_pixels"],
        "agent": ["plan"],
        "detector": ["sight"],
        "fusion": ["control"],
    }
    inputs = {
        "simulator": ["fusion/control"],
        "agent": ["simulator/birdview", "simulator/birdview_pixels"],
        "detector": ["simulator/picture", "simulator/picture_pixels"],
        "fusion": ["agent/plan", "detector/sight"],
    }
    return {
        "nodes": [
            {
                "id": role,
                "path": str(environments.python_of("dora")),
                "args": f"{WORKER} {role}",
                "inputs": {source.partition("/")[2]: source for source in inputs[role]},
                "outputs": outputs[role],
            }
            for role in ROLES
        ]
    }
