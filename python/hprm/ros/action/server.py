"""Servers of actions, as ``rclpy.action.server``."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any

from hprm.ros._interface import type_name
from hprm.ros._interfaces import interface
from hprm.ros.action._names import (
    ABORTED,
    ACCEPTED,
    ACTIVE,
    CANCELED,
    CANCELING,
    EXECUTING,
    SUCCEEDED,
    UNKNOWN,
    awaited,
    hidden,
)
from hprm.ros.callback_groups import CallbackGroup
from hprm.ros.exceptions import RCLError
from hprm.ros.qos import qos_profile_action_status_default
from hprm.ros.task import Future

if TYPE_CHECKING:
    from hprm.ros.node import Node

#: From which statuses a goal may get to another one.
_BEFORE = {
    EXECUTING: (ACCEPTED,),
    CANCELING: (ACCEPTED, EXECUTING),
    SUCCEEDED: (EXECUTING, CANCELING),
    ABORTED: (EXECUTING, CANCELING),
    CANCELED: (CANCELING,),
}


class GoalResponse(Enum):
    """Whether a goal is accepted."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """Whether a goal is to be cancelled."""

    REJECT = 1
    ACCEPT = 2


class ServerGoalHandle:
    """A goal at its server."""

    def __init__(self, action_server: ActionServer, goal_info: Any, goal_request: Any) -> None:
        """Take a goal that was accepted."""
        self._server = action_server
        self._goal_info = goal_info
        self._goal_request = goal_request
        self._status = ACCEPTED

    @property
    def request(self) -> Any:
        """The goal."""
        return self._goal_request

    @property
    def goal_id(self) -> Any:
        """Its number."""
        return self._goal_info.goal_id

    @property
    def is_active(self) -> bool:
        """Whether it is not over."""
        return self._status in ACTIVE

    @property
    def is_cancel_requested(self) -> bool:
        """Whether it is to be cancelled."""
        return self._status == CANCELING

    @property
    def status(self) -> int:
        """Its status, as ``action_msgs.msg.GoalStatus`` has them."""
        return self._status

    def execute(self, execute_callback: Callable[..., Any] | None = None) -> None:
        """Begin to execute it, soon."""
        if self._status == ACCEPTED:
            self._become(EXECUTING)
        self._server._begin(self, execute_callback)

    def publish_feedback(self, feedback: Any) -> None:
        """Tell the client how it goes."""
        if not isinstance(feedback, self._server.action_type.Feedback):
            raise TypeError(f"Expected {self._server.action_type.Feedback}, got {type(feedback)}")
        self._server._publish_feedback(self.goal_id, feedback)

    def succeed(self) -> None:
        """State that it has succeeded."""
        self._become(SUCCEEDED)

    def abort(self) -> None:
        """State that it has failed."""
        self._become(ABORTED)

    def canceled(self) -> None:
        """State that it was cancelled."""
        self._become(CANCELED)

    def destroy(self) -> None:
        """Forget it."""
        self._server._goals.pop(_key(self.goal_id), None)

    def _become(self, status: int) -> None:
        if self._status not in _BEFORE[status]:
            raise RCLError(
                f"Failed to update goal state: goal_handle attempted invalid transition from state"
                f" {_NAMES[self._status]} with event {_EVENTS[status]}"
            )
        self._status = status
        self._server._publish_status()


_EVENTS = {
    EXECUTING: "EXECUTE",
    CANCELING: "CANCEL_GOAL",
    SUCCEEDED: "SUCCEED",
    ABORTED: "ABORT",
    CANCELED: "CANCELED",
}


_NAMES = (
    "UNKNOWN",
    "ACCEPTED",
    "EXECUTING",
    "CANCELING",
    "SUCCEEDED",
    "CANCELED",
    "ABORTED",
)


def _key(goal_id: Any) -> bytes:
    return bytes(goal_id.uuid)


def default_handle_accepted_callback(goal_handle: ServerGoalHandle) -> None:
    """Execute a goal that was accepted."""
    goal_handle.execute()


def default_goal_callback(goal_request: Any) -> GoalResponse:
    """Accept a goal."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: Any) -> CancelResponse:
    """Cancel no goal."""
    return CancelResponse.REJECT


