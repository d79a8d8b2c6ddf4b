"""Clients of actions, as ``rclpy.action.client``."""

from __future__ import annotations

import itertools
import uuid
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hprm.ros._interface import type_name
from hprm.ros._interfaces import interface
from hprm.ros.action._names import UNKNOWN, hidden
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.task import Future

if TYPE_CHECKING:
    from hprm.ros.node import Node

_numbers = itertools.count(1)


class ClientGoalHandle:
    """A goal at its client."""

    def __init__(self, action_client: ActionClient, goal_id: Any, goal_response: Any) -> None:
        """Take what the server has answered."""
        self._client = action_client
        self._goal_id = goal_id
        self._goal_response = goal_response
        self._status = UNKNOWN

    @property
    def goal_id(self) -> Any:
        """Its number."""
        return self._goal_id

    @property
    def stamp(self) -> Any:
        """When it was accepted."""
        return self._goal_response.stamp

    @property
    def accepted(self) -> bool:
        """Whether it was accepted."""
        accepted: bool = self._goal_response.accepted
        return accepted

    @property
    def status(self) -> int:
        """The status that the server has told last."""
        return self._status

    def cancel_goal_async(self) -> Future[Any]:
        """Ask the server to cancel it; return the future of its answer."""
        return self._client._cancel(self)

    def cancel_goal(self) -> Any:
        """Ask the server to cancel it, and wait for its answer while another thread spins."""
        return self._client._wait(self.cancel_goal_async())

    def get_result_async(self) -> Future[Any]:
        """Return the future of its result."""
        return self._client._get_result(self)

    def get_result(self) -> Any:
        """Wait for its result while another thread spins."""
        return self._client._wait(self.get_result_async())

    def __repr__(self) -> str:
        """Return number, answer and status."""
        number = bytes(self.goal_id.uuid).hex()
        return f"ClientGoalHandle <id={number}, accepted={self.accepted}, status={self.status}>"


class ActionClient:
    """Sends goals to an action."""

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        *,
        callback_group: CallbackGroup | None = None,
        goal_service_qos_profile: Any = None,
        result_service_qos_profile: Any = None,
        cancel_service_qos_profile: Any = None,
        feedback_sub_qos_profile: Any = None,
        status_sub_qos_profile: Any = None,
    ) -> None:
        """Make the client of an action; the keywords are those of rclpy."""
        type_name(action_type, "action")
        self._node = node
        self._action_type = action_type
        self._action_name = action_name
        self._number = next(_numbers)
        self._count = itertools.count(1)
        self._goals: dict[bytes, ClientGoalHandle] = {}
        self._feedback_callbacks: dict[bytes, Callable[[Any], Any]] = {}
        impl = action_type.Impl
        group = callback_group or node.default_callback_group
        self._send_goal, self._cancel_goal, self._result = (
            node.create_client(type_, hidden(action_name, part), callback_group=group)
            for part, type_ in [
                ("send_goal", impl.SendGoalService),
                ("cancel_goal", impl.CancelGoalService),
                ("get_result", impl.GetResultService),
            ]
        )
        self._subscriptions = [
            node.create_subscription(
                type_, hidden(action_name, part), take, qos or 10, callback_group=group
            )
            for part, type_, take, qos in [
                ("feedback", impl.FeedbackMessage, self._take_feedback, feedback_sub_qos_profile),
                ("status", impl.GoalStatusMessage, self._take_status, status_sub_qos_profile),
            ]
        ]

        # Whether a goal is accepted is told before its feedback, if both come at one tag.
        self._subscriptions[0]._after = self._send_goal

    def send_goal_async(
        self,
        goal: Any,
        feedback_callback: Callable[[Any], Any] | None = None,
        goal_uuid: Any = None,
    ) -> Future[ClientGoalHandle]:
        """Send a goal; return the future of its handle, which says whether it was accepted.

        Raises
        ------
        TypeError
            If it is no goal of this action.

        """
        if not isinstance(goal, self._action_type.Goal):
            raise TypeError(f"Expected {self._action_type.Goal}, got {type(goal)}")
        goal_id = self._new_id() if goal_uuid is None else goal_uuid
        request = self._action_type.Impl.SendGoalService.Request(goal_id=goal_id, goal=goal)
        if feedback_callback is not None:
            self._feedback_callbacks[bytes(goal_id.uuid)] = feedback_callback
        sent: Future[ClientGoalHandle] = Future(executor=self._node.executor)

        def answered(answer: Future[Any]) -> None:
            handle = ClientGoalHandle(self, goal_id, answer.result())
            if handle.accepted:
                self._goals[bytes(goal_id.uuid)] = handle
            else:
                self._feedback_callbacks.pop(bytes(goal_id.uuid), None)
            # The node may have another executor than when it has sent the goal.
            sent._set_executor(self._node.executor)
            sent.set_result(handle)

        self._send_goal.call_async(request).add_done_callback(answered)
        return sent

    def send_goal(self, goal: Any, **keywords: Any) -> Any:
        """Send a goal, and wait for its result while another thread spins."""
        handle = self._wait(self.send_goal_async(goal, **keywords))
        return handle.get_result() if handle.accepted else None

    def server_is_ready(self) -> bool:
        """Return whether a node serves the action."""
        return self._send_goal.service_is_ready()

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Wait until a node serves the action, or for so long; return whether one does."""
        return self._send_goal.wait_for_service(timeout_sec)

    def destroy(self) -> None:
        """Take no more answers."""
        for client in (self._send_goal, self._cancel_goal, self._result):
            self._node.destroy_client(client)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _new_id(self) -> Any:
        # Not random: the same on every run.
        name = f"{self._node.get_fully_qualified_name()} {self._action_name}"
        made = uuid.uuid5(uuid.NAMESPACE_OID, f"{name} {self._number} {next(self._count)}")
        return interface("unique_identifier_msgs.msg", "UUID")(uuid=list(made.bytes))

    def _cancel(self, handle: ClientGoalHandle) -> Future[Any]:
        request = self._action_type.Impl.CancelGoalService.Request()
        request.goal_info.goal_id = handle.goal_id
        return self._cancel_goal.call_async(request)

    def _get_result(self, handle: ClientGoalHandle) -> Future[Any]:
        request = self._action_type.Impl.GetResultService.Request(goal_id=handle.goal_id)
        future = self._result.call_async(request)

        def answered(answer: Future[Any]) -> None:
            result: Any = answer.result()
            handle._status = result.status
            self._feedback_callbacks.pop(bytes(handle.goal_id.uuid), None)

        future.add_done_callback(answered)
        return future

    def _wait(self, future: Future[Any]) -> Any:
        if self._node._is_spun_by_this_thread():
            raise RuntimeError(
                f"this would wait forever for the action {self._action_name}: the answer is taken"
                " by the thread that spins, which is this one\n"
                "  hint: use the functions that return futures, or a MultiThreadedExecutor"
            )
        self._node._runtime.block(lambda: future.done() or not self._node.context.ok())
        return future.result()

    def _take_feedback(self, message: Any) -> Any:
        callback = self._feedback_callbacks.get(bytes(message.goal_id.uuid))
        return None if callback is None else callback(message)

    def _take_status(self, message: Any) -> None:
        for it in message.status_list:
            handle = self._goals.get(bytes(it.goal_info.goal_id.uuid))
            if handle is not None:
                handle._status = it.status
