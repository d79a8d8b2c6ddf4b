"""Prints the greetings that come."""

import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Listener(Node):
    def __init__(self):
        super().__init__("listener")
        self.subscription = self.create_subscription(String, "chatter", self.show, 10)

    def show(self, message):
        print("heard:", message.data, flush=True)
        if message.data == "hello 5":
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Listener())
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
