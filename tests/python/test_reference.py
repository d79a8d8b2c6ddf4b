"""The pages of reference have all that the code has, and nothing else."""

from __future__ import annotations

import pydoc
import re
import subprocess
import sys
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import pytest

import hprm
from hprm import _hprm, _lf, _main, testing
from hprm._classes import ReactorBase
from hprm._ports import MutableInput

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = ROOT / "docs" / "reference"
MODEL = ROOT / "crates" / "hprm-model" / "src"


def page(name: str) -> str:
    return (REFERENCE / name).read_text()


def rows(text: str) -> list[list[str]]:
    """The cells of all tables, without heads and lines below them."""
    lines = [line.strip().strip("|") for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)] for line in lines]
    rules = [index for index, row in enumerate(cells) if set("".join(row)) <= {"-"}]
    heads = {index - 1 for index in rules}
    return [row for index, row in enumerate(cells) if index not in heads | set(rules)]


def first_codes(text: str) -> list[str]:
    """What the first cells of all tables have as code."""
    return [code for row in rows(text) for code in re.findall(r"`([^`]+)`", row[0])]


def words(path: Path, constant: str) -> list[str]:
    """The texts of a constant that is a list of texts."""
    found = re.search(rf"const {constant}: \[&str; \d+\] =\s*\[(.*?)\];", path.read_text(), re.S)
    assert found, f"{path} has no list {constant}"
    text = found[1].replace("restart::ATTRIBUTE", '"restart"').replace("ATTRIBUTE", '"executable"')
    return re.findall(r'"([^"]+)"', text)


def section(text: str, title: str) -> str:
    return text.split(f"\n## {title}\n")[1].split("\n## ")[0]


def test_every_target_property_is_on_the_page() -> None:
    text, source = page("target-properties.md"), MODEL / "properties.rs"
    obeyed = section(text, "Properties that count")
    options = words(MODEL / "clock_property.rs", "OPTIONS")
    stated = [row[0].strip("`") for row in rows(obeyed)]
    assert stated == [*sorted(words(source, "OBEYED")), *options]
    ignored, not_yet = section(text, "Properties that do nothing").split("not obeyed yet")
    assert first_codes(ignored) == words(source, "IGNORED")
    assert first_codes(not_yet) == words(source, "NOT_YET")


def test_every_attribute_is_on_the_page() -> None:
    source = MODEL / "check" / "attributes.rs"
    table = page("language/attributes.md").split("\n## ")[0]
    known = [
        name
        for constant in ("OBEYED", "DRAWING", "WITHOUT_EFFECT", "UNSUPPORTED")
        for name in words(source, constant)
    ]
    assert sorted(re.findall(r"^\| \[?`@(\w+)", table, re.M)) == sorted(known)
    properties = re.findall(r"`@(\w+)`", table.split("newer targets:")[1])
    assert sorted(properties) == sorted(words(source, "PROPERTIES"))


def public(thing: Any) -> set[str]:
    return {name for name in dir(thing) if not name.startswith("_")}


def test_every_name_that_a_body_knows_is_on_the_page() -> None:
    text = page("bodies.md")
    stated = {code.split("(")[0] for code in first_codes(text)}
    for prefix, names in (
        ("port.", public(hprm.port_capsule)),
        ("action.", public(hprm.action_capsule_t)),
        ("Mode.", public(_hprm.mode_capsule_t)),
        ("tag.", public(hprm.Tag)),
        ("self.", public(ReactorBase)),
        ("lf.", set(_lf.NAMES)),
        ("lf.time.", set(_lf.TIMES)),
    ):
        told = {code.removeprefix(prefix) for code in stated if code.startswith(prefix)}
        assert {name for name in told if "." not in name} == names, prefix
    assert public(MutableInput) - {"is_present", "set", "value"} == set()
    plain = {code for code in stated if re.fullmatch(r"\w+", code)}
    python = {"len", "hash", "for"}
    assert plain - python - {"__file__"} == set(_main.NAMES)


def test_every_public_name_is_on_a_page() -> None:
    text = page("python-api.md")
    stated = re.findall(r"\.\. auto\w+:: (\S+)", text)
    assert len(stated) == len(set(stated)), "a name is documented twice"
    own = {"Result", "run"}
    defined = {name for name, it in vars(testing).items() if it in _defined_in(testing)}
    assert {name for name in defined if not name.startswith("_")} == own
    expected = {f"hprm.{name}" for name in hprm.__all__}
    expected |= {f"hprm.testing.{name}" for name in own}
    expected |= {"hprm.pytest_plugin.run_reactor", "hprm._hprm.mode_capsule_t"}
    expected |= {"hprm._hprm.Watch", "hprm._hprm.WatchedMessage"}
    assert set(stated) == expected


def _defined_in(module: ModuleType) -> list[Any]:
    """The functions and classes that a module defines itself."""
    return [
        it
        for it in vars(module).values()
        if isinstance(it, FunctionType | type) and it.__module__ == module.__name__
    ]


@pytest.mark.parametrize("name", hprm.__all__)
def test_every_public_name_has_help(name: str) -> None:
    thing = getattr(hprm, name)
    if callable(thing):
        assert thing.__doc__
        assert thing.__doc__[0].isupper()


def test_the_help_of_the_package_is_about_the_package() -> None:
    text = pydoc.plain(pydoc.render_doc(hprm))
    assert "A reactor is a class:" in text
    assert "conjugate(" not in text, "it explains numbers"
    assert "*arguments" not in pydoc.plain(pydoc.render_doc(hprm.Reactor))


