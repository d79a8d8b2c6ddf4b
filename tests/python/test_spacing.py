"""Minimum spacing of actions, as a program sees it."""

from typing import Any

import pytest

PROGRAM = """
target Python {{ timeout: 30 ms, fast: true }}
main reactor {{
  timer t(0, 10 ms)
  logical action a(1 ms, 25 ms{policy})
  state count = 0
  reaction(t) -> a {{=
    a.schedule(0, self.count)
    self.count += 1
  =}}
  reaction(a) {{= print(lf.time.logical_elapsed() // MSEC(1), a.value) =}}
}}
"""


@pytest.mark.parametrize(
    ("policy", "expected"),
    [
        ("", ["1 0", "26 1"]),
        (', "defer"', ["1 0", "26 1"]),
        (', "drop"', ["1 0"]),
        (', "replace"', ["1 0", "26 2"]),
        (', "update"', ["1 0", "11 1", "21 2"]),
    ],
)
def test_each_policy(run: Any, policy: str, expected: list[str]) -> None:
    outcome = run(PROGRAM.format(policy=policy))
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == expected


@pytest.mark.parametrize("policy", ["drop", "replace", "update"])
def test_a_displaced_value_may_use_the_runtime_as_it_goes(run: Any, policy: str) -> None:
    outcome = run(
        f"""
        target Python {{ fast: true }}
        preamble {{=
          class Last:
              def __init__(self, name): self.name = name
              def __del__(self): print("gone", self.name, lf.time.logical_elapsed())
        =}}
        main reactor {{
          logical action a(1 ms, 25 ms, "{policy}")
          reaction(startup) -> a {{=
            a.schedule(0, Last("first"))
            a.schedule(0, Last("second"))
            print("after")
          =}}
          reaction(a) {{= print(a.value.name) =}}
        }}
        """
    )
    assert outcome.code == 0, outcome.err
    kept, gone = ("first", "second") if policy == "drop" else ("second", "first")
    assert outcome.out.splitlines()[:3] == ["after", f"gone {gone} 0", kept]
