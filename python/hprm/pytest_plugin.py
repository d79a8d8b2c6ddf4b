"""For pytest: the fixture ``run_reactor``, and the logical trace of what a failed test has run."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import pytest

_RUNS = pytest.StashKey[list[tuple[str, list[str]]]]()


@pytest.fixture
def run_reactor(request: pytest.FixtureRequest) -> Callable[..., Any]:
    """Run a reactor in virtual time, as ``hprm.testing.run`` does: a fixture of pytest.

    If the test fails, its report has the logical traces of the runs. Nothing needs to be imported
    or configured: pytest finds the fixture when the package is installed.

    Returns
    -------
    callable
        A function with the parameters and the result of ``hprm.testing.run``.

    """
    from hprm import testing

    runs = request.node.stash.setdefault(_RUNS, [])

    def run(reactor: Any, **options: Any) -> testing.Result:
        __tracebackhide__ = True
        result = testing.run(reactor, **options)
        cls = reactor if isinstance(reactor, type) else type(reactor)
        runs.append((cls.__name__, result.trace))
        return result

    return run


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, None]:
    """Add the logical traces to the report of a failed test."""
    outcome = yield
    report = outcome.get_result()
    if report.when == "call" and report.failed:
        for name, trace in item.stash.get(_RUNS, []):
            report.sections.append((f"logical trace of {name}", "\n".join(trace)))
