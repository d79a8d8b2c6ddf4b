"""``hprm explain``: its examples that need the command, and the handbook's pages of its texts.

``crates/hprm-lf/tests/language/explanations.rs`` runs the examples for which the check alone is
enough. With ``HPRM_WRITE_SNAPSHOTS=1`` the table of the handbook is written anew.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import executables
import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "crates/hprm-model/src/explanation"
PAGE = ROOT / "docs/reference/diagnostics.md"
COMMAND = str(Path(sys.executable).with_name("hprm"))

HEADING = re.compile(r"^## (error|warning)\[(LF\d{4})\]: (.+)$", re.MULTILINE)
# What a diagnostic begins with, as text or as JSON.
SAID = re.compile(r'(?:error\[|warning\[|"code":")(LF\d{4})')
# Codes that no program in an `.lf` file or in Python can give in an example; their texts say why.
WITHOUT_EXAMPLE = {"LF0103", "LF0313", "LF0504"}


def hprm(*words: str, folder: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [COMMAND, *words],
        cwd=folder,
        env=os.environ | {"TERM": "dumb"} | environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def sections() -> dict[str, list[tuple[str, str, str]]]:
    """Of each file, the severities, codes and titles."""
    return {path.stem: HEADING.findall(path.read_text()) for path in sorted(SOURCES.iterdir())}


def explained(*codes: str) -> list[dict[str, Any]]:
    done = hprm("explain", "--json", *codes)
    assert (done.returncode, done.stderr) == (0, "")
    return [json.loads(line) for line in done.stdout.splitlines()]


def needing_the_command() -> list[str]:
    """Return the codes whose examples the check of `.lf` files alone cannot run."""
    parts = HEADING.split("".join(path.read_text() for path in sorted(SOURCES.iterdir())))
    return [
        code
        for code, text in zip(parts[2::4], parts[4::4], strict=True)
        if code > "LF10" or re.search("^```(?:console|python)", text, re.MULTILINE)
    ]


@pytest.mark.parametrize("code", needing_the_command())
def test_an_example_gives_its_code_and_the_mended_one_nothing(code: str, tmp_path: Path) -> None:
    [explanation] = explained(code)
    assert explanation["examples"]
    for number, example in enumerate(explanation["examples"]):
        folder = tmp_path / str(number)
        for file in example["files"]:
            path = folder / file["name"]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(file["text"])
        if code.startswith("LF11"):
            (folder / "bin").mkdir()
            camera = executables.reactor("Camera", [executables.port("frame")])
            rate: dict[str, Any] = {"parameters": [["rate", "u32"]]}
            executables.write(folder / "bin/camera", executables.document(camera, **rate))
            wrong = {"wrong": ["rate", "expected u32, found the str 'fast'"]}
            refused = executables.document(camera, refused=wrong, **rate)
            (folder / "bin/camera.json.fast").write_text(refused)
        command = example["command"] or f"hprm check {example['files'][0]['name']}"
        done = hprm(*shlex.split(command)[1:], folder=folder)
        said = done.stdout + done.stderr
        assert set(SAID.findall(said)) == (set() if example["right"] else {code}), said
        is_wrong = not example["right"] and explanation["severity"] == "error"
        assert done.returncode == is_wrong, said


def test_each_code_has_its_examples() -> None:
    without = {it["code"] for it in explained() if not it["examples"]}
    assert without == WITHOUT_EXAMPLE


def test_all_codes_are_listed_by_their_subjects() -> None:
    lines = hprm("explain").stdout.splitlines()
    assert lines[0] == "LF00: the text of a file"
    listed = [line.split()[:2] for line in lines if line.startswith("  ")]
    assert listed == [[code, kind] for found in sections().values() for kind, code, _ in found]


def test_the_beginning_of_codes_stands_for_all_of_them() -> None:
    lines = hprm("explain", "lf08").stdout.splitlines()
    assert lines[0] == "LF08: federations"
    assert [line.split()[0] for line in lines[1:]] == [
        "LF0801",
        "LF0802",
        "LF0803",
        "LF0804",
        "LF0805",
        "LF0806",
    ]
    codes = [it["code"] for it in explained("LF08", "LF0503")]
    assert codes == ["LF0801", "LF0802", "LF0803", "LF0804", "LF0805", "LF0806", "LF0503"]
    assert hprm("explain", "LF08", "LF0503").stdout.count("LF0804") == 1


def test_a_code_is_explained_in_the_width_of_the_terminal() -> None:
    done = hprm("explain", "lf503", COLUMNS="60")
    assert done.returncode == 0
    assert done.stdout.startswith("error[LF0503]: ")
    assert all(len(line) <= 60 for line in done.stdout.splitlines() if line[:1] != " ")
    assert done.stdout != hprm("explain", "LF0503", COLUMNS="100").stdout
    markdown = hprm("explain", "--markdown", "503").stdout
    assert markdown.startswith("# error[LF0503]: ") and "\n```lf\n" in markdown


def test_an_unknown_code_is_an_error_with_the_nearest_ones() -> None:
    done = hprm("explain", "LF0508")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("error: there is no code `LF0508`\n  hint: near it: LF0501 (")
    done = hprm("explain", "--json", "LF9999")
    assert json.loads(done.stderr)["hint"] == "hprm explain lists all codes"
    assert done.returncode == 1


def test_a_report_ends_with_how_to_read_more(tmp_path: Path) -> None:
    (tmp_path / "Main.lf").write_text("target Python\nmain reactor { state x: int  action a }\n")
    for verb in "check", "run":
        done = hprm(verb, "Main.lf", folder=tmp_path)
        assert done.stderr.endswith("\n\n`hprm explain LF0202 LF0209` says more\n"), verb
        assert done.stderr.count("hprm explain") == 1
    assert "hprm explain" not in hprm("run", "--json", "Main.lf", folder=tmp_path).stderr
    (tmp_path / "Main.lf").write_text("target Python\nmain reactor { }\n")
    assert hprm("check", "Main.lf", folder=tmp_path).stderr == ""


def slug(title: str) -> str:
    """What Sphinx and GitHub make of a heading, for links to it."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def test_the_handbook_has_a_table_of_all_codes() -> None:
    text = PAGE.read_text()
    head, mark, _ = text.partition("## All codes\n")
    assert mark
    rows = ["\n| code | | what is wrong |\n|---|---|---|\n"]
    for group, found in sections().items():
        for kind, code, title in found:
            link = f"diagnostics/{group}.md#{slug(f'{kind}[{code}]: {title}')}"
            rows.append(f"| [`{code}`]({link}) | {kind} | {title} |\n")
    groups = "".join(f"diagnostics/{group}\n" for group in sections())
    rows.append(f"\n```{{toctree}}\n:hidden:\n\n{groups}```\n")
    made = head + mark + "".join(rows)
    if os.environ.get("HPRM_WRITE_SNAPSHOTS"):
        PAGE.write_text(made)
    assert PAGE.read_text() == made


def test_the_handbook_has_a_page_for_each_group() -> None:
    pages = {path.stem: path.read_text() for path in (PAGE.parent / "diagnostics").iterdir()}
    expected = {}
    for path in SOURCES.iterdir():
        title = path.read_text().partition("\n")[0]
        source = f"../../../{path.relative_to(ROOT).as_posix()}"
        expected[path.stem] = f"{title}\n\n```{{include}} {source}\n:start-line: 1\n```\n"
    assert pages == expected
