"""A sensor: publishes a measurement with its time, PERIOD seconds apart, as often as COUNT says."""

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.node import Node


class Sensor(Node):
    def __init__(self):
        super().__init__("sensor")
        self.declare_parameter("period", 0.1)
        self.declare_parameter("count", 10)
        self.left = self.get_parameter("count").value
        self.publisher = self.create_publisher(PointStamped, "measured", 10)
        self.timer = self.create_timer(self.get_parameter("period").value, self.measure)

    def measure(self):
        message = PointStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = self.get_name()
        message.point.x = float(self.left)
        self.publisher.publish(message)
        self.left -= 1
        if self.left == 0:
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Sensor())
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
