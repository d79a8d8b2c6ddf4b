"""Services for the levels of loggers, as ``rclpy.logging_service``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hprm.ros._interfaces import interface
from hprm.ros._sleeping_service import SleepingService
from hprm.ros.logging import get_logger_level, set_logger_level
from hprm.ros.qos import qos_profile_services_default

if TYPE_CHECKING:
    from hprm.ros.node import Node


class LoggingService:
    """The services by which other nodes read and set the levels of loggers of a process."""

    def __init__(self, node: Node) -> None:
        """Declare the services of a node."""
        self._services = [
            SleepingService(node, kind, name, answer, qos_profile_services_default)
            for kind, name, answer in [
                ("GetLoggerLevels", "get_logger_levels", self._get),
                ("SetLoggerLevels", "set_logger_levels", self._set),
            ]
        ]

    def destroy(self) -> None:
        """Take no more requests."""
        for service in self._services:
            service.destroy()

    def _get(self, request: Any, response: Any) -> Any:
        made = interface("rcl_interfaces.msg", "LoggerLevel")
        response.levels = [
            made(name=name, level=get_logger_level(name).value) for name in request.names
        ]
        return response

    def _set(self, request: Any, response: Any) -> Any:
        made = interface("rcl_interfaces.msg", "SetLoggerLevelsResult")
        for it in request.levels:
            try:
                set_logger_level(it.name, it.level)
            except ValueError:
                reason = "Failed reason: Invalid logger level."
                response.results.append(made(successful=False, reason=reason))
            else:
                response.results.append(made(successful=True))
        return response
