"""The measurements of growth and of watching: a little of all that they do. Nothing is timed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "bench" / "growth.py"
MEASURES = {"latency", "cpu", "memory", "links", "rate"}


def run(*words: str) -> subprocess.CompletedProcess[str]:
    argv = [sys.executable, str(SCRIPT), *words]
    return subprocess.run(argv, capture_output=True, text=True, timeout=300, check=False)


def test_a_little_of_all_gives_a_page_with_pictures_and_tables(tmp_path: Path) -> None:
    done = run("--quick", "--out", str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    assert {it.stem for it in tmp_path.glob("*.json")} == MEASURES
    for name in MEASURES:
        record = json.loads((tmp_path / f"{name}.json").read_text())
        ways = {it["contender"] for it in record["cells"]}
        assert ways == {"hprm centralized", "hprm decentralized"}
        assert all(list(it["values"].values())[0] > 0 for it in record["cells"])
    page = (tmp_path / "index.html").read_text()
    assert page.count("<svg") == page.count("<table>") == len(MEASURES)
    assert f"wrote {tmp_path / 'index.html'}" in done.stdout
    assert "4 federates" in done.stdout and "1 MiB" in done.stdout


@pytest.mark.parametrize("words", [("--repetitions", "0"), ("--repetitions", "many"), ("--fast",)])
def test_options_that_make_no_sense_are_refused(words: tuple[str, ...]) -> None:
    done = run(*words)
    assert done.returncode == 2
    assert "error: " in done.stderr


def test_a_folder_that_cannot_be_made_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = run("--quick", "--out", os.fspath(tmp_path / "file" / "folder"))
    assert done.returncode == 1
    assert done.stderr.startswith("error: ") and "Traceback" not in done.stderr


def test_a_federation_is_watched_in_all_ways(tmp_path: Path) -> None:
    out = tmp_path / "watching.json"
    words = ["--repetitions", "1", "--messages", "50", "--beginning", "0.5", "--out", str(out)]
    argv = [sys.executable, str(SCRIPT.parent / "watching.py"), *words]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for by_way in json.loads(out.read_text())["us"].values():
        assert list(by_way) == ["plain", "--trace", "hprm top", "hprm rate", "hprm echo"]
        assert all(len(values) == 1 and values[0] > 0 for values in by_way.values())
    assert "of plain" in done.stdout
