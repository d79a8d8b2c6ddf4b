"""Looks four times where the tip of the carrot is in the world."""

import rclpy
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import Buffer, TransformException, TransformListener


class Follower(Node):
    def __init__(self):
        super().__init__("follower")
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.looks = 0
        self.timer = self.create_timer(0.25, self.look)

    def look(self):
        try:
            found = self.buffer.lookup_transform("world", "tip", Time())
        except TransformException as error:
            self.get_logger().info(f"not yet: {error}")
            return
        place = found.transform.translation
        print(f"the tip is at {place.x:.2f}, {place.y:.2f}", flush=True)
        self.looks += 1
        if self.looks == 4:
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Follower())
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
