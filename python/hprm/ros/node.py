"""Nodes, as ``rclpy.node``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

from hprm.ros import _process
from hprm.ros._entity import Entity
from hprm.ros._graph import Endpoint
from hprm.ros._interface import type_name
from hprm.ros._keeping import LateTaker
from hprm.ros._liveliness import Assertions
from hprm.ros._names import absolute_namespace, full_node_name, logger_name
from hprm.ros._offers import described, matched
from hprm.ros._others import Others
from hprm.ros._parameter_services import ParameterEvents, ParameterServices
from hprm.ros._parameters import ParameterChanges, Parameters
from hprm.ros._remapping import Remapping
from hprm.ros._ros_arguments import parse_ros_arguments
from hprm.ros._rosout import rosout
from hprm.ros.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from hprm.ros.client import Client
from hprm.ros.clock import Clock, ROSClock
from hprm.ros.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from hprm.ros.exceptions import InvalidHandle, NotInitializedException
from hprm.ros.exceptions import NodeNameNonExistentError as NodeNameNonExistentError
from hprm.ros.guard_condition import GuardCondition
from hprm.ros.logging import get_logger
from hprm.ros.logging_service import LoggingService
from hprm.ros.publisher import Publisher
from hprm.ros.qos import (
    DurabilityPolicy,
    QoSHistoryPolicy,
    QoSProfile,
    qos_profile_services_default,
)
from hprm.ros.qos_overriding_options import _declare_qos_parameters
from hprm.ros.service import Service
from hprm.ros.subscription import Subscription
from hprm.ros.time_source import TimeSource
from hprm.ros.timer import Rate, Timer
from hprm.ros.utilities import get_default_context
from hprm.ros.validate_namespace import validate_namespace
from hprm.ros.validate_node_name import validate_node_name

if TYPE_CHECKING:
    from hprm.ros.context import Context
    from hprm.ros.executors import Executor

E = TypeVar("E", bound=Entity)

#: With what the names of nodes begin that tools do not show.
HIDDEN_NODE_PREFIX = "_"


class Node(Parameters, Others):
    """A node: publishers, subscriptions, timers, services, clients and parameters."""

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        start_parameter_services: bool = True,
        parameter_overrides: list[Any] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        """Make a node; the keywords are those of rclpy."""
        self._context = get_default_context() if context is None else context
        if not self._context.ok():
            raise NotInitializedException("cannot create node")
        self._runtime = _process.runtime()
        own = parse_ros_arguments(cli_args or [])
        arguments = [own, self._context.arguments] if use_global_arguments else [own]
        validate_node_name(node_name)
        validate_namespace(absolute_namespace(namespace or ""))
        self._remapping = Remapping(*(it.rules for it in arguments))
        self._name = self._remapping.node_name(node_name)
        self._namespace = self._remapping.namespace(self._name, absolute_namespace(namespace or ""))
        self._publishers: list[Publisher[Any]] = []
        #: Timers first, and then as `rclpy` takes them; another tuple when there are others.
        self._entities: tuple[Entity, ...] = ()
        #: What each publisher, subscription, service and client has declared.
        self._endpoints: dict[Any, Endpoint] = {}
        self._rates: list[Rate] = []
        self._clock = ROSClock()
        self._default_callback_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._executor: Executor | None = None
        self._is_destroyed = False
        self._logger = get_logger(logger_name(self._name, self._namespace))
        overrides: dict[str, Any] = {}
        for some in reversed(arguments):
            overrides |= some.overrides.of(self.get_fully_qualified_name())
        overrides |= {it.name: it.value for it in parameter_overrides or []}
        self._runtime.declare_node(self.get_fully_qualified_name())
        if enable_rosout and self._context.arguments.log_to_rosout:
            rosout.add(self)
        self._parameter_events = ParameterEvents(self)
        self._begin_parameters(overrides, allow_undeclared_parameters)
        if automatically_declare_parameters_from_overrides:
            self.declare_parameters("", list(overrides.items()))
        self._time_source = TimeSource(node=self)
        self._time_source.attach_clock(self._clock)
        self._own_services: list[ParameterServices | LoggingService] = []
        if start_parameter_services:
            self._own_services.append(ParameterServices(self))
        if enable_logger_service:
            self._own_services.append(LoggingService(self))

    # What it is.

    @property
    def context(self) -> Context:
        """The context with which it ends."""
        return self._context

    @property
    def handle(self) -> Node:
        """The node itself, which has no native half."""
        return self

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The group of entities that are made without one."""
        return self._default_callback_group

    @property
    def executor(self) -> Executor | None:
        """The executor that runs its callbacks."""
        return self._executor

    @executor.setter
    def executor(self, new: Executor | None) -> None:
        current = self._executor
        if current is new:
            return
        if current is not None:
            current.remove_node(self)
        self._executor = new
        if new is not None and self not in new.get_nodes():
            new.add_node(self)

    def get_name(self) -> str:
        """Return its name."""
        return self._name

    def get_namespace(self) -> str:
        """Return its namespace."""
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        """Return its name with the namespace before it."""
        return full_node_name(self._name, self._namespace)

    def get_clock(self) -> Clock:
        """Return its clock."""
        return self._clock

    def get_logger(self) -> Any:
        """Return its logger."""
        return self._logger

    @property
    def publishers(self) -> Iterator[Publisher[Any]]:
        """Its publishers."""
        yield from self._publishers

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Its subscriptions."""
        yield from (it for it in self._entities if isinstance(it, Subscription))

    @property
    def clients(self) -> Iterator[Client]:
        """Its clients."""
        yield from (it for it in self._entities if isinstance(it, Client))

    @property
    def services(self) -> Iterator[Service]:
        """Its services."""
        yield from (it for it in self._entities if isinstance(it, Service))

    @property
    def timers(self) -> Iterator[Timer]:
        """Its timers."""
        yield from (it for it in self._entities if isinstance(it, Timer))

    @property
    def guards(self) -> Iterator[GuardCondition]:
        """Its guard conditions."""
        yield from (it for it in self._entities if isinstance(it, GuardCondition))

    # What it makes.

    def create_publisher(
        self,
        msg_type: type[Any],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        publisher_class: type[Publisher[Any]] = Publisher,
    ) -> Publisher[Any]:
        """Make a publisher; the keywords are those of rclpy."""
        qos = _profile(qos_profile)
        name = self.resolve_topic_name(topic)
        type_ = type_name(msg_type, "message")
        if qos_overriding_options is not None:
            _declare_qos_parameters(Publisher, self, name, qos, qos_overriding_options)
        group = callback_group or self._default_callback_group
        endpoint = self._endpoint("publisher", name, type_, qos)
        made = publisher_class(self, msg_type, endpoint, qos)
        self._declare(made, endpoint)
        made._assertions = Assertions.of(made, endpoint)
        self._publishers.append(made)
        self._watch(made, event_callbacks or PublisherEventCallbacks(), group)
        return made

    def create_subscription(
        self,
        msg_type: type[Any],
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
        content_filter_options: Any = None,
    ) -> Subscription:
        """Make a subscription; the keywords are those of rclpy."""
        if content_filter_options is not None:
            raise NotImplementedError(
                "content filters are not supported by hprm.ros: filter in the callback"
            )
        qos = _profile(qos_profile)
        name = self.resolve_topic_name(topic)
        type_ = type_name(msg_type, "message")
        group = callback_group or self._default_callback_group
        if qos_overriding_options is not None:
            _declare_qos_parameters(Subscription, self, name, qos, qos_overriding_options)
        endpoint = self._endpoint("subscription", name, type_, qos)
        made = Subscription(self, msg_type, endpoint, callback, group, qos, raw)
        is_durable = qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
        self._declare(made, endpoint, made.deliver, made if is_durable else None)
        self._watch(made, event_callbacks or SubscriptionEventCallbacks(), group)
        return self._add(made)

    def create_client(
        self,
        srv_type: type[Any],
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Make a client of a service."""
        name = self.resolve_service_name(srv_name)
        type_ = type_name(srv_type, "service")
        group = callback_group or self._default_callback_group
        endpoint = self._endpoint("client", name, type_, qos_profile)
        made = Client(self, self._context, srv_type, endpoint, qos_profile, group)
        self._declare(made, endpoint, made.deliver)
        made.watch()
        return self._add(made)

    def create_service(
        self,
        srv_type: type[Any],
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Make a service."""
        name = self.resolve_service_name(srv_name)
        type_ = type_name(srv_type, "service")
        group = callback_group or self._default_callback_group
        endpoint = self._endpoint("service", name, type_, qos_profile)
        made = Service(self, srv_type, endpoint, callback, group, qos_profile)
        self._declare(made, endpoint, made.deliver)
        made.watch()
        return self._add(made)

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Make a timer, whose first call is after a period."""
        period_ns = int(float(timer_period_sec) * 1e9)
        group = callback_group or self._default_callback_group
        made = Timer(self, callback, group, period_ns, clock or self._clock, autostart=autostart)
        return self._add(made)

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Make a guard condition."""
        group = callback_group or self._default_callback_group
        return self._add(GuardCondition(self, callback, group))

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Make a rate, by which another thread than the one that spins sleeps."""
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        group = MutuallyExclusiveCallbackGroup()
        timer = self.create_timer(1.0 / frequency, None, group, clock)
        rate = Rate(timer, context=self._context)
        self._rates.append(rate)
        return rate

    # What it destroys.

    def destroy_publisher(self, publisher: Publisher[Any]) -> bool:
        """Destroy a publisher; return whether it was of this node."""
        if publisher not in self._publishers:
            return False
        self._publishers.remove(publisher)
        publisher.destroy()
        return True

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription; return whether it was of this node."""
        return self._destroy(subscription)

    def destroy_client(self, client: Client) -> bool:
        """Destroy a client; return whether it was of this node."""
        return self._destroy(client)

    def destroy_service(self, service: Service) -> bool:
        """Destroy a service; return whether it was of this node."""
        return self._destroy(service)

    def destroy_timer(self, timer: Timer) -> bool:
        """Destroy a timer; return whether it was of this node."""
        return self._destroy(timer)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        """Destroy a guard condition; return whether it was of this node."""
        return self._destroy(guard)

    def destroy_rate(self, rate: Rate) -> bool:
        """Destroy a rate; return whether it was of this node."""
        if rate not in self._rates:
            return False
        self._rates.remove(rate)
        self._destroy(rate._timer)
        rate.destroy()
        return True

    def destroy_node(self) -> None:
        """Destroy all that it has made."""
        for rate in list(self._rates):
            self.destroy_rate(rate)
        for publisher in list(self._publishers):
            self.destroy_publisher(publisher)
        for entity in self._entities:
            self._destroy(entity)
        while self._own_services:
            self._own_services.pop().destroy()
        self._time_source.detach_node()
        rosout.remove(self)
        if self._executor is not None:
            self._executor.remove_node(self)
        self._is_destroyed = True

    def __enter__(self) -> Node:
        """Return the node."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Destroy it."""
        self.destroy_node()

    # For its entities and executors.

    def _tell_changes(self, changes: ParameterChanges) -> None:
        self._parameter_events.tell(changes)

    def _is_spun_by_this_thread(self) -> bool:
        executor = self._executor
        return executor is not None and executor._runs_callbacks_in_this_thread()

    def _depth_of(self, qos: QoSProfile) -> int | None:
        """How many messages a queue keeps; none if it keeps all."""
        if qos.history == QoSHistoryPolicy.KEEP_ALL:
            return None
        # Zero stands for what the system takes.
        return qos.depth or 10

    def _endpoint(self, kind: Any, name: str, type_: str, qos: QoSProfile) -> Endpoint:
        self._check_alive()
        told = described(kind, qos, self._depth_of(qos))
        return Endpoint(kind, self.get_fully_qualified_name(), name, type_, told)

    def _check_alive(self) -> None:
        if self._is_destroyed:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")

    def _add(self, entity: E) -> E:
        # Stable: entities of one kind stay in the order in which they were made.
        self._entities = tuple(sorted((*self._entities, entity), key=lambda it: it.order))
        self._runtime.wake()
        return entity

    def _destroy(self, entity: Entity) -> bool:
        if entity not in self._entities:
            return False
        self._entities = tuple(it for it in self._entities if it is not entity)
        entity.destroy()
        return True

    def _declare(
        self, made: Any, endpoint: Endpoint, deliver: Any = None, late: LateTaker | None = None
    ) -> None:
        self._endpoints[made] = endpoint
        self._runtime.declare(endpoint, deliver, late)

    def _watch(self, made: Any, callbacks: Any, group: CallbackGroup) -> None:
        """Add what calls back at events of a publisher or a subscription."""
        for handler in callbacks.create_event_handlers(group, made, made.topic):
            made.event_handlers.append(self._add(handler))

    def _matched(self, made: Any) -> list[Endpoint]:
        """Return what exchanges messages with a publisher or a subscription; nothing if gone."""
        own = self._endpoints.get(made)
        return [] if own is None else matched(own, self._runtime.endpoints())

    def _withdraw(self, gone: Any) -> None:
        endpoint = self._endpoints.pop(gone, None)
        if endpoint is not None:
            self._runtime.withdraw_endpoint(endpoint)


def _profile(stated: QoSProfile | int) -> QoSProfile:
    if isinstance(stated, QoSProfile):
        return stated
    if isinstance(stated, int) and not isinstance(stated, bool):
        if stated < 0:
            raise ValueError("history depth must be greater than or equal to zero")
        return QoSProfile(depth=stated)
    raise TypeError(f"Expected QoSProfile or int, but received {type(stated)!r}")
