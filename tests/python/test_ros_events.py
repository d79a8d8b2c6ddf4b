"""What nodes learn of others: events of publishers and subscriptions, and who is there."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import Bench, finish

HEAD = """\
import rclpy
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

rclpy.init()
"""

ALONE = """
class Alone(Node):
    def __init__(self):
        super().__init__("alone")
        self.publisher = self.create_publisher(
            String, "news", 10, event_callbacks=PublisherEventCallbacks(matched=self.told)
        )
        self.others = [self.create_subscription(String, "news", print, 10)]
        self.step = 0
        self.create_timer(0.1, self.tick)

    def told(self, it):
        print(it.current_count, it.current_count_change, it.total_count, it.total_count_change)

    def tick(self):
        self.step += 1
        if self.step == 1:
            self.others.append(self.create_subscription(String, "news", print, 10))
        elif self.step == 2:
            self.destroy_subscription(self.others.pop(0))
            print("has", self.publisher.get_subscription_count())
        else:
            raise SystemExit


rclpy.spin(Alone())
"""

DEADLINE = """
class Late(Node):
    def __init__(self):
        super().__init__("late")
        qos = QoSProfile(depth=10, deadline=Duration(seconds=0.25))
        self.publisher = self.create_publisher(
            String, "news", qos, event_callbacks=PublisherEventCallbacks(deadline=self.offered)
        )
        self.create_subscription(
            String, "news", lambda it: None, qos,
            event_callbacks=SubscriptionEventCallbacks(deadline=self.missed),
        )
        self.count = 0
        self.timer = self.create_timer(0.1, self.tick)

    def tick(self):
        self.count += 1
        if self.count == 1:
            self.begin = self.get_clock().now()
        self.publisher.publish(String(data="x"))
        if self.count == 3:
            self.timer.cancel()

    def offered(self, it):
        self.tell("offered", it)

    def missed(self, it):
        self.tell("requested", it)
        if it.total_count == 2:
            raise SystemExit

    def tell(self, what, it):
        passed = (self.get_clock().now() - self.begin).nanoseconds // 1_000_000
        print(what, it.total_count, it.total_count_change, "at", passed)


rclpy.spin(Late())
"""

LOST = """
node = Node("slow")
publisher = node.create_publisher(String, "news", 10)
node.create_subscription(
    String, "news", lambda it: print("heard", it.data), 2,
    event_callbacks=SubscriptionEventCallbacks(
        message_lost=lambda it: print("lost", it.total_count, it.total_count_change)
    ),
)


def tick():
    for it in range(5):
        publisher.publish(String(data=str(it)))


timer = node.create_timer(0.1, tick)
for _ in range(6):
    rclpy.spin_once(node)
    timer.cancel()
"""


@pytest.fixture
def run(bench: Bench, tmp_path: Path):
    """Run a script, and return the lines it prints."""

    def start(text: str, *options: str) -> list[str]:
        (tmp_path / "one.py").write_text(HEAD + text)
        outcome = finish(bench.call("ros", "run", *options, "one.py"))
        assert outcome.code == 0, outcome.err
        return outcome.out.splitlines()

    return start


def test_a_publisher_is_told_of_subscriptions_that_come_and_go(run) -> None:
    assert run(ALONE, "--fast", "true") == ["1 1 1 1", "2 1 2 1", "has 1", "1 -1 2 0"]


def test_deadlines_that_are_missed_are_told_at_logical_times(run) -> None:
    told = run(DEADLINE, "--fast", "true")
    # What was asked for at one tag is told in the order in which it was made.
    assert sorted(told) == sorted(
        f"{what} {number} 1 at {200 + 250 * number}"
        for number in (1, 2)
        for what in ("offered", "requested")
    )


def test_what_a_queue_drops_is_told(run) -> None:
    told = run(LOST, "--fast", "true")
    assert [it for it in told if "heard" in it] == ["heard 3", "heard 4"]
    assert [it for it in told if "lost" in it] == ["lost 1 1", "lost 2 1", "lost 3 1"]


WATCHED = """
import sys

