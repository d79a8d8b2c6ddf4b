"""`hprm compose`: files for containers that their tools accept, and what stands in them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import uuid
from pathlib import Path
from typing import Any

import pytest
import yaml

BIN = Path(sys.executable).parent
WHEEL = "hprm-0.1.0-cp311-cp311-manylinux_2_28_x86_64.whl"
PROGRAM = """
target Python { %s timeout: 100 ms }
reactor Camera { output image timer t(0, 20 ms) reaction(t) -> image {= image.set(1) =} }
reactor Planner { input[2] image reaction(image) {= pass =} }
federated reactor {
  camera = new[2] Camera()
  planner = new Planner()
  camera.image -> planner.image
}
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with a program and a wheel, whose contents nothing reads here."""
    (tmp_path / "Main.lf").write_text(PROGRAM % "docker: true,")
    (tmp_path / WHEEL).touch()
    return tmp_path


def compose(folder: Path, *words: str, code: int = 0) -> str:
    """Runs the command, which must have this exit code, and returns what it has told."""
    outcome = subprocess.run(
        [BIN / "hprm", "compose", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert outcome.returncode == code, outcome.stderr
    return outcome.stderr if code else outcome.stdout + outcome.stderr


def accepted(files: Path) -> dict[str, Any]:
    """What compose would read; its tools have accepted all files."""
    yml = files / "docker-compose.yml"
    schema = ["--builtin-schema", "vendor.compose-spec"]
    checks = [
        [BIN / "check-jsonschema", *schema, yml],
        [BIN / "hadolint", *files.glob("*/Dockerfile")],
    ]
    for check in checks:
        outcome = subprocess.run(check, capture_output=True, text=True, timeout=60, check=False)
        assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    read: dict[str, Any] = yaml.safe_load(yml.read_text())
    return read


def entrypoint(files: Path, service: str) -> list[str]:
    """What a container runs."""
    last = (files / service / "Dockerfile").read_text().splitlines()[-1]
    words: list[str] = json.loads(last.removeprefix("ENTRYPOINT "))
    return words


def test_each_federate_is_a_service_that_finds_the_rti(project: Path) -> None:
    told = compose(project, "Main.lf", "--wheel", WHEEL, "--property", "workers=2")
    assert told.splitlines() == [
        "wrote Main-containers: the RTI and 3 federates",
        "  docker compose --file Main-containers/docker-compose.yml up --build",
    ]
    files = project / "Main-containers"
    services = accepted(files)["services"]
    federates = ["camera__0", "camera__1", "planner"]
    assert list(services) == ["rti", *federates]
    options = ["--property=workers=2", "Main.lf"]
    assert entrypoint(files, "rti") == ["hprm", "rti", "--listen", "0.0.0.0:15045", *options]
    for name in federates:
        joins = ["hprm", "federate", "--rti", "rti:15045", *options, name]
        assert entrypoint(files, name) == joins
        assert services[name]["depends_on"] == ["rti"]
    for name, service in services.items():
        build = service["build"]
        context = (files / build["context"]).resolve()
        assert context == project
        assert (context / build["dockerfile"]).resolve() == files / name / "Dockerfile"
    text = (files / "planner" / "Dockerfile").read_text()
    assert "FROM python:3.11-slim\n" in text
    assert (files / WHEEL).is_file()


def test_the_commands_of_the_containers_are_those_of_this_version(project: Path) -> None:
    compose(project, "Main.lf", "--wheel", WHEEL)
    files = project / "Main-containers"
    # As compose starts them, but on this machine, where containers have no names.
    address = f"unix:@compose-{uuid.uuid4().hex}"

    def here(word: str) -> str:
        return word.replace("0.0.0.0:15045", address).replace("rti:15045", address)

    secret = dict(line.split("=") for line in (files / ".env").read_text().splitlines()[1:])
    processes = []
    for service in ("rti", "camera__0", "camera__1", "planner"):
        words = [here(word) for word in entrypoint(files, service)]
        environment = {**os.environ, **secret}
        command = [BIN / words[0], *words[1:]]
        processes.append(subprocess.Popen(command, cwd=project, env=environment))
    assert [process.wait(timeout=60) for process in processes] == [0, 0, 0, 0]


def test_the_secret_is_the_owners_and_in_no_image(project: Path) -> None:
    compose(project, "Main.lf", "--wheel", WHEEL)
    files = project / "Main-containers"
    environment = files / ".env"
    assert environment.stat().st_mode & 0o777 == 0o600
    name, secret = environment.read_text().splitlines()[-1].split("=")
    assert (name, len(bytes.fromhex(secret))) == ("HPRM_FEDERATION_ID", 16)
    others = [path for path in files.rglob("*") if path.is_file() and path != environment]
    assert not [path for path in others if secret in path.read_text()]
    assert "**/.env" in (files / "rti" / "Dockerfile.dockerignore").read_text().splitlines()
    assert ".env" in (files / ".gitignore").read_text().splitlines()


def test_nothing_is_replaced_unless_it_is_forced(project: Path) -> None:
    compose(project, "Main.lf", "--wheel", WHEEL)
    files = project / "Main-containers"
    secret = (files / ".env").read_text()
    (files / "rti" / "Dockerfile").write_text("FROM mine\n")
    told = compose(project, "Main.lf", "--wheel", WHEEL, code=1)
    assert told.splitlines() == [
        "error: Main-containers/docker-compose.yml exists already",
        "  hint: --force replaces it, --output FOLDER writes elsewhere",
    ]
    assert (files / "rti" / "Dockerfile").read_text() == "FROM mine\n"
    compose(project, "Main.lf", "--wheel", WHEEL, "--force")
    assert "FROM python" in (files / "rti" / "Dockerfile").read_text()
    assert (files / ".env").read_text() == secret


def test_the_options_of_the_property_are_obeyed(project: Path) -> None:
    options = """docker: { runner-base: "robots/base:1", rti-image: "robots/rti:1",
      env-file: "settings.env", pre-build-script: "before.sh", post-build-script: "after.sh",
      pre-run-script: "start.sh", no-build: true, builder-base: "x",
      docker-compose-override: "more.yml" }, realtime: 20,"""
    (project / "Main.lf").write_text(PROGRAM % options)
    (project / "settings.env").touch()
    (project / "requirements.txt").touch()
    (project / "more.yml").write_text("services: {}\n")
    compose(project, "Main.lf", "--output", "out/of it")
    files = project / "out" / "of it"
    services = accepted(files)["services"]
    text = (files / "planner" / "Dockerfile").read_text()
    lines = text.splitlines()[1:-1]
    assert lines == [
        "FROM robots/base:1",
        "ENV PYTHONUNBUFFERED=1",
        "WORKDIR /program",
        "COPY requirements.txt ./",
        'RUN ["pip", "install", "--no-cache-dir", "-r", "requirements.txt"]',
        'COPY ["before.sh", "before.sh"]',
        'RUN ["sh", "before.sh"]',
        "COPY --chown=1000 . ./",
        'RUN ["sh", "after.sh"]',
    ]
    assert (files / "rti" / "Dockerfile").read_text().splitlines()[1] == "FROM robots/rti:1"
    assert entrypoint(files, "planner")[:4] == [
        "sh",
        "-c",
        'sh "$0" && exec "$@"',
        "start.sh",
    ]
    assert services["planner"]["env_file"] == ["../../settings.env"]
    assert services["planner"]["cap_add"] == ["SYS_NICE", "IPC_LOCK"]
    assert (files / "docker-compose.override.yml").read_text() == "services: {}\n"


@pytest.mark.parametrize(
    ("program", "words", "told"),
    [
        (PROGRAM % "", ["Main.lf"], "error: the images would have no HPRM"),
        ("target Python\nmain reactor { }", ["Main.lf"], "error: Main.lf is no federation"),
        (PROGRAM % "", ["Main.lf", "--wheel", "x.whl"], "error: x.whl is no wheel of HPRM"),
        (
            PROGRAM % "",
            ["Main.lf", "--wheel", "hprm-0.1.0-cp311-cp311-linux_x86_64.whl"],
            "is for this machine only",
        ),
        (
            PROGRAM % "docker: { env-file: 'none.env' },".replace("'", '"'),
            ["Main.lf", "--wheel", WHEEL],
            "error: there is no file",
        ),
        (PROGRAM % "docker: 1,", ["Main.lf"], "error[LF0603]"),
        (PROGRAM % 'docker: { runner-bass: "x" },', ["Main.lf"], "did you mean `runner-base`?"),
        (PROGRAM % "docker: { runner-base: 3 },", ["Main.lf"], "`runner-base` must be a text"),
        (
            PROGRAM % "",
            ["Main.lf", "--wheel", WHEEL, "--context", "part"],
            "is a file of the program and not in",
        ),
    ],
)
def test_a_mistake_is_one_error_and_nothing_is_written(
    project: Path, program: str, words: list[str], told: str
) -> None:
    (project / "Main.lf").write_text(program)
    (project / "hprm-0.1.0-cp311-cp311-linux_x86_64.whl").touch()
    (project / "part").mkdir()
    before = sorted(project.rglob("*"))
    message = compose(project, *words, code=1)
    errors = [line for line in message.splitlines() if line.startswith("error")]
    assert told in message and len(errors) == 1, message
    assert sorted(project.rglob("*")) == before


def test_a_federation_in_python_has_containers_too(project: Path) -> None:
    (project / "app.py").write_text("""
import hprm

class Idle(hprm.Reactor):
    pass

class Vision(hprm.Federation, properties={"docker": {"runner-base": "robots/base:1"}}):
    def __init__(self):
        self.rti = Idle()
""")
    compose(project, "app.py:Vision")
    files = project / "app-containers"
    assert list(accepted(files)["services"]) == ["hprm-rti", "rti"]
    last = ["hprm", "federate", "--rti", "hprm-rti:15045", "app.py:Vision", "rti"]
    assert entrypoint(files, "rti") == last


def test_a_program_with_containers_runs_without_them_and_without_a_word(project: Path) -> None:
    argv = [BIN / "hprm", "run", "Main.lf"]
    run = subprocess.run(argv, cwd=project, capture_output=True, text=True, timeout=60, check=False)
    assert (run.returncode, run.stderr) == (0, "")
