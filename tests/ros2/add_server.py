"""Adds two integers for its clients."""

import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node


class AddServer(Node):
    def __init__(self):
        super().__init__("add_server")
        self.service = self.create_service(AddTwoInts, "add_two_ints", self.add)

    def add(self, request, response):
        response.sum = request.a + request.b
        self.get_logger().info(f"{request.a} + {request.b} = {response.sum}")
        return response


def main(args=None):
    rclpy.init(args=args)
    node = AddServer()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
