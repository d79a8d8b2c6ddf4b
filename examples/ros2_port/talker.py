"""Publishes a greeting every half second, five times."""

import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.count = 0
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.timer = self.create_timer(0.5, self.talk)

    def talk(self):
        self.count += 1
        self.publisher.publish(String(data=f"hello {self.count}"))
        if self.count == 5:
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Talker())
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
