"""Programs that wait in ways of their own: executors they write, asyncio, threads, one message."""

from __future__ import annotations

import pytest
from processes import Bench

HEAD = """\
import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.executors import Executor, ExternalShutdownException, TimeoutException
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String

rclpy.init()
"""


@pytest.fixture
def run(bench: Bench):
    """Run a script, and return the lines it prints."""
    return lambda text, *options: bench.ros_lines(HEAD + text, *options)


OWN = """
class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.count = 0
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.create_timer(0.1, self.tick)

    def tick(self):
        self.count += 1
        print("tick", self.count)
        self.publisher.publish(String(data=str(self.count)))


class Listener(Node):
    def __init__(self, name):
        super().__init__(name)
        self.create_subscription(String, "chatter", self.hear, 10)

    def hear(self, message):
        after = (self.get_clock().now() - begin).nanoseconds // 1_000_000
        print(self.get_name(), message.data, after)
        self.publisher = self.create_publisher(String, "late", 10)


class Own(Executor):
    def __init__(self):
        super().__init__()
        self.quick, self.slow = ThreadPoolExecutor(2), ThreadPoolExecutor(1)
        self.done = []

    def spin_once(self, timeout_sec=None):
        try:
            handler, entity, node = self.wait_for_ready_callbacks(timeout_sec=timeout_sec)
        except TimeoutException:
            print("nothing")
            return
        assert entity in node._entities
        pool = self.slow if node.get_name() == "second" else self.quick
        self.done.append(pool.submit(handler))


executor = Own()
for node in (Talker(), Listener("first"), Listener("second")):
    executor.add_node(node)
begin = node.get_clock().now()
executor.spin_once(timeout_sec=0.01)
for _ in range(9):
    executor.spin_once()
for it in executor.done:
    it.result()
"""


@pytest.mark.parametrize("fast", ["false", "true"])
def test_a_program_may_have_an_executor_of_its_own(run, fast: str) -> None:
    # In the threads of its pools, callbacks run one at a time, at their tags.
    printed = run(OWN, "--fast", fast)
    assert printed[0] == "nothing"
    assert [it.rpartition(" ")[0] if it[0] != "t" else it for it in printed[1:]] == [
        line
        for number in (1, 2, 3)
        for line in (f"tick {number}", f"first {number}", f"second {number}")
    ]
    times = [int(it.rpartition(" ")[2]) for it in printed[1:] if it[0] != "t"]
    assert times[0::2] == times[1::2]
    assert [b - a for a, b in zip(times[0::2], times[2::2], strict=False)] == [100, 100]


THREADS = """
busy = 0


class Many(Node):
    def __init__(self):
        super().__init__("many")
        self.count = 0
        group = ReentrantCallbackGroup()
        for _ in range(4):
            self.create_timer(0.01, self.tick, callback_group=group)

    def tick(self):
        global busy
        busy += 1
        for _ in range(2000):
            most.add(busy)
        busy -= 1
        self.count += 1
        if self.count == 40:
            raise SystemExit


most = set()
executor = MultiThreadedExecutor(num_threads=4)
executor.add_node(Many())
try:
    executor.spin()
finally:
    print(most)
"""


def test_callbacks_run_one_at_a_time_with_several_threads(run) -> None:
    assert run(THREADS, "--fast", "true") == ["{1}"]


ASYNCIO = """
server = Node("server")


def add(request, response):
    response.sum = request.a + request.b
    return response


server.create_service(AddTwoInts, "add", add)
client = server.create_client(AddTwoInts, "add")


async def spinning():
    while rclpy.ok():
        rclpy.spin_once(server, timeout_sec=0.01)
        await asyncio.sleep(0.001)


async def main():
    spins = asyncio.get_running_loop().create_task(spinning())
    for it in range(3):
        response = await client.call_async(AddTwoInts.Request(a=it, b=1))
        print("sum", response.sum)
    spins.cancel()
    try:
        await spins
    except asyncio.CancelledError:
        rclpy.shutdown()


asyncio.run(main())
"""


def test_a_coroutine_of_asyncio_may_wait_for_a_future(run) -> None:
    assert run(ASYNCIO) == ["sum 1", "sum 2", "sum 3"]


JOIN = """
node, other = Node("one"), Node("other")
executor = {executor}()
executor.add_node(node)
thread = threading.Thread(target=executor.spin)
thread.start()
other.create_timer(0.1, lambda: None)
rclpy.spin_once(other)
executor.shutdown()
thread.join()
print("joined")
"""


@pytest.mark.parametrize("executor", ["SingleThreadedExecutor", "MultiThreadedExecutor"])
def test_a_thread_that_ends_an_executor_may_wait_for_its_thread(run, executor: str) -> None:
    # There is no warning that this thread has not come back.
    assert run(JOIN.format(executor=executor)) == ["joined"]


WAITS = """
node = Node("waits")
publisher = node.create_publisher(String, "news", 10)
print(wait_for_message(String, node, "news", time_to_wait=0.05))
node.create_subscription(String, "news", lambda it: print("callback", it.data), 10)
threading.Timer(0.1, lambda: publisher.publish(String(data="x"))).start()
print(wait_for_message(String, node, "news"))
rclpy.spin_once(node)
print(node.count_subscribers("news"))
"""


def test_a_program_may_wait_for_one_message(run) -> None:
    assert run(WAITS) == [
        "(False, None)",
        "(True, std_msgs.msg.String(data='x'))",
        "callback x",
        "1",
    ]
