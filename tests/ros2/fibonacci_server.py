"""Computes Fibonacci numbers: goals that take a while, tell how it goes, and can be cancelled."""

import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future


class FibonacciServer(Node):
    def __init__(self):
        super().__init__("fibonacci_server")
        self.server = ActionServer(
            self,
            Fibonacci,
            "fibonacci",
            self.execute,
            goal_callback=self.judge,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    def judge(self, goal):
        return GoalResponse.ACCEPT if goal.order > 0 else GoalResponse.REJECT

    async def execute(self, goal):
        if goal.request.order == 13:
            raise ValueError("13 is refused")
        numbers = [0, 1]
        while len(numbers) < goal.request.order:
            await self.pause(0.02)
            if goal.is_cancel_requested:
                goal.canceled()
                self.get_logger().info("cancelled")
                return Fibonacci.Result(sequence=numbers)
            numbers.append(numbers[-1] + numbers[-2])
            goal.publish_feedback(Fibonacci.Feedback(sequence=numbers))
        goal.succeed()
        return Fibonacci.Result(sequence=numbers)

    async def pause(self, seconds):
        over = Future()
        timer = self.create_timer(seconds, lambda: over.done() or over.set_result(None))
        await over
        self.destroy_timer(timer)


def main(args=None):
    rclpy.init(args=args)
    node = FibonacciServer()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
