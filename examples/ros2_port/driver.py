"""A driver with a lifecycle: it measures only while it is active."""

import rclpy
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from std_msgs.msg import Int32


class Driver(LifecycleNode):
    def __init__(self):
        super().__init__("driver")
        # Here, rather than in `on_configure`: what is declared before the start has tags.
        self.publisher = self.create_lifecycle_publisher(Int32, "measured", 10)
        self.timer = None
        self.count = 0

    def on_configure(self, state):
        self.get_logger().info(f"configuring from {state.label}")
        self.timer = self.create_timer(0.1, self.measure)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state):
        self.get_logger().info(f"{self.count} measurements went nowhere")
        return super().on_activate(state)

    def on_cleanup(self, state):
        self.get_logger().info(f"cleaning up after {self.count} measurements")
        self.destroy_timer(self.timer)
        return TransitionCallbackReturn.SUCCESS

    def measure(self):
        self.count += 1
        self.publisher.publish(Int32(data=self.count))


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Driver())
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
