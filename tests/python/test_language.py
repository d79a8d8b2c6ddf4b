"""Corners of the language that show only when a program runs."""

from __future__ import annotations

from conftest import Run


def test_arguments_of_methods_have_defaults(run: Run) -> None:
    outcome = run(
        """
        target Python
        preamble {=
          base = 100
        =}
        main reactor {
          method f(x, y = 2, z = {= base +
              1 =}, t = 1 ms, e = "text") {= return x, y, z, t, e =}
          reaction(startup) {= print(self.f(1)) =}
        }
        """
    )
    assert outcome.code == 0, outcome.err
    assert outcome.out == "(1, 2, 101, 1000000, 'text')\n"
    outcome = run(
        """
        target Python
        main reactor {
          method f(x = {= [] =}) {= x.append(1); return len(x) =}
          reaction(startup) {= print(self.f(), self.f(), self.f([])) =}
        }
        """
    )
    assert outcome.out == "1 2 1\n", "a default is evaluated once, as in Python"


def test_ports_and_actions_have_other_names(run: Run) -> None:
    outcome = run(
        """
        target Python
        reactor Relay {
          input x
          output y
          mutation relay(x as given) -> y as taken {=
            taken.set(given.value + x.value)
            assert y.value == taken.value
          =}
        }
        main reactor {
          relay = new Relay()
          logical action go
          reaction(startup) -> go as later {= later.schedule(0, 21) =}
          reaction(go as now) -> relay.x as entry {= entry.set(now.value) =}
          reaction(relay.y as result) {= print(result.value, relay.y.value) =}
        }
        """
    )
    assert outcome.code == 0, outcome.err
    assert outcome.out == "42 42\n"
