"""Says where a carrot is that circles the world, and where its tip is."""

import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster


class Carrot(Node):
    def __init__(self):
        super().__init__("carrot")
        self.moving, self.fixed = TransformBroadcaster(self), StaticTransformBroadcaster(self)
        self.fixed.sendTransform(self.transform("carrot", "tip", 1.0, 0.0, 0.0))
        self.steps = 0
        self.timer = self.create_timer(0.1, self.move)

    def transform(self, parent, child, x, y, angle):
        result = TransformStamped()
        result.header.stamp = self.get_clock().now().to_msg()
        result.header.frame_id, result.child_frame_id = parent, child
        result.transform.translation.x, result.transform.translation.y = x, y
        result.transform.rotation.z = math.sin(angle / 2)
        result.transform.rotation.w = math.cos(angle / 2)
        return result

    def move(self):
        angle = self.steps * math.pi / 8
        x, y = 2 * math.cos(angle), 2 * math.sin(angle)
        self.moving.sendTransform(self.transform("world", "carrot", x, y, angle))
        self.steps += 1
        if self.steps == 13:
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Carrot())
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
