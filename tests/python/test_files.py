"""The target property ``files``: a program finds the files where Lingua Franca puts copies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

HPRM = Path(sys.executable).with_name("hprm")

READS = """\
    here = os.path.dirname(__file__)
    print(open(os.path.join(here, "images", "pacman.txt")).read(),
          open(here + "/nnets/n.txt").read(), open(here + "/notes.txt").read(),
          helper.data(), os.path.basename(__file__))
"""

FILES = 'files: ["include/images", "../code/nnets/", "include/helper.py", "notes.txt"]'

MAIN = f"""\
target Python {{ {FILES} }}
preamble {{= import helper =}}
main reactor {{
  reaction(startup) {{=
{READS}  =}}
}}
"""

FEDERATED = f"""\
target Python {{ {FILES} }}
preamble {{= import helper, signal, time =}}
reactor R {{
  reaction(startup) {{=
{READS}    LAST
  =}}
}}
federated reactor {{ a = new R() b = new R() }}
"""

EXPECTED = "pacman net notes pacman Main.lf"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    for path, text in {
        "src/include/images/pacman.txt": "pacman",
        "src/include/helper.py": "import os\n\n\ndef data():\n"
        "    folder = os.path.dirname(__file__)\n"
        "    return open(os.path.join(folder, 'images', 'pacman.txt')).read()\n\n\n"
        "def fail():\n    raise ValueError('on purpose')\n",
        "src/notes.txt": "notes",
        "code/nnets/n.txt": "net",
        "src/Main.lf": MAIN,
    }.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    (tmp_path / "tmp").mkdir()
    return tmp_path


def run(project: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [HPRM, "run", *words],
        cwd=project,
        env=os.environ | {"TMPDIR": str(project / "tmp")},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def left(project: Path) -> list[str]:
    return [path.name for path in (project / "tmp").iterdir()]


def test_a_program_finds_its_files_flat_beside_itself(project: Path) -> None:
    outcome = run(project, "src/Main.lf")
    assert (outcome.stdout, outcome.stderr, outcome.returncode) == (EXPECTED + "\n", "", 0)
    assert left(project) == []


@pytest.mark.parametrize("words", [[], ["--in-process"]])
def test_so_do_federates(project: Path, words: list[str]) -> None:
    (project / "src/Main.lf").write_text(FEDERATED.replace("LAST", "pass"))
    outcome = run(project, *words, "src/Main.lf")
    assert outcome.returncode == 0, outcome.stderr
    assert sorted(outcome.stdout.splitlines()) == [f"[{name}] {EXPECTED}" for name in "ab"]
    assert left(project) == []


@pytest.mark.parametrize("last", ["sys.exit(3)", "os._exit(3)", "os.kill(os.getpid(), 9)", "1 / 0"])
def test_nothing_is_left_when_a_federate_fails(project: Path, last: str) -> None:
    (project / "src/Main.lf").write_text(FEDERATED.replace("LAST", last))
    assert run(project, "src/Main.lf").returncode != 0
    assert left(project) == []


def test_a_traceback_names_the_files_themselves(project: Path) -> None:
    (project / "src/Main.lf").write_text(MAIN.replace("helper.data()", "helper.fail()"))
    outcome = run(project, "src/Main.lf")
    assert outcome.returncode == 1
    assert f'{project / "src" / "include" / "helper.py"}", line 10, in fail' in outcome.stderr
    assert "src/Main.lf:" in outcome.stderr or 'Main.lf", line' in outcome.stderr
    assert "hprm-stage" not in outcome.stderr


def test_processes_that_multiprocessing_starts_find_them_too(project: Path) -> None:
    (project / "src/Main.lf").write_text(f"""\
target Python {{ {FILES} }}
preamble {{=
import multiprocessing, helper
def look(_):
    return open(os.path.dirname(__file__) + "/nnets/n.txt").read() + helper.data()
=}}
main reactor {{
  reaction(startup) {{=
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.map(look, [0]))
  =}}
}}
""")
    outcome = run(project, "src/Main.lf")
    assert outcome.stdout == "['netpacman']\n", outcome.stderr
    assert left(project) == []


def test_what_a_killed_program_leaves_is_removed_by_the_next_one(project: Path) -> None:
    (project / "src/Main.lf").write_text(MAIN.replace("helper.data()", "os.kill(os.getpid(), 9)"))
    assert run(project, "src/Main.lf").returncode == -signal.SIGKILL
    (abandoned,) = (project / "tmp").iterdir()
    long_ago = time.time() - 3600
    os.utime(abandoned, (long_ago, long_ago))
    (project / "src/Main.lf").write_text(MAIN)
    assert run(project, "src/Main.lf").returncode == 0
    assert left(project) == []


def test_files_beside_the_program_need_no_other_folder(project: Path) -> None:
    (project / "src/Main.lf").write_text(
        'target Python { files: "notes.txt" }\n'
        "main reactor { reaction(startup) {= print(__file__, lf.source_directory()) =} }\n"
    )
    home = project / "src"
    assert run(project, "src/Main.lf").stdout == f"{home / 'Main.lf'} {home}\n"
