"""The states of a lifecycle, and the transitions between them: plain data, and where a node is.

A *primary* state lasts until a transition is asked for. That leads to a state of its own, in which
a callback runs; what the callback returns labels the transition that follows. The numbers are those
of ``lifecycle_msgs``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from enum import Enum
from typing import NamedTuple

from hprm.ros.exceptions import RCLError


class TransitionCallbackReturnType(Enum):
    """What a callback of a transition returns."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99

    def to_label(self) -> str:
        """Return the label of the transition that follows."""
        return f"transition_{self.name.lower()}"

    def __int__(self) -> int:
        """Return the number in ``lifecycle_msgs.msg.Transition``."""
        return self.value


class MachineState(NamedTuple):
    """A state."""

    id: int
    label: str


class Transition(NamedTuple):
    """A transition from a state to another one."""

    id: int
    label: str
    start: MachineState
    goal: MachineState


_STATES = {
    it.label: it
    for it in (
        MachineState(0, "unknown"),
        MachineState(1, "unconfigured"),
        MachineState(2, "inactive"),
        MachineState(3, "active"),
        MachineState(4, "finalized"),
        MachineState(10, "configuring"),
        MachineState(11, "cleaningup"),
        MachineState(12, "shuttingdown"),
        MachineState(13, "activating"),
        MachineState(14, "deactivating"),
        MachineState(15, "errorprocessing"),
    )
}
ERROR_PROCESSING = _STATES["errorprocessing"]

#: What is asked for: its number and label, the state from which, and the one in which the callback
#: runs.
_ASKED = (
    (1, "configure", "unconfigured", "configuring"),
    (2, "cleanup", "inactive", "cleaningup"),
    (3, "activate", "inactive", "activating"),
    (4, "deactivate", "active", "deactivating"),
    (5, "shutdown", "unconfigured", "shuttingdown"),
    (6, "shutdown", "inactive", "shuttingdown"),
    (7, "shutdown", "active", "shuttingdown"),
)

#: The number of the transition from a callback's state if it succeeds, which those for failures
#: and errors follow, and where these three lead.
_ANSWERED = {
    "configuring": (10, "inactive", "unconfigured", "errorprocessing"),
    "cleaningup": (20, "unconfigured", "inactive", "errorprocessing"),
    "activating": (30, "active", "inactive", "errorprocessing"),
    "deactivating": (40, "inactive", "active", "errorprocessing"),
    "shuttingdown": (50, "finalized", "finalized", "errorprocessing"),
    "errorprocessing": (60, "unconfigured", "finalized", "finalized"),
}


def _answers(state: str) -> Iterator[Transition]:
    first, *goals = _ANSWERED[state]
    for number, (answer, goal) in enumerate(zip(TransitionCallbackReturnType, goals, strict=True)):
        yield Transition(first + number, answer.to_label(), _STATES[state], _STATES[goal])


def _graph() -> Iterator[Transition]:
    """All transitions, in the order in which the services of ROS 2 list them."""
    for number, (id_, label, start, during) in enumerate(_ASKED):
        yield Transition(id_, label, _STATES[start], _STATES[during])
        # The three that shut down share the state of their callback.
        if number + 1 == len(_ASKED) or _ASKED[number + 1][3] != during:
            yield from _answers(during)
    yield from _answers("errorprocessing")


_TRANSITIONS = tuple(_graph())


class StateMachine:
    """Where a node is in its lifecycle.

    Parameters
    ----------
    on_transition
        Is called with each transition that has begun.
    on_missing
        Is told of transitions that there are not.

    """

    def __init__(
        self, on_transition: Callable[[Transition], None], on_missing: Callable[[str], object]
    ) -> None:
        """Begin unconfigured."""
        self._state = _STATES["unconfigured"]
        self._on_transition = on_transition
        self._on_missing = on_missing

    @property
    def current_state(self) -> tuple[int, str]:
        """Number and label of the state."""
        return (self._state.id, self._state.label)

    @property
    def available_states(self) -> list[MachineState]:
        """All states."""
        return list(_STATES.values())

    @property
    def available_transitions(self) -> list[Transition]:
        """The transitions from the state."""
        return [it for it in _TRANSITIONS if it.start == self._state]

    @property
    def transition_graph(self) -> list[Transition]:
        """All transitions."""
        return list(_TRANSITIONS)

    def get_transition_by_label(self, label: str) -> int:
        """Return the number of the transition from the state that has a label."""
        for it in self.available_transitions:
            if it.label == label:
                return it.id
        self._on_missing(f"No transition matching {label} found for current state {self._label}")
        raise RCLError("Failed to get transition from label")

    def trigger_transition_by_id(self, transition_id: int) -> None:
        """Begin the transition with a number."""
        for it in self.available_transitions:
            if it.id == transition_id:
                self._begin(it)
                return
        self._on_missing(
            f"No transition matching {transition_id} found for current state {self._label}"
        )
        raise RCLError("Failed to trigger lifecycle state machine transition")

    def trigger_transition_by_label(self, label: str) -> None:
        """Begin the transition with a label."""
        self.trigger_transition_by_id(self.get_transition_by_label(label))

    @property
    def _label(self) -> str:
        return self._state.label

    def _begin(self, transition: Transition) -> None:
        self._state = transition.goal
        self._on_transition(transition)
