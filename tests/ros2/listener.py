"""Shows texts, and ends after the fifth."""

import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Listener(Node):
    def __init__(self):
        super().__init__("listener")
        self.count = 0
        self.subscription = self.create_subscription(String, "chatter", self.hear, 10)

    def hear(self, message):
        self.count += 1
        self.get_logger().info(f"heard: {message.data}")
        if self.count == 5:
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    node = Listener()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, SystemExit):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
