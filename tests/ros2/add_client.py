"""Asks for three sums, one after the other."""

import sys

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class AddClient(Node):
    def __init__(self):
        super().__init__("add_client")
        self.client = self.create_client(AddTwoInts, "add_two_ints")
        while not self.client.wait_for_service(timeout_sec=1.0):
            self.get_logger().info("no service yet, waiting")

    def ask(self, a, b):
        future = self.client.call_async(AddTwoInts.Request(a=a, b=b))
        rclpy.spin_until_future_complete(self, future)
        return future.result().sum


def main(args=None):
    rclpy.init(args=args)
    node = AddClient()
    first = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    for second in range(3):
        node.get_logger().info(f"{first} + {second} is {node.ask(first, second)}")
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
