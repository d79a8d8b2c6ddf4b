"""Sends a goal, shows feedback and result, and perhaps cancels it after some feedback."""

import sys

import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient
from rclpy.node import Node


class FibonacciClient(Node):
    def __init__(self, cancel_after):
        super().__init__("fibonacci_client")
        self.cancel_after = cancel_after
        self.client = ActionClient(self, Fibonacci, "fibonacci")

    def run(self, order):
        self.client.wait_for_server()
        sent = self.client.send_goal_async(Fibonacci.Goal(order=order), self.show)
        rclpy.spin_until_future_complete(self, sent)
        self.goal = sent.result()
        if not self.goal.accepted:
            print("rejected")
            return
        result = self.goal.get_result_async()
        rclpy.spin_until_future_complete(self, result)
        print("status", result.result().status, "result", list(result.result().result.sequence))

    def show(self, message):
        print("feedback", list(message.feedback.sequence))
        if len(message.feedback.sequence) == self.cancel_after:
            self.goal.cancel_goal_async()


def main(args=None):
    rclpy.init(args=args)
    node = FibonacciClient(int(sys.argv[2]) if len(sys.argv) > 2 else None)
    node.run(int(sys.argv[1]))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