node = Node("watched", namespace="robot")
node.create_subscription(String, "/news", print, QoSProfile(depth=3))
publisher = node.create_publisher(String, "other", 10)
count = 0


def tick():
    global count
    count += 1
    if count == 2:
        node.destroy_publisher(publisher)
    if count == 4:
        raise SystemExit


node.create_timer(0.1, tick)
rclpy.spin(node)
"""

WATCHES = """
class Watches(Node):
    def __init__(self):
        super().__init__("watches")
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        told = PublisherEventCallbacks(matched=lambda it: print("matched", it.current_count))
        self.create_publisher(String, "news", qos, event_callbacks=told)
        gone = SubscriptionEventCallbacks(matched=lambda it: print("publishers", it.current_count))
        self.create_subscription(String, "robot/other", print, 1, event_callbacks=gone)
        self.create_timer(0.05, self.look)
        self.looks = 0

    def look(self):
        self.looks += 1
        if self.looks == 1:
            (one,) = self.get_subscriptions_info_by_topic("news")
            print(one.node_name, one.node_namespace, one.topic_type, one.qos_profile.depth)
            (own,) = self.get_publishers_info_by_topic("news")
            print(own.endpoint_type.name, own.qos_profile.durability.name)
            print(str(own).splitlines()[0])
            print(self.get_subscriber_names_and_types_by_node("watched", "/robot"))
            try:
                self.get_publisher_names_and_types_by_node("nobody", "/")
            except rclpy.exceptions.NodeNameNonExistentError as error:
                print(error)
        if self.looks == 5:
            raise SystemExit


rclpy.spin(Watches())
"""


def test_nodes_of_other_processes_are_known_and_that_something_is_gone(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "watched.py").write_text(HEAD + WATCHED)
    (tmp_path / "watches.py").write_text(HEAD + WATCHES)
    outcome = finish(bench.call("ros", "run", "watched.py", "+", "watches.py"))
    assert outcome.code == 0, outcome.err
    told = [it.removeprefix("[watches-2] ") for it in outcome.out.splitlines()]
    assert told == [
        *("matched 1", "publishers 1"),
        "watched /robot std_msgs/msg/String 3",
        "PUBLISHER TRANSIENT_LOCAL",
        "Node name: watches",
        "[('/news', ['std_msgs/msg/String'])]",
        "cannot get the names of a node that is not there: /nobody",
        "publishers 0",
    ]


UNKNOWN = """
try:
    Node("two").create_subscription(String, "news", print, 1, content_filter_options="data = 'x'")
except NotImplementedError as error:
    print(error)
for name in (
    "type_description_service",
    "experimental",
    "subscription_content_filter_options",
    "nothing",
):
    try:
        __import__(f"rclpy.{name}")
    except ModuleNotFoundError as error:
        print(error)
"""


def test_what_is_left_out_says_so(run) -> None:
    filters, *modules = run(UNKNOWN)
    assert filters == "content filters are not supported by hprm.ros: filter in the callback"
    assert modules == [
        "hprm.ros has no rclpy.type_description_service: nodes do not serve the descriptions of"
        " their types",
        "  hint: the handbook page howto/rclpy says what there is not",
        "hprm.ros has no rclpy.experimental: there is one kind of loop for all executors",
        "  hint: the handbook page howto/rclpy says what there is not",
        "hprm.ros has no rclpy.subscription_content_filter_options: a subscription gets all"
        " messages of its topic",
        "  hint: the handbook page howto/rclpy says what there is not",
        "No module named 'rclpy.nothing'",
    ]


PROFILES = """
import sys
from rclpy.qos import LivelinessPolicy, ReliabilityPolicy

