"""Checks of the repository itself: rules of CONTRIBUTING.md, and documents that are true."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
GENERATED = {"target", "out", "__pycache__", "corpus"}
LONGEST_FILE = 800
UNSAFE_ROOMS = {
    "crates/hprm-store/src/at_fork.rs",
    "crates/hprm-store/src/shm/cow.rs",
    "crates/hprm-store/src/shm/locks.rs",
    "crates/hprm-store/src/shm/mapping.rs",
    "crates/hprm-store/src/shm/published.rs",
    "crates/hprm-store/src/shm/segment.rs",
    "crates/hprm-store/src/shm/streaming.rs",
    "crates/hprm-store/src/shm/view.rs",
    "crates/hprm-store/src/shm/words.rs",
    "crates/hprm-python/src/buffer.rs",
    "crates/hprm-python/src/numpy_memory/abi.rs",
    "crates/hprm-python/src/numpy_memory/handler.rs",
    "crates/hprm-python/src/numpy_memory/publish.rs",
    "crates/hprm-python/src/numpy_memory/references.rs",
}

# Where the words of the glossary are used and retired ones are gone; in the end, everywhere.
CLEANED_UP = (
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "README.md",
    "crates/hprm-cli/",
    "crates/hprm-codec/",
    "crates/hprm-core/",
    "crates/hprm-declared/",
    "crates/hprm-diagram/",
    "crates/hprm-federated/",
    "crates/hprm-lf/",
    "crates/hprm-model/",
    "crates/hprm-python/",
    "crates/hprm-sim/",
    "crates/hprm-store/",
    "crates/hprm/",
    "docs/",
    "python/",
    "tests/lf/",
)
# Where diagnostics come from.
CHECKS = (
    "crates/hprm-cli/src",
    "crates/hprm-declared/src",
    "crates/hprm-lf/src",
    "crates/hprm-model/src",
    "crates/hprm-python/src",
    "python/hprm",
)
# Public names that have a retired word and stay.
PUBLIC_NAMES = re.compile(r"objects_passed_on")
# In documents, names of files and tests, and code.
CODE_SPAN = re.compile(r"`[^`]*`")

# Put together from halves, so that this file does not find itself.
UNFINISHED = re.compile("|".join(["to" + "do!", "unimple" + "mented!", "FIX" + "ME", "XX" + "X:"]))
UNSAFE = re.compile(r"\bunsafe\b|allow\(unsafe_code\)")


def sources(*suffixes: str) -> Iterator[tuple[str, str]]:
    """Path, relative to the root, and text of every file of the repository with such a suffix."""
    for directory, subdirectories, files in os.walk(ROOT):
        # Hidden directories hold what tools keep for themselves: .git, .venv, caches.
        subdirectories[:] = [
            name for name in subdirectories if name not in GENERATED and not name.startswith(".")
        ]
        for name in files:
            path = Path(directory, name)
            if path.suffix in suffixes:
                yield path.relative_to(ROOT).as_posix(), path.read_text()


def without_rust_comments(text: str) -> str:
    """The code of a Rust file; a line's comment is cut off at `//`."""
    return "\n".join(line.partition("//")[0] for line in text.splitlines())


