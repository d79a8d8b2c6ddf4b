"""``hprm diagram``: files of all formats, and one clear error where there is none.

What diagrams look like is tested in ``crates/hprm-diagram``.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from processes import rust_examples

ROOT = Path(__file__).resolve().parents[2]
COMMAND = str(Path(sys.executable).with_name("hprm"))
PIPELINE = ROOT / "examples/pipeline/Pipeline.lf"
MAIN = """
target Python
reactor A { input x  output y  reaction(x) -> y {= y.set(1) =} }
main reactor { a = new A()  b = new A()  a.y -> b.x  b.y -> a.x }
"""


def draw(*words: object, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [COMMAND, "diagram", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=folder,
    )


@pytest.mark.parametrize("ending", ["svg", "png", "html"])
def test_the_ending_is_the_format_and_the_same_program_gives_the_same_file(
    ending: str, tmp_path: Path
) -> None:
    files = [tmp_path / f"{name}.{ending}" for name in ("one", "two")]
    for file in files:
        done = draw(PIPELINE, "--output", file, folder=tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (0, f"wrote {file}\n", "")
    one, two = (file.read_bytes() for file in files)
    assert one == two
    if ending == "svg":
        assert ElementTree.fromstring(one).tag.endswith("svg")
    elif ending == "png":
        assert one.startswith(b"\x89PNG")
    else:
        assert one.startswith(b"<!doctype html>")
        # The page fetches nothing.
        assert b"http" not in one.replace(b"http://www.w3.org/2000/svg", b"")


def test_an_executable_that_is_a_federation_is_drawn(tmp_path: Path) -> None:
    done = draw(rust_examples() / "pipeline", "--output", "pipeline.svg", folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "wrote pipeline.svg\n", "")
    texts = {it.text for it in ElementTree.parse(tmp_path / "pipeline.svg").iter()}
    assert {"camera", "detector", "planner", "motor"} <= {str(it).strip() for it in texts}


# What federates of other programs declare, and programs of one process: the second with its modes.
@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("camera", {"tick", "image"}),
        ("mixer", {"voices[3]", "×2"}),
        ("modes", {"working", "resting"}),
    ],
)
def test_an_executable_without_federates_is_drawn(
    tmp_path: Path, name: str, parts: set[str]
) -> None:
    done = draw(rust_examples() / name, "--output", "one.svg", folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "wrote one.svg\n", "")
    texts = {str(it.text).strip() for it in ElementTree.parse(tmp_path / "one.svg").iter()}
    assert parts <= texts


def test_a_federate_that_needs_parameters_is_one_error(tmp_path: Path) -> None:
    scanner = rust_examples() / "scanner"
    done = draw(scanner, folder=tmp_path)
    assert (done.returncode, done.stderr) == (
        1,
        f"error: {scanner} is a federate that needs the parameter `period`\n"
        "  hint: name the program instead that states its value\n",
    )
    assert not list(tmp_path.iterdir())


def test_the_picture_of_the_readme_is_what_the_command_draws(tmp_path: Path) -> None:
    draw(PIPELINE, folder=tmp_path)
    kept = ROOT / "docs/_static/pipeline.svg"
    assert (tmp_path / "Pipeline.svg").read_text() == kept.read_text(), (
        f"hprm diagram {PIPELINE.relative_to(ROOT)} --output {kept.relative_to(ROOT)}"
    )


def test_a_program_in_python_has_the_names_of_its_methods(tmp_path: Path) -> None:
    done = draw(ROOT / "examples/pipeline/pipeline.py", "-o", "p.svg", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "camera" in (tmp_path / "p.svg").read_text()


def test_a_causality_loop_is_drawn_in_red(tmp_path: Path) -> None:
    (tmp_path / "Main.lf").write_text(MAIN)
    done = draw("Main.lf", folder=tmp_path)
    assert done.returncode == 1
    assert done.stdout == "wrote Main.svg\n"
    assert done.stderr.count("error[LF0503]") == 1
    assert (tmp_path / "Main.svg").read_text().count('stroke="#d1242f"') >= 6


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["Main.lf", "--output", "x.gif"], "error: x.gif has no ending of a picture"),
        (["Main.lf", "--output", "nowhere/x.svg"], "error: cannot write nowhere/x.svg"),
        (["Nothing.lf"], "error: cannot read Nothing.lf"),
        (["Wrong.lf"], "error[LF0301]: there is no reactor `Nope`"),
    ],
)
def test_what_cannot_be_drawn_is_one_error_and_no_file(
    words: list[str], message: str, tmp_path: Path
) -> None:
    (tmp_path / "Main.lf").write_text("target Python\nmain reactor { }\n")
    (tmp_path / "Wrong.lf").write_text("target Python\nmain reactor { x = new Nope() }\n")
    done = draw(*words, folder=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith(message), done.stderr
    assert done.stderr.count("error") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["Main.lf", "Wrong.lf"]


def test_icons_are_in_the_file_and_one_that_is_missing_is_a_warning(tmp_path: Path) -> None:
    (tmp_path / "eye.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    (tmp_path / "Main.lf").write_text(
        "target Python\n"
        '@icon("eye.svg")\nreactor A { reaction(startup) {= pass =} }\n'
        '@icon("ear.svg")\nreactor B { reaction(startup) {= pass =} }\n'
        'main reactor { a = new A()\n @label("hears") b = new B() }\n'
    )
    done = draw("Main.lf", folder=tmp_path)
    assert done.returncode == 0
    assert done.stderr.startswith("warning: the icon ear.svg is left out: No such file")
    picture = (tmp_path / "Main.svg").read_text()
    assert picture.count("data:image/svg+xml;base64,") == 1
    assert ">hears</text>" in picture
