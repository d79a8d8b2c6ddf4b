"""What follows the lifecycle of a node, as ``rclpy.lifecycle.managed_entity``."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, overload

from hprm.ros.lifecycle._machine import TransitionCallbackReturnType as TransitionCallbackReturn

if TYPE_CHECKING:
    from hprm.ros.lifecycle.node import LifecycleState

Method = TypeVar("Method", bound=Callable[..., Any])


class ManagedEntity:
    """Something whose callbacks a node with a lifecycle calls; each allows the transition."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; ``state`` is the one before."""
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take back what was configured."""
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shut down."""
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate."""
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate."""
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Recover from an error of another callback."""
        return TransitionCallbackReturn.SUCCESS


class SimpleManagedEntity(ManagedEntity):
    """An entity that knows whether it is activated."""

    def __init__(self) -> None:
        """Begin deactivated."""
        self._enabled = False

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Be activated from now on."""
        self._enabled = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Be deactivated from now on."""
        self._enabled = False
        return TransitionCallbackReturn.SUCCESS

    @property
    def is_activated(self) -> bool:
        """Whether it is activated."""
        return self._enabled

    @overload
    @staticmethod
    def when_enabled(
        wrapped: None = None, *, when_not_enabled: Callable[..., Any] | None = None
    ) -> Callable[[Method], Method]: ...

    @overload
    @staticmethod
    def when_enabled(
        wrapped: Method, *, when_not_enabled: Callable[..., Any] | None = None
    ) -> Method: ...

    @staticmethod
    def when_enabled(
        wrapped: Any = None, *, when_not_enabled: Callable[..., Any] | None = None
    ) -> Any:
        """Decorate a method that does something only while the entity is activated.

        Otherwise it calls ``when_not_enabled``, if that is given. The method returns nothing.
        """

        def decorate(method: Callable[..., Any]) -> Callable[..., None]:
            @wraps(method)
            def guarded(self: SimpleManagedEntity, *args: Any, **kwargs: Any) -> None:
                if self._enabled:
                    method(self, *args, **kwargs)
                elif when_not_enabled is not None:
                    when_not_enabled()

            return guarded

        return decorate if wrapped is None else decorate(wrapped)
