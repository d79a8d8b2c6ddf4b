"""Has two rows of Fibonacci numbers computed, and cancels the second one."""

import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient
from rclpy.node import Node


class FibonacciClient(Node):
    def __init__(self):
        super().__init__("fibonacci_client")
        self.client = ActionClient(self, Fibonacci, "fibonacci")

    def run(self, order, most):
        self.client.wait_for_server()
        sent = self.client.send_goal_async(Fibonacci.Goal(order=order), self.show)
        self.most = most
        rclpy.spin_until_future_complete(self, sent)
        self.goal = sent.result()
        done = self.goal.get_result_async()
        rclpy.spin_until_future_complete(self, done)
        print("result:", list(done.result().result.sequence), flush=True)

    def show(self, message):
        numbers = list(message.feedback.sequence)
        print("so far:", numbers, flush=True)
        if len(numbers) == self.most:
            self.goal.cancel_goal_async()


def main(args=None):
    rclpy.init(args=args)
    node = FibonacciClient()
    node.run(order=5, most=None)
    node.run(order=100, most=4)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