@pytest.mark.parametrize(
    "module",
    ["hprm", "hprm._classes", "hprm._parts", "hprm._reactor", "hprm.testing"],
)
def test_examples_in_docstrings_run(module: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", DOCTEST, module], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


# As a program, because a program that runs changes its process.
DOCTEST = """
import doctest, importlib, sys
failed, tried = doctest.testmod(importlib.import_module(sys.argv[1]))
assert tried
sys.exit(failed)
"""


# Documentation, and attributes, of an item in Rust.
DOCUMENTED = r"(?P<text>(?:^///.*\n)*)(?:^#\[(?:[^\]\n]|\][^\n])*(?:\n[^\n]*?)*?\]\n)*"


def prelude() -> dict[str, str]:
    """The items of the prelude in Rust, with what documents them there."""
    text = (ROOT / "crates" / "hprm" / "src" / "prelude.rs").read_text()
    listed = re.findall(rf"(?m){DOCUMENTED}^pub use crate::\{{?([^;]*?)\}}?;", text)
    return {name: text for text, names in listed for name in re.findall(r"\w+", names)}


def test_every_type_of_the_rust_library_is_on_the_page() -> None:
    known = prelude()
    table = [code for row in rows(page("rust-api.md")) for code in re.findall(r"`(\w+)`", row[1])]
    assert sorted(table) == sorted(known)


LIMITS = [row for row in rows(page("limits.md")) if len(row) == 4]
UNITS = {"KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30, "s": 10**9, "ms": 10**6}
UNITS |= {"characters": 1, "days": 1}


def number(stated: str) -> int:
    """The number that a page states, with its unit."""
    digits, _, unit = stated.replace(",", "").partition(" ")
    return int(digits) * (UNITS[unit] if unit else 1)


def constant(path: Path, name: str) -> int:
    """The value of a constant in Rust; times are in nanoseconds."""
    found = re.findall(rf"const {name}: [\w:]+ = (.*?);", path.read_text())
    assert found, f"{path.relative_to(ROOT)} has no constant {name}"
    text = re.sub(r"Duration::from_(secs|millis)\((\d+)\)", r"\2 * \1", found[0])
    text = text.replace("u16::MAX as usize", "0xFFFF").replace("SECOND", "10**9")
    return int(eval(text, {"secs": 10**9, "millis": 10**6}))


@pytest.mark.parametrize("row", LIMITS, ids=lambda row: row[0])
def test_a_limit_is_that_of_the_code(row: list[str]) -> None:
    _, stated, _, where = row
    if not where:
        assert stated == "none"
        return
    name, path = re.findall(r"`([^`]+)`", where)
    assert number(stated) == constant(ROOT / path, name)


# Limits that no program meets, each with a reason.
NOT_STATED = {
    "hprm-core/src/fingerprint.rs": "what is told of programs that differ",
    "hprm-core/src/tag_map.rs": "memory that is kept for later",
    "hprm-lf/src/parser/meant.rs": "what a hint repeats",
    "hprm-model/src/explanation.rs": "what a message offers",
    "hprm-model/src/lower.rs": "what a message shows",
    "hprm-model/src/python.rs": "how a program is read that is cut off",
    "hprm-model/src/render.rs": "what an excerpt shows",
}
LIMIT = r"/// The (?:most|longest|deepest|widest)[^\n]*\n(?:\s*///[^\n]*\n)*[^\n]*const (\w+): "


@pytest.mark.parametrize("crate", ["hprm-core", "hprm-lf", "hprm-model"])
def test_no_limit_of_programs_is_missing(crate: str) -> None:
    stated = {tuple(re.findall(r"`([^`]+)`", row[3])[:2]) for row in LIMITS}
    missing = []
    for path in sorted((ROOT / "crates" / crate / "src").rglob("*.rs")):
        short = path.relative_to(ROOT / "crates").as_posix()
        for name in re.findall(LIMIT, path.read_text()):
            if (name, f"crates/{short}") not in stated and short not in NOT_STATED:
                missing.append(f"{name} in {short}")
    assert not missing, "\n".join(missing)


def test_every_variable_is_on_the_page() -> None:
    sources = [*(ROOT / "crates").glob("*/src/**/*.rs"), *(ROOT / "python").rglob("*.py")]
    text = "\n".join(it.read_text() for it in sources)
    read = set(re.findall(r'"((?:HPRM|LF)_[A-Z_]+)"', text)) - {"HPRM_TEST_INNER"}
    stated = {code for code in first_codes(page("environment.md")) if re.match("HPRM_|LF_", code)}
    assert stated == read


def test_every_item_of_the_prelude_in_rust_has_an_example() -> None:
    """Its own documentation has one, or names an item that has; `cargo test --doc` runs them."""
    crates = ROOT / "crates"
    texts = prelude()
    assert len(texts) > 40
    item = rf"(?m){DOCUMENTED}^pub (?:struct|enum|trait|fn) (?P<name>\w+)"
    for folder in ("hprm/src/program", "hprm/src/failure.rs", "hprm/src/program.rs", "hprm-codec"):
        path = crates / folder
        for file in sorted(path.rglob("*.rs")) if path.is_dir() else [path]:
            for found in re.finditer(item, file.read_text()):
                if found["name"] in texts:
                    texts[found["name"]] += found["text"]

    def has_example(name: str) -> bool:
        elsewhere = re.search(r"\[`(\w+)`\](?:\([\w:]+\))? has an example", texts[name])
        return "```" in texts[name] or bool(elsewhere and "```" in texts[elsewhere[1]])

    assert [name for name in texts if not has_example(name)] == []
