"""Fuses two cameras and a lidar, whose measurements are at different times."""

import rclpy
from geometry_msgs.msg import PointStamped
from message_filters import ApproximateTimeSynchronizer, Subscriber
from rclpy.node import Node
from rclpy.time import Time


class Fusion(Node):
    def __init__(self):
        super().__init__("fusion")
        names = ["left", "right", "lidar"]
        self.filters = [Subscriber(self, PointStamped, name) for name in names]
        self.synchronizer = ApproximateTimeSynchronizer(self.filters, queue_size=5, slop=0.03)
        self.synchronizer.registerCallback(self.fuse)
        self.first, self.count = None, 0

    def fuse(self, *measured):
        times = [Time.from_msg(it.header.stamp).nanoseconds // 1_000_000 for it in measured]
        self.first = self.first or times[0]
        values = [int(it.point.x) for it in measured]
        print("fused", values, "at", [time - self.first for time in times], flush=True)
        self.count += 1
        if self.count == 6:
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Fusion())
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
