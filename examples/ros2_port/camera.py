"""Publishes ten images of 10 MB, in which a bright spot moves."""

import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image

HEIGHT, WIDTH = 1440, 2400


class Camera(Node):
    def __init__(self):
        super().__init__("camera")
        self.count = 0
        self.publisher = self.create_publisher(Image, "image_raw", 2)
        self.timer = self.create_timer(0.1, self.take)

    def take(self):
        pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        pixels[700:740, 200 * self.count : 200 * self.count + 40] = 255
        image = Image(height=HEIGHT, width=WIDTH, encoding="rgb8", step=3 * WIDTH)
        image.header.stamp = self.get_clock().now().to_msg()
        image.header.frame_id = "camera"
        image.data = pixels.reshape(-1)
        self.publisher.publish(image)
        self.count += 1
        if self.count == 10:
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Camera())
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
