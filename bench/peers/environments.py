"""A virtual environment for each peer, with pinned versions, made by pip under out/bench-venvs.

Peers need versions of NumPy and of pyarrow that exclude one another, and none belongs into the
environment of the package. A second run finds the environments as the first has left them. What a
peer's programs do there is in `worker/`.
"""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
import venv
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
VENVS = ROOT / "out" / "bench-venvs"
INSTALL_LIMIT_S = 600

REQUIREMENTS: dict[str, tuple[str, ...]] = {
    "iceoryx2": ("iceoryx2==0.10.0", "numpy==2.2.6"),
    "zenoh": ("eclipse-zenoh==1.10.2", "numpy==2.2.6"),
    "dora": ("dora-rs==1.1.0", "dora-rs-cli==1.1.0", "pyarrow==24.0.0", "numpy==2.2.6"),
    "cyclonedds": ("cyclonedds==11.0.1", "numpy==2.2.6"),
    "pyzmq": ("pyzmq==27.3.0", "numpy==2.2.6"),
    "plasma": ("pyarrow==11.0.0", "numpy==1.26.4"),
    "ray": ("ray==2.60.0", "numpy==2.2.6"),
    "rosbags": ("rosbags==0.11.9", "numpy==2.2.6"),
    "protobuf": ("protobuf==7.36.2", "numpy==2.2.6"),
}
"""What pip installs, by environment."""

IMPORTED: dict[str, tuple[str, ...]] = {
    "ros2": ("rclpy", "sensor_msgs.msg", "numpy"),
    "ros2_numpy": ("ros2_numpy", "sensor_msgs.msg", "numpy"),
}
"""What pip does not have and some machines do: modules that can be imported there."""

_HINT = "source its setup first, as in `. /opt/ros/humble/setup.bash`"


class Unavailable(Exception):
    """A contender cannot take part; the message says why."""


def python_of(name: str | None) -> Path:
    """The interpreter of an environment; without a name, the one that runs the harness."""
    if name in IMPORTED:
        return Path(_importing(IMPORTED[name]) or sys.executable)
    return Path(sys.executable) if name is None else VENVS / name / "bin" / "python"


@functools.cache
def _importing(modules: tuple[str, ...]) -> str | None:
    """The first interpreter that has these modules: the harness's, or that of the machine."""
    for python in (sys.executable, shutil.which("python3", path=os.defpath)):
        words = [python, "-c", f"import {', '.join(modules)}"] if python else ["false"]
        done = subprocess.run(words, capture_output=True, timeout=60, check=False)
        if done.returncode == 0:
            return python
    return None


def prepare(name: str) -> None:
    """Makes the environment unless it is there as it should be.

    Raises:
        Unavailable: pip cannot install a requirement; the message has pip's last error.

    """
    if name in IMPORTED:
        if _importing(IMPORTED[name]) is None:
            raise Unavailable(
                f"Python cannot import {IMPORTED[name][0]}; if ROS 2 is there, {_HINT}"
            )
        return
    requirements = REQUIREMENTS[name]
    directory = VENVS / name
    ready = directory / ".ready"
    wanted = "\n".join(requirements)
    if ready.exists() and ready.read_text() == wanted and python_of(name).exists():
        return
    shutil.rmtree(directory, ignore_errors=True)
    # Without symbolic links some interpreters do not find their own library.
    try:
        venv.EnvBuilder(with_pip=True, symlinks=True).create(directory)
    except (OSError, subprocess.CalledProcessError) as error:
        raise Unavailable(f"no virtual environment can be made: {error}") from error
    _install(name, requirements)
    ready.write_text(wanted)


def _install(name: str, requirements: Sequence[str]) -> None:
    # Wheels only: a source package would compile for many minutes, with tools that may be missing.
    words = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--only-binary=:all:",
    ]
    environment = {key: value for key, value in os.environ.items() if key != "VIRTUAL_ENV"}
    try:
        done = subprocess.run(
            [str(python_of(name)), *words, *requirements],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=INSTALL_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise Unavailable(f"pip did not end within {INSTALL_LIMIT_S} s") from None
    if done.returncode != 0:
        raise Unavailable(f"pip cannot install {' '.join(requirements)}: {_reason(done.stderr)}")


def _reason(errors: str) -> str:
    """The line of pip's complaint that says most."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    said = [line.removeprefix("ERROR: ") for line in lines if line.startswith("ERROR: ")]
    return (said or lines or ["it did not say why"])[-1]