def fenced(document: str, language: str) -> str:
    """The first code block of a document of the root that is marked with this language."""
    text = (ROOT / document).read_text()
    block = re.search(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    assert block, f"{document} has no block of {language}"
    return block[1]


def headings(text: str) -> list[str]:
    """The first-level headings of a Markdown text, outside of code fences."""
    parts = re.split(r"^```.*$", text, flags=re.MULTILINE)
    return re.findall(r"^# .+$", "\n".join(parts[::2]), flags=re.MULTILINE)


def retired_words() -> dict[str, str]:
    """The words that the glossary retires, each with the standard term."""
    text = (DOCS / "reference" / "glossary.md").read_text().partition("## Retired words")[2]
    rows = re.findall(r"^\| (`.+`) \| (.+) \|$", text, flags=re.MULTILINE)
    return {word: term for words, term in rows for word in re.findall(r"`([^`]+)`", words)}


def retired(word: str) -> re.Pattern[str]:
    """Finds a word or its plural in sentences and in names: `yard`, `two_yards`, `YardKey`."""
    return re.compile(rf"(?<![A-Za-z]){word.replace(' ', '[ _]')}s?(?![a-z])", re.IGNORECASE)


def test_every_rust_source_says_what_it_owns() -> None:
    silent = [path for path, text in sources(".rs") if not text.startswith("//!")]
    assert silent == []


def test_every_python_source_says_what_it_owns() -> None:
    silent = [path for path, text in sources(".py") if not ast.get_docstring(ast.parse(text))]
    assert silent == []


def test_no_file_is_too_long() -> None:
    long = {
        path: lines
        for path, text in sources(".rs", ".py", ".pyi", ".md", ".lf", ".toml")
        if (lines := text.count("\n")) > LONGEST_FILE
    }
    assert long == {}


def test_every_document_has_one_title() -> None:
    wrong = {path: found for path, text in sources(".md") if len(found := headings(text)) != 1}
    assert wrong == {}


def test_every_link_between_documents_leads_somewhere() -> None:
    links = [
        (path, target)
        for path, text in sources(".md")
        for target in re.findall(r"\]\(([^)#:]+)\)", text)
    ]
    broken = [link for link in links if not (ROOT / link[0]).parent.joinpath(link[1]).exists()]
    assert links != []
    assert broken == []


def test_every_test_that_the_list_of_features_names_exists() -> None:
    text = (DOCS / "reference" / "features.md").read_text()
    named = re.findall(r"`((?:crates|tests)/[^`]+)`", text)
    assert named != []
    assert [path for path in named if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("page", ["failures", "threat-model"])
def test_every_test_that_a_page_names_exists(page: str) -> None:
    named = set(re.findall(r"`(test_\w+)`", (DOCS / "concepts" / f"{page}.md").read_text()))
    tests = "".join(path.read_text() for path in (ROOT / "tests").glob("*/test_*.py"))
    assert len(named) > 10
    assert {name for name in named if f"def {name}(" not in tests} == set()


def test_the_program_of_the_readme_prints_what_the_readme_says(tmp_path: Path) -> None:
    program = tmp_path / "Camera.lf"
    program.write_text(fenced("README.md", "lf"))
    hprm = Path(sys.executable).parent / "hprm"
    argv = [str(hprm), "run", str(program)]
    run = subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False)
    assert (run.stdout, run.returncode) == (fenced("README.md", "text"), 0), run.stderr


def test_the_program_of_the_readme_is_that_of_the_handbook() -> None:
    assert fenced("README.md", "lf") in (DOCS / "index.md").read_text()


def test_nothing_is_left_unfinished() -> None:
    unfinished = [
        f"{path}:{number}"
        for path, text in sources(".rs", ".py", ".pyi", ".lf", ".md")
        for number, line in enumerate(text.splitlines(), start=1)
        if UNFINISHED.search(line)
    ]
    assert unfinished == []


def test_unsafe_code_keeps_to_its_rooms() -> None:
    rooms = {path for path, text in sources(".rs") if UNSAFE.search(without_rust_comments(text))}
    assert rooms <= UNSAFE_ROOMS


def test_retired_words_stay_away() -> None:
    words = {word: (retired(word), term) for word, term in retired_words().items()}
    found = [
        f"{path}:{number}: {word!r}; the glossary has: {term}"
        for path, text in sources(".rs", ".py", ".pyi", ".lf", ".md")
        if path.startswith(CLEANED_UP) and path != "docs/reference/glossary.md"
        # Nearly all lines have no such word, which is found out quickly.
        for word, (pattern, term) in words.items()
        if (begins := word.split()[0].lower()) in (lowered := text.lower())
        for number, lower in enumerate(lowered.splitlines(), start=1)
        if begins in lower
        if pattern.search(prose(path, text.splitlines()[number - 1]))
    ]
    assert len(words) > 30
    assert found == []


def prose(path: str, line: str) -> str:
    """Returns a line without what is no prose of ours: names, and code in documents."""
    return PUBLIC_NAMES.sub("", CODE_SPAN.sub("", line) if path.endswith(".md") else line)


def test_the_checks_find_what_they_look_for() -> None:
    assert UNFINISHED.search("    to" + "do!()")
    assert UNSAFE.search(without_rust_comments("let x = un" + "safe { y };"))
    assert not UNSAFE.search(without_rust_comments("#![forbid(un" + "safe_code)] // unsafe"))
    assert all(retired("yard").search(text) for text in ("a yard", "two_yards", "Yard::new"))
    assert not any(retired("who").search(text) for text in ("the whole", "whose"))
    assert headings("# One\n```sh\n# a comment\n```\n# Two\n") == ["# One", "# Two"]


def test_every_code_of_a_diagnostic_is_explained_and_every_explanation_has_a_code() -> None:
    code = re.compile(r'"(LF\d{4})"')
    used = {
        found
        for path, text in sources(".rs", ".py")
        if path.startswith(CHECKS)
        for found in code.findall(text)
    }
    texts = sorted((ROOT / "crates/hprm-model/src/explanation").iterdir())
    explained = re.findall(
        r"^## (?:error|warning)\[(LF\d{4})\]: ",
        "".join(path.read_text() for path in texts),
        flags=re.MULTILINE,
    )
    assert explained == sorted(used)


def test_every_lock_file_knows_what_our_crates_need() -> None:
    """Other workspaces compile our crates with ``--locked``, which fails where one is too old."""
    manifests = {path.parent.name: path.read_text() for path in ROOT.glob("crates/*/Cargo.toml")}
    others = ("bench/*", "crates/hprm-agent", "fuzz")
    locks = [ROOT / "Cargo.lock", *(it for at in others for it in ROOT.glob(f"{at}/Cargo.lock"))]
    missing = [
        f"{lock.relative_to(ROOT)}: {crate} needs {name}"
        for lock in locks
        for crate, known in locked(lock.read_text()).items()
        for name in sorted(needed(manifests[crate]) - known)
    ]
    assert len(locks) > 4
    assert missing == []


def locked(text: str) -> dict[str, set[str]]:
    """Return the dependencies of our crates in a lock file, by name."""
    found = {}
    for package in text.split("[[package]]\n")[1:]:
        name = re.search(r'^name = "(.*)"', package)
        if name and (ROOT / "crates" / name[1]).is_dir() and "\nsource = " not in package:
            found[name[1]] = set(re.findall(r'^ "([^" ]+)', package, flags=re.MULTILINE))
    return found


def needed(manifest: str) -> set[str]:
    """Return the dependencies that a crate always has."""
    section = manifest.partition("\n[dependencies]\n")[2].partition("\n[")[0]
    lines = (line for line in section.splitlines() if "optional = true" not in line)
    return {found[1] for line in lines if (found := re.match(r"([\w-]+)[. ]", line))}
