"""Computes Fibonacci numbers, one every tenth of a second, and tells how far it is."""

import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionServer, CancelResponse
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
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    async def execute(self, goal):
        numbers = [0, 1]
        while len(numbers) < goal.request.order:
            await self.pause(0.1)
            if goal.is_cancel_requested:
                goal.canceled()
                return Fibonacci.Result(sequence=numbers)
            numbers.append(numbers[-1] + numbers[-2])
            goal.publish_feedback(Fibonacci.Feedback(sequence=numbers))
        goal.succeed()
        return Fibonacci.Result(sequence=numbers)

    async def pause(self, seconds):
        passed = Future()
        timer = self.create_timer(seconds, lambda: passed.set_result(None))
        await passed
        self.destroy_timer(timer)


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(FibonacciServer())
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
