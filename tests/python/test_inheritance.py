"""Reactors that extend others, at run time."""

from __future__ import annotations

from conftest import Run

BASE = """
    target Python
    reactor Base {
      preamble {=
        def greeting(self):
            return f"I am {self.name()}"
      =}
      method name() {= return "Base" =}
      reaction(startup) {= print(self.greeting()) =}
      reaction(shutdown) {=
        missing()
      =}
    }
    """


def test_a_traceback_names_the_file_of_the_superclass(run: Run) -> None:
    outcome = run(
        """
        target Python
        import Base from "Base.lf"
        reactor Derived extends Base {
          method name() {= return "Derived" =}
        }
        main reactor { d = new Derived() }
        """,
        Base_dot_lf=BASE,
    )
    assert outcome.code != 0
    assert outcome.out == "I am Derived\n"
    assert 'Base.lf", line 11' in outcome.err
    assert "missing()" in outcome.err
    assert "NameError" in outcome.err


def test_a_federate_may_be_inherited(launch: Run) -> None:
    outcome = launch(
        """
        target Python { timeout: 0 s }
        reactor Source { output out  reaction(startup) -> out {= out.set(self.bank_index) =} }
        reactor Louder(by = 10) extends Source {
          reaction(startup) -> out {= out.set(out.value + self.by) =}
        }
        reactor Sink { input[2] inp  reaction(inp) {= print([port.value for port in inp]) =} }
        federated reactor {
          sources = new[2] Louder(by = 20)
          sink = new Sink()
          sources.out -> sink.inp
        }
        """
    )
    assert outcome.code == 0, outcome.err
    assert "[20, 21]" in outcome.out
