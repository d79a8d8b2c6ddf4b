"""Stands in for cargo while maturin builds: one run compiles the extension and the command.

Two runs would compile what both are made of twice, because cargo chooses the features of
dependencies by the crates that are built together. All other commands go to cargo unchanged.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

CRATES = ("hprm-python", "hprm-cli")
COMMAND = "hprm"
WHOLE = ("--features", "hprm-cli/whole")
BARE = ("--no-default-features", "--config", "profile.release.lto=false")


def main(words: list[str]) -> int:
    """Run cargo, and return its exit code."""
    if words[:1] != ["rustc"]:
        os.execvp("cargo", ["cargo", *words])
    build = ["cargo", "build", *for_both(words[1:])]
    # maturin reads what cargo has made from its output, and so do we.
    with subprocess.Popen(build, stdout=subprocess.PIPE, text=True) as cargo:
        assert cargo.stdout
        for line in cargo.stdout:
            print(line, end="", flush=True)
            if executable := executable_of(line):
                shutil.copy2(executable, Path(os.environ["HPRM_SCRIPTS"], COMMAND))
    return cargo.returncode


def for_both(words: list[str]) -> list[str]:
    """The options of `cargo rustc` for the extension, as those of `cargo build` for both crates."""
    options, dashes, last = [], "", iter(words)
    for word in last:
        if word == "--":
            dashes = word
            break
        if word == "--crate-type":
            next(last)
        elif word != "--lib" and not word.startswith("--crate-type="):
            options.append(word)
    if dashes and (flags := list(last)):
        # They are for one crate.
        sys.exit(f"error: cargo build takes no flags of rustc: {' '.join(flags)}")
    options += WHOLE if os.environ.get("HPRM_WHOLE") == "1" else BARE
    return options + [word for crate in CRATES for word in ("--package", crate)]


def executable_of(line: str) -> str | None:
    """Where the command is, if this line of cargo's output says so."""
    message = json.loads(line) if line.startswith("{") else {}
    if message.get("reason") != "compiler-artifact" or message["target"]["name"] != COMMAND:
        return None
    return message["executable"]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