FAR, NEAR = Duration(seconds=2), Duration(seconds=1)
WEAK_AND_STRICT = {
    "RELIABILITY": (
        QoSProfile(depth=9, reliability=ReliabilityPolicy.BEST_EFFORT), QoSProfile(depth=9)
    ),
    "DURABILITY": (
        QoSProfile(depth=9), QoSProfile(depth=9, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    ),
    "DEADLINE": (QoSProfile(depth=9, deadline=FAR), QoSProfile(depth=9, deadline=NEAR)),
    "LIVELINESS": (
        QoSProfile(depth=9), QoSProfile(depth=9, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC)
    ),
    "LEASE": (
        QoSProfile(depth=9, liveliness_lease_duration=FAR),
        QoSProfile(depth=9, liveliness_lease_duration=NEAR),
    ),
}
WEAK, STRICT = WEAK_AND_STRICT[sys.argv[1]]


def told(it):
    print("told", it.total_count, it.total_count_change, it.last_policy_kind.name, flush=True)


def at(node, seconds, act):
    def once():
        timer.cancel()
        act()
    timer = node.create_timer(seconds, once)
"""

OFFERS = """
node = Node("offers")
callbacks = PublisherEventCallbacks(incompatible_qos=told)
weak = node.create_publisher(String, "news", WEAK, event_callbacks=callbacks)
strict = node.create_publisher(String, "news", STRICT)


def publish():
    print("matched", weak.get_subscription_count(), strict.get_subscription_count(), flush=True)
    weak.publish(String(data="weak"))
    strict.publish(String(data="strict"))
    weak.publish(String(data="weak again"))


at(node, 0.1, publish)
at(node, 0.2, rclpy.shutdown)
"""

REQUESTS = """
other = Node("requests")
callbacks = SubscriptionEventCallbacks(incompatible_qos=told)
takes = [
    other.create_subscription(
        String, "news", lambda it: print("strict got", it.data, flush=True), STRICT,
        event_callbacks=callbacks,
    ),
    other.create_subscription(
        String, "news", lambda it: print("weak got", it.data, flush=True), WEAK
    ),
]
at(other, 0.05, lambda: print("has", *(it.get_publisher_count() for it in takes), flush=True))
at(other, 0.2, rclpy.shutdown)
"""

SPINS = """
executor = rclpy.executors.SingleThreadedExecutor()
for each in ("node", "other"):
    if each in globals():
        executor.add_node(globals()[each])
executor.spin()
"""

POLICIES = ["RELIABILITY", "DURABILITY", "DEADLINE", "LIVELINESS", "LEASE"]


@pytest.mark.parametrize("policy", POLICIES)
def test_what_is_not_compatible_exchanges_nothing_and_is_told(
    bench: Bench, tmp_path: Path, policy: str
) -> None:
    told = f"told 1 1 {'LIVELINESS' if policy == 'LEASE' else policy}"
    (tmp_path / "one.py").write_text(HEAD + PROFILES + OFFERS + REQUESTS + SPINS)
    outcome = finish(bench.call("ros", "run", "--fast", "true", "one.py", policy))
    assert outcome.code == 0, outcome.err
    got = ["strict got strict", "weak got weak", "weak got strict", "weak got weak again"]
    assert sorted(outcome.out.splitlines()) == sorted([told, told, "has 1 2", "matched 1 2", *got])
    assert outcome.err == ""


@pytest.mark.parametrize("policy", POLICIES)
def test_so_it_is_between_scripts(bench: Bench, tmp_path: Path, policy: str) -> None:
    told = f"told 1 1 {'LIVELINESS' if policy == 'LEASE' else policy}"
    (tmp_path / "offers.py").write_text(HEAD + PROFILES + OFFERS + SPINS)
    (tmp_path / "requests.py").write_text(HEAD + PROFILES + REQUESTS + SPINS)
    command = ("ros", "run", "--fast", "true", "offers.py", policy, "+", "requests.py", policy)
    outcome = finish(bench.call(*command))
    assert (outcome.code, outcome.err) == (0, "")
    lines = outcome.out.splitlines()
    assert [it for it in lines if "offers" in it] == [
        f"[offers-1] {told}",
        "[offers-1] matched 1 2",
    ]
    assert [it for it in lines if "requests" in it] == [
        f"[requests-2] {it}"
        for it in (told, "has 1 2", "strict got strict")
        + ("weak got weak", "weak got strict", "weak got weak again")
    ]


WARNED = """
from rclpy.qos import ReliabilityPolicy

node = Node("one")
best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
publisher = node.create_publisher(String, "news", best_effort)
node.create_subscription(String, "news", print, 1)
quiet = {"use_default_callbacks": False}
node.create_publisher(String, "calm", best_effort, event_callbacks=PublisherEventCallbacks(**quiet))
node.create_subscription(
    String, "calm", print, 1, event_callbacks=SubscriptionEventCallbacks(**quiet)
)
node.create_timer(0.1, lambda: publisher.publish(String(data="lost")))
node.create_timer(0.35, rclpy.shutdown)
rclpy.spin(node)
"""


def test_a_warning_tells_what_is_not_compatible(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text(HEAD + WARNED)
    outcome = finish(bench.call("ros", "run", "--fast", "true", "one.py"))
    assert (outcome.code, outcome.out) == (0, "")
    assert [it.partition("[one]: ")[2] for it in outcome.err.splitlines()] == [
        "New subscription discovered on topic '/news', requesting incompatible QoS. No messages"
        " will be sent to it. Last incompatible policy: RELIABILITY",
        "New publisher discovered on topic '/news', offering incompatible QoS. No messages will"
        " be received from it. Last incompatible policy: RELIABILITY",
    ]


LATE = """
from std_msgs.msg import Int64


class Late(Node):
    def __init__(self):
        super().__init__("late")
        self.publisher = self.create_publisher(
            String, "news", 1,
            event_callbacks=PublisherEventCallbacks(incompatible_type=self.told, matched=print),
        )
        self.step = 0
        self.create_timer(0.1, self.tick)

    def told(self, it):
        print("told", it.total_count, it.total_count_change)

    def tick(self):
        self.step += 1
        if self.step < 3:
            self.taken = self.create_subscription(Int64, "news", print, 1)
        elif self.step == 3:
            self.publisher.publish(String(data="for nothing else than texts"))
            self.destroy_subscription(self.taken)
            print("has", self.publisher.get_subscription_count())
        elif self.step == 4:
            self.create_subscription(Int64, "news", print, 1)
        else:
            raise SystemExit


rclpy.spin(Late())
"""


def test_endpoints_of_another_type_exchange_nothing_and_are_told(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "late.py").write_text(HEAD + LATE)
    outcome = finish(bench.call("ros", "run", "--fast", "true", "late.py"))
    assert outcome.code == 0, outcome.err
    assert outcome.out.splitlines() == ["told 1 1", "told 2 1", "has 0", "told 3 1"]
    said = [it.partition("[late]: ")[2] for it in outcome.err.splitlines()]
    assert said == ["Incompatible type on topic '/news', no messages will be sent to it."] * 3


EARLY = """
from rclpy.qos import ReliabilityPolicy

kept = QoSProfile(
    depth=2,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    reliability=ReliabilityPolicy.BEST_EFFORT,
)
wants = QoSProfile(depth=9, durability=DurabilityPolicy.TRANSIENT_LOCAL)
any_ = QoSProfile(
    depth=9, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.BEST_EFFORT
)
node = Node("early")
publisher = node.create_publisher(String, "news", kept)
plain = node.create_publisher(String, "news", 5)


def publish():
    for it in "abc":
        publisher.publish(String(data=it))
        plain.publish(String(data=f"plain {it}"))


def take(name, qos):
    node.create_subscription(String, "news", lambda it: print(name, it.data), qos)


def tick():
    global step
    step += 1
    if step == 1:
        publish()
    elif step == 2:
        take("refused", wants)
        take("taken", any_)
    else:
        raise SystemExit


step = 0
node.create_timer(0.1, tick)
rclpy.spin(node)
"""


def test_what_is_kept_is_for_compatible_subscriptions(run) -> None:
    told = run(EARLY, "--fast", "true")
    assert told == ["taken b", "taken c"]


SERVES = """
from example_interfaces.srv import AddTwoInts
from rclpy.qos import ReliabilityPolicy

node = Node("serves")
weak = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def add(request, response):
    response.sum = request.a + request.b
    return response


node.create_service(AddTwoInts, "add", add, qos_profile=weak)
client = node.create_client(AddTwoInts, "add", qos_profile=weak)
future = client.call_async(AddTwoInts.Request(a=1, b=2))
rclpy.spin_until_future_complete(node, future)
print(future.result().sum)
(taken,) = node.get_publishers_info_by_topic("/rosout")
print(taken.qos_profile.durability.name)
node.create_publisher(String, "news", QoSProfile(depth=1, deadline=Duration(seconds=2)))
(told,) = node.get_publishers_info_by_topic("/news")
print(told.qos_profile.deadline.nanoseconds, told.qos_profile.lifespan.nanoseconds)
"""


def test_requests_pass_if_policies_are_equal_and_policies_are_known(run) -> None:
    assert run(SERVES, "--fast", "true") == ["3", "TRANSIENT_LOCAL", "2000000000 0"]


BEST = """
from rclpy.qos import qos_profile_best_available

node = Node("best")
publisher = node.create_publisher(String, "news", qos_profile_best_available)
durable = QoSProfile(depth=9, durability=DurabilityPolicy.TRANSIENT_LOCAL)
step = 0


def tick():
    global step
    step += 1
    if step == 2:
        node.create_subscription(String, "news", lambda it: print("durable", it.data), durable)
        best = qos_profile_best_available
        node.create_subscription(String, "news", lambda it: print("best", it.data), best)
    if step == 4:
        raise SystemExit
    publisher.publish(String(data=str(step)))


node.create_timer(0.1, tick)
rclpy.spin(node)
"""


def test_the_best_that_is_available_is_the_best_of_a_publisher(run) -> None:
    told = run(BEST, "--fast", "true")
    assert sorted(told) == ["best 2", "best 3", "durable 1", "durable 2", "durable 3"]


STAYS = """
node = Node("stays")


def told(it):
    print("told", it.total_count, it.last_policy_kind.name, flush=True)
    if it.total_count == 2:
        raise SystemExit


callbacks = PublisherEventCallbacks(incompatible_qos=told)
node.create_publisher(String, "news", 10, event_callbacks=callbacks)
rclpy.spin(node)
"""

COMES = """
node = Node("comes")
durable = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
count = 0


def tick():
    global count
    count += 1
    if count < 3:
        one = node.create_subscription(String, "news", print, durable, event_callbacks=quiet)
        print("has", one.get_publisher_count(), flush=True)
    elif count == 20:
        # What was told at times of the clock has left by then.
        raise SystemExit


quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
node.create_timer(0.05, tick)
rclpy.spin(node)
"""


def test_so_it_is_of_endpoints_that_another_script_makes_later(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "stays.py").write_text(HEAD + STAYS)
    (tmp_path / "comes.py").write_text(HEAD + COMES)
    outcome = finish(bench.call("ros", "run", "stays.py", "+", "comes.py"))
    assert (outcome.code, outcome.err) == (0, "")
    lines = outcome.out.splitlines()
    told = [it for it in lines if "stays" in it]
    # They come over the hub, both at once if that is late.
    assert told[-1] == "[stays-1] told 2 DURABILITY" and len(told) <= 2
    assert [it for it in lines if "comes" in it] == ["[comes-2] has 0"] * 2
