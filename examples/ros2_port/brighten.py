"""Makes images half as bright, and passes them on."""

import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image


class Brighten(Node):
    def __init__(self):
        super().__init__("brighten")
        self.declare_parameter("gain", 0.5)
        self.gain = self.get_parameter("gain").value
        self.publisher = self.create_publisher(Image, "image", 2)
        self.subscription = self.create_subscription(Image, "image_raw", self.change, 2)

    def change(self, image):
        pixels = np.frombuffer(image.data, np.uint8)
        result = Image(height=image.height, width=image.width, encoding="rgb8", step=image.step)
        result.header = image.header
        result.data = (pixels * self.gain).astype(np.uint8)
        self.publisher.publish(result)


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Brighten())
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
