"""Nodes with a lifecycle, as ``rclpy.lifecycle.node``: callbacks for transitions, and services."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

from hprm.ros._interfaces import interface
from hprm.ros._telling import Telling
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.exceptions import RCLError
from hprm.ros.lifecycle._machine import ERROR_PROCESSING, StateMachine, Transition
from hprm.ros.lifecycle._machine import TransitionCallbackReturnType as TransitionCallbackReturn
from hprm.ros.lifecycle.managed_entity import ManagedEntity
from hprm.ros.lifecycle.publisher import LifecyclePublisher
from hprm.ros.logging import get_logger
from hprm.ros.node import Node
from hprm.ros.qos import QoSProfile

#: Which callback runs in which state.
_CALLBACKS = {
    "configuring": "on_configure",
    "cleaningup": "on_cleanup",
    "shuttingdown": "on_shutdown",
    "activating": "on_activate",
    "deactivating": "on_deactivate",
    "errorprocessing": "on_error",
}
#: The numbers of the transitions that shut down, by the state from which they do.
_SHUTDOWN = {"unconfigured": 5, "inactive": 6, "active": 7}


class LifecycleState(NamedTuple):
    """The state that a callback of a transition is told: the one before."""

    label: str
    state_id: int


class LifecycleNodeMixin(ManagedEntity):
    """What a node with a lifecycle has beyond a node."""

    def __init__(
        self,
        *,
        enable_communication_interface: bool = True,
        callback_group: CallbackGroup | None = None,
    ) -> None:
        """Begin unconfigured; the class must be a ``Node``, too.

        Parameters
        ----------
        enable_communication_interface
            Whether there are services for transitions, and a topic that tells of them.
        callback_group
            The group of these services.

        """
        if not isinstance(self, Node):
            raise RuntimeError("LifecycleNodeMixin is for classes that are a Node, too")
        if not isinstance(enable_communication_interface, bool):
            raise TypeError("enable_communication_interface must be a bool")
        # In the order in which they were added: their callbacks run in it.
        self._managed_entities: dict[ManagedEntity, None] = {}
        self._events: Telling | None = None
        missing = get_logger("rcl_lifecycle")
        self._state_machine = StateMachine(self._publish_transition, missing.warning)
        if not enable_communication_interface:
            return
        topic = self.resolve_topic_name("~/transition_event")
        type_ = "lifecycle_msgs/msg/TransitionEvent"
        self._events = Telling(self, type_, topic, QoSProfile(depth=10))
        for name, srv_type, answer in [
            ("change_state", "ChangeState", self._on_change_state),
            ("get_state", "GetState", self._on_get_state),
            ("get_available_states", "GetAvailableStates", self._on_get_available_states),
            ("get_available_transitions", "GetAvailableTransitions", self._on_get_transitions),
            ("get_transition_graph", "GetAvailableTransitions", self._on_get_graph),
        ]:
            service = interface("lifecycle_msgs.srv", srv_type)
            self.create_service(service, f"~/{name}", answer, callback_group=callback_group)

    # Transitions.

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Configure the node."""
        return self._change_state(1)

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Take back what was configured."""
        return self._change_state(2)

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Activate the node."""
        return self._change_state(3)

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Deactivate the node."""
        return self._change_state(4)

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Shut the node down.

        Raises
        ------
        RCLError
            If it is in a state from which it cannot shut down.

        """
        number = _SHUTDOWN.get(self._state_machine.current_state[1])
        if number is None:
            raise RCLError("Shutdown transtion not possible")
        return self._change_state(number)

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Have an entity follow the lifecycle of this node."""
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._managed_entities[entity] = None

    def create_lifecycle_publisher(
        self,
        msg_type: type[Any],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        publisher_class: None = None,
        **kwargs: Any,
    ) -> LifecyclePublisher[Any]:
        """Make a publisher that follows the lifecycle; the keywords are those of a publisher."""
        if publisher_class:
            raise TypeError(
                "create_publisher() got an unexpected keyword argument 'publisher_class'"
            )
        made = cast(Node, self).create_publisher(
            msg_type, topic, qos_profile, publisher_class=LifecyclePublisher, **kwargs
        )
        assert isinstance(made, LifecyclePublisher)
        self._managed_entities[made] = None
        return made

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher[Any]) -> bool:
        """Destroy a publisher; return whether it was of this node."""
        self._managed_entities.pop(publisher, None)
        return cast(Node, self).destroy_publisher(publisher)

    # Callbacks: unless a class has others, they ask all managed entities.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure all managed entities, up to the first one that does not succeed."""
        return self._ask_entities("on_configure", state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up all managed entities, up to the first one that does not succeed."""
        return self._ask_entities("on_cleanup", state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shut down all managed entities, up to the first one that does not succeed."""
        return self._ask_entities("on_shutdown", state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate all managed entities, up to the first one that does not succeed."""
        return self._ask_entities("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate all managed entities, up to the first one that does not succeed."""
        return self._ask_entities("on_deactivate", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Have all managed entities recover, up to the first one that does not succeed."""
        return self._ask_entities("on_error", state)

    def _ask_entities(self, name: str, state: LifecycleState) -> TransitionCallbackReturn:
        for entity in list(self._managed_entities):
            answer = getattr(entity, name)(state)
            if not isinstance(answer, TransitionCallbackReturn):
                raise TypeError(
                    f"{name}() return value of class {type(entity)} should be"
                    " `TransitionCallbackReturn`.\n"
                    f"Instance of the class that caused the failure: {entity}"
                )
            if answer is not TransitionCallbackReturn.SUCCESS:
                return answer
        return TransitionCallbackReturn.SUCCESS

    def _change_state(self, transition_id: int) -> TransitionCallbackReturn:
        """Begin a transition, run its callback, and go on as that says."""
        machine, logger = self._state_machine, cast(Node, self).get_logger()
        number, label = machine.current_state
        before = LifecycleState(label, number)
        try:
            machine.trigger_transition_by_id(transition_id)
        except RCLError:
            logger.error(
                f"Unable to start transition {transition_id} from current state"
                f" {machine.current_state}"
            )
            return TransitionCallbackReturn.ERROR
        answer = self._call_back(before)
        machine.trigger_transition_by_label(answer.to_label())
        if machine.current_state == ERROR_PROCESSING:
            machine.trigger_transition_by_label(self._call_back(before).to_label())
        return answer

    def _call_back(self, before: LifecycleState) -> TransitionCallbackReturn:
        """Run the callback of the state, whose exception is an error."""
        name = _CALLBACKS[self._state_machine.current_state[1]]
        try:
            answer = getattr(self, name)(before)
        except Exception as error:
            # rclpy tells nothing of it, so its cause would be hard to find.
            logger = cast(Node, self).get_logger()
            logger.error(f"{name}() has failed: {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        if isinstance(answer, TransitionCallbackReturn):
            return answer
        raise TypeError(f"{name}() must return a TransitionCallbackReturn, not {answer!r}")

    def _publish_transition(self, transition: Transition) -> None:
        if self._events is not None:
            self._events.tell(lambda: _event_of(transition))

    # Services.

    def _on_change_state(self, request: Any, response: Any) -> Any:
        number = request.transition.id
        if request.transition.label:
            try:
                number = self._state_machine.get_transition_by_label(request.transition.label)
            except RCLError:
                return response
        response.success = self._change_state(number) is TransitionCallbackReturn.SUCCESS
        return response

    def _on_get_state(self, _request: Any, response: Any) -> Any:
        response.current_state.id, response.current_state.label = self._state_machine.current_state
        return response

    def _on_get_available_states(self, _request: Any, response: Any) -> Any:
        made = interface("lifecycle_msgs.msg", "State")
        response.available_states = [
            made(id=it.id, label=it.label) for it in self._state_machine.available_states
        ]
        return response

    def _on_get_transitions(self, _request: Any, response: Any) -> Any:
        response.available_transitions = _described(self._state_machine.available_transitions)
        return response

    def _on_get_graph(self, _request: Any, response: Any) -> Any:
        response.available_transitions = _described(self._state_machine.transition_graph)
        return response


def _event_of(transition: Transition) -> Any:
    event = interface("lifecycle_msgs.msg", "TransitionEvent")()
    # As in ROS 2: the rest is left as it is.
    _fill(event.start_state, transition.start)
    _fill(event.goal_state, transition.goal)
    return event


def _described(transitions: list[Transition]) -> list[Any]:
    described = []
    for it in transitions:
        made = interface("lifecycle_msgs.msg", "TransitionDescription")()
        _fill(made.transition, it)
        _fill(made.start_state, it.start)
        _fill(made.goal_state, it.goal)
        described.append(made)
    return described


def _fill(message: Any, stated: Any) -> None:
    message.id, message.label = stated.id, stated.label


class LifecycleNode(LifecycleNodeMixin, Node):
    """A node with a lifecycle."""

    def __init__(
        self, node_name: str, *, enable_communication_interface: bool = True, **kwargs: Any
    ) -> None:
        """Make a node that is unconfigured; the keywords are those of ``Node``."""
        Node.__init__(self, node_name, **kwargs)
        LifecycleNodeMixin.__init__(
            self, enable_communication_interface=enable_communication_interface
        )
