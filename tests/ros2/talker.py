"""Publishes a text twice a second."""

import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.declare_parameter("period", 0.5)
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.timer = self.create_timer(self.get_parameter("period").value, self.talk)
        self.count = 0

    def talk(self):
        self.count += 1
        message = String(data=f"message {self.count}")
        self.get_logger().info(f"sending: {message.data}")
        self.publisher.publish(message)


def main(args=None):
    rclpy.init(args=args)
    node = Talker()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
