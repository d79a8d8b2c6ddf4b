"""Every code block of the handbook does what its page says; `stories.py` runs them."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
import uuid
from pathlib import Path

import pytest
from stories import ROOT, Block, Story, blocks, same
from tcp_ports import free_ports

DOCS = ROOT / "docs"
PAGES = sorted(page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md"))
# Why blocks are only shown; the fewer, the better.
NOT_RUN = {
    "benchmarks.md": ["it measures for half an hour"],
    "howto/bags.md": [
        *["test_ros_bags.py does, with a bag that the package rosbags has written"] * 2,
        *["test_ros_bag_nodes.py does"] * 2,
    ],
    "howto/evaluation.md": ["it measures for most of an hour"] * 2,
    "howto/from-ros2.md": [
        "test_ros_port.py compares it",
        "rclpy comes with an installation of ROS 2",
    ],
    "howto/mixed.md": ["test_mixed.py runs it, with an executable that cargo has built"] * 2,
    "howto/profiling.md": ["py-spy needs the permission to trace processes"],
    "howto/ros2.md": [
        "it needs an installation of ROS 2",
        "test_ros_zenoh.py does, with a node whose keys and bytes are written out by hand",
        "test_ros_zenoh.py does, on a port of its own",
    ],
    "howto/tracing.md": ["test_run_trace.py runs it, in several processes"],
    "reference/command-line.md": ["jq is not on every machine"],
}


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(DOCS / page)])
def test_a_page_tells_the_truth(page: str, tmp_path: Path) -> None:
    if "openssl" in (DOCS / page).read_text() and shutil.which("openssl") is None:
        pytest.skip("openssl, which the page calls, is missing")
    rti, federate, viewers, router = free_ports(4)
    stand_ins = {
        "robot.local": "127.0.0.1",
        "15045": str(rti),
        "15046": str(federate),
        "8765": str(viewers),
        "7447": str(router),
        "unix:@robot": f"unix:@hprm-{uuid.uuid4().hex}",
    }
    Story(DOCS / page, tmp_path, stand_ins).run()


def test_blocks_that_are_not_run_are_listed_here() -> None:
    found = {
        page: reasons
        for page in PAGES
        if (reasons := [block.not_run for block in blocks(DOCS / page) if block.not_run])
    }
    assert found == NOT_RUN


def test_the_handbook_builds_without_a_warning(tmp_path: Path) -> None:
    argv = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-d", tmp_path / "doctrees"]
    done = subprocess.run(
        [*argv, DOCS, tmp_path / "html"], capture_output=True, text=True, timeout=300, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    pages = "".join(page.read_text() for page in (tmp_path / "html").rglob("*.html"))
    assert 'src="http' not in pages, "a page fetches something from the net"
    assert 'rel="stylesheet" href="http' not in pages


def test_diagrams_are_what_their_script_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOCS / "_diagrams"))
    sequences = importlib.import_module("sequences")
    for draw in sequences.DIAGRAMS:
        diagram = draw()
        drawn = (DOCS / "_diagrams" / f"{diagram.name}.svg").read_text()
        assert drawn == diagram.svg(), "python docs/_diagrams/sequences.py"


def test_what_is_printed_is_compared_as_writers_are_told() -> None:
    assert same("a ... c\n", "a b c\n")
    assert same("first\n...\nlast\n", "first\n1\n2\nlast\n")
    assert same("[a] 1\n[a] 2\n[b] 1\n", "[a] 1\n[b] 1\n[a] 2\n")
    assert not same("[a] 1\n[a] 2\n", "[a] 2\n[a] 1\n")
    assert not same("", "something\n")
    assert not same("a\n", "a\nb\n")


def page_of(folder: Path, text: str) -> Story:
    """A story of one page with this text, below the root so that places can be told."""
    page = folder / "page.md"
    page.write_text(text)
    return Story(page, folder, {"15045": "1"})


def test_each_kind_of_block_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stories.ROOT", tmp_path)
    (tmp_path / "given.py").write_text("print('given')\n")
    page_of(tmp_path, TELLING).run()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("```console\n$ echo a\nb\n```\n", "page.md:1: `echo a` printed\na"),
        ("\n```console\n$ false\n```\n", "page.md:2: `false` ended with 1"),
        ("```console\n$ false\n$ true\n```\n", "before `true`, a command ended with 1"),
        ("```python\nprint(1)\n```\n```text\n2\n```\n", "printed\n1"),
        ("```python\nraise ValueError\n```\n", "ValueError"),
        ("```lf\nreactor R { input i\n```\n", "page.md:1 ended with"),
        ("```pycon\n>>> 1\n2\n```\n", "Expected:\n    2"),
        ("```text\n2\n```\n", "no block before this text has run"),
        ("```rust\nfn main() {}\n```\n", "so nothing runs this"),
        ("```fortran\nEND\n```\n", "no test runs a block of 'fortran'"),
    ],
)
def test_a_block_that_does_not_do_what_it_says_is_found(
    text: str, fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stories.ROOT", tmp_path)
    lib = tmp_path / "crates" / "hprm" / "src" / "lib.rs"
    lib.parent.mkdir(parents=True)
    lib.write_text("")
    with pytest.raises(AssertionError) as caught:
        page_of(tmp_path, text).run()
    assert fault in str(caught.value)


def test_a_reason_stands_before_a_block_that_is_not_run(tmp_path: Path) -> None:
    page = ROOT / "docs" / "index.md"
    text = "<!-- not run: it needs a robot -->\n```sh\nfalse\n```\n"
    draft = tmp_path / "page.md"
    draft.write_text(text)
    assert [block.not_run for block in blocks(draft)] == ["it needs a robot"]
    assert Block(page, 7, "text", "").where == "docs/index.md:7"


TELLING = """\
# A page

A file, and commands in a console:

```{code-block} lf
:caption: Hello.lf

target Python
main reactor { reaction(startup) {= print("hello") =} }
```

```console
$ hprm run Hello.lf
hello
$ mkdir sub && cd sub
$ export X=1
$ echo "$X" $(basename $PWD)
1 sub
$ cd ..
$ hprm run None.lf
error: ...
...
$ echo $?
1
```

A program in Python and what it prints; a shell script; a session; members of a reactor:

```python
print("a", "b")
```

```text
a b
```

```sh
test -f Hello.lf
```

```pycon
>>> x = 1
```

```pycon
>>> x + 1
2
```

```lf
timer t(0, 1 s)
reaction(t) {= print("t") =}
```

```{literalinclude} given.py
```

:::{tab-set}
:::{tab-item} Python
```console
$ python given.py
given
```
:::
:::

Terminals:

```{code-block} console
:caption: Terminal 1

$ cat < fifo-15045 || until test -f done; do sleep 0.01; done
...
```

```{code-block} console
:caption: Terminal 2

$ touch done
```

```{code-block} console
:caption: Two terminals

$ touch begun; sleep 3600
^C
$ until test -f begun; do sleep 0.01; done
```

```
a picture
```
"""