class ActionServer:
    """Executes goals."""

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[[ServerGoalHandle], Any],
        *,
        callback_group: CallbackGroup | None = None,
        goal_callback: Callable[[Any], Any] = default_goal_callback,
        handle_accepted_callback: Callable[
            [ServerGoalHandle], Any
        ] = default_handle_accepted_callback,
        cancel_callback: Callable[[Any], Any] = default_cancel_callback,
        goal_service_qos_profile: Any = None,
        result_service_qos_profile: Any = None,
        cancel_service_qos_profile: Any = None,
        feedback_pub_qos_profile: Any = None,
        status_pub_qos_profile: Any = None,
        result_timeout: int = 900,
    ) -> None:
        """Make the server of an action; the keywords are those of rclpy."""
        type_name(action_type, "action")
        self._node = node
        self.action_type = action_type
        self.register_execute_callback(execute_callback)
        self.register_goal_callback(goal_callback)
        self.register_handle_accepted_callback(handle_accepted_callback)
        self.register_cancel_callback(cancel_callback)
        self._timeout_s = result_timeout
        self._goals: dict[bytes, ServerGoalHandle] = {}
        self._results: dict[bytes, Future[Any]] = {}
        impl = action_type.Impl
        group = callback_group or node.default_callback_group
        self._services = [
            node.create_service(type_, hidden(action_name, part), answer, callback_group=group)
            for part, type_, answer in [
                ("send_goal", impl.SendGoalService, self._take_goal),
                ("cancel_goal", impl.CancelGoalService, self._take_cancel),
                ("get_result", impl.GetResultService, self._give_result),
            ]
        ]
        self._feedback = node.create_publisher(
            impl.FeedbackMessage, hidden(action_name, "feedback"), feedback_pub_qos_profile or 10
        )
        self._status = node.create_publisher(
            impl.GoalStatusMessage,
            hidden(action_name, "status"),
            status_pub_qos_profile or qos_profile_action_status_default,
        )

    def register_execute_callback(self, execute_callback: Callable[..., Any]) -> None:
        """Call this to execute a goal."""
        if not callable(execute_callback):
            raise TypeError("Failed to register goal execution callback: not callable")
        self._execute_callback = execute_callback

    def register_goal_callback(self, goal_callback: Callable[..., Any] | None) -> None:
        """Call this to accept or reject a goal."""
        self._goal_callback = goal_callback or default_goal_callback

    def register_handle_accepted_callback(
        self, handle_accepted_callback: Callable[..., Any] | None
    ) -> None:
        """Call this with a goal that was accepted."""
        self._handle_accepted_callback = (
            handle_accepted_callback or default_handle_accepted_callback
        )

    def register_cancel_callback(self, cancel_callback: Callable[..., Any] | None) -> None:
        """Call this to decide whether a goal is to be cancelled."""
        self._cancel_callback = cancel_callback or default_cancel_callback

    def destroy(self) -> None:
        """Take no more goals."""
        for service in self._services:
            self._node.destroy_service(service)
        self._node.destroy_publisher(self._feedback)
        self._node.destroy_publisher(self._status)
        self._goals.clear()

    # Requests.

    async def _take_goal(self, request: Any, response: Any) -> Any:
        key = _key(request.goal_id)
        if key in self._goals:
            self._node.get_logger().error("Goal ID already exists")
            return response
        answer = await awaited(self._goal_callback(request.goal))
        if not isinstance(answer, GoalResponse):
            self._node.get_logger().warning(
                f"Goal request callback did not return a GoalResponse type. Got {type(answer)}"
            )
        if answer is not GoalResponse.ACCEPT:
            return response
        stamp = self._node.get_clock().now().to_msg()
        info = interface("action_msgs.msg", "GoalInfo")(goal_id=request.goal_id, stamp=stamp)
        handle = self._goals[key] = ServerGoalHandle(self, info, request.goal)
        self._results[key] = Future()
        self._publish_status()
        response.accepted, response.stamp = True, stamp
        # The client knows that before anything else happens.
        self._task(self._handle_accepted_callback, handle)
        return response

    async def _take_cancel(self, request: Any, response: Any) -> Any:
        asked = self._asked(request.goal_info)
        if not asked and any(request.goal_info.goal_id.uuid):
            # The goal is not known; 2 is ERROR_UNKNOWN_GOAL_ID.
            response.return_code = 2
            return response
        for handle in asked:
            if not handle.is_active or handle.is_cancel_requested:
                continue
            if await awaited(self._cancel_callback(handle)) is CancelResponse.ACCEPT:
                handle._become(CANCELING)
                response.goals_canceling = [*response.goals_canceling, handle._goal_info]
        if not response.goals_canceling:
            # 3 is ERROR_GOAL_TERMINATED, 1 is ERROR_REJECTED.
            response.return_code = 3 if asked and not any(it.is_active for it in asked) else 1
        return response

    def _asked(self, info: Any) -> list[ServerGoalHandle]:
        """The goals that a request to cancel is about: by number, by time, or all."""
        handle = self._goals.get(_key(info.goal_id))
        found = [] if handle is None else [handle]
        until = (info.stamp.sec, info.stamp.nanosec)
        all_of_them = not any(info.goal_id.uuid) and until == (0, 0)
        for it in self._goals.values():
            stamp = it._goal_info.stamp
            is_before = until != (0, 0) and (stamp.sec, stamp.nanosec) <= until
            if it not in found and (all_of_them or is_before):
                found.append(it)
        return found

    def _give_result(self, request: Any, response: Any) -> Any:
        future = self._results.get(_key(request.goal_id))
        if future is None:
            response.status = UNKNOWN
            return response
        return future

    # Execution.

    def _begin(self, handle: ServerGoalHandle, callback: Callable[..., Any] | None) -> None:
        self._task(self._execute, handle, callback or self._execute_callback)

    async def _execute(self, handle: ServerGoalHandle, callback: Callable[..., Any]) -> None:
        logger = self._node.get_logger()
        try:
            result = await awaited(callback(handle))
        except Exception as error:
            logger.error(f"Error raised in execute callback: {error}")
            traceback.print_exc()
            result = self.action_type.Result()
            if handle.is_active:
                handle.abort()
        if handle.is_active:
            number = _key(handle.goal_id).hex()
            logger.warning(f"Goal state not set, assuming aborted. Goal ID: {number}")
            handle.abort()
        response = self.action_type.Impl.GetResultService.Response()
        response.status = handle.status
        response.result = result
        key = _key(handle.goal_id)
        if key in self._results:
            self._results[key].set_result(response)
            self._node._runtime.call_at(round(self._timeout_s * 1e9), lambda: self._forget(key))

    def _forget(self, key: bytes) -> None:
        self._goals.pop(key, None)
        self._results.pop(key, None)

    def _task(self, function: Callable[..., Any], *arguments: Any) -> None:
        executor = self._node.executor
        assert executor is not None, "a callback runs in an executor"
        executor.create_task(function, *arguments)

    def _publish_feedback(self, goal_id: Any, feedback: Any) -> None:
        message = self.action_type.Impl.FeedbackMessage
        self._feedback.publish(message(goal_id=goal_id, feedback=feedback))

    def _publish_status(self) -> None:
        status = interface("action_msgs.msg", "GoalStatus")
        listed = [status(goal_info=it._goal_info, status=it.status) for it in self._goals.values()]
        self._status.publish(self.action_type.Impl.GoalStatusMessage(status_list=listed))
