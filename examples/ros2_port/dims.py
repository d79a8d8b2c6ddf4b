"""Sets parameters of the lamp, of which it refuses one."""

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter


class Dims(Node):
    def __init__(self):
        super().__init__("dims")
        self.client = self.create_client(SetParameters, "/dimmer/set_parameters")
        self.client.wait_for_service()
        self.wanted = [
            Parameter("brightness", value=0.25),
            Parameter("colour", value="green"),
            Parameter("colour", value="red"),
        ]
        self.timer = self.create_timer(0.6, self.set_next)

    def set_next(self):
        wanted = [self.wanted.pop(0).to_parameter_msg()]
        self.client.call_async(SetParameters.Request(parameters=wanted))
        if not self.wanted:
            self.timer.cancel()


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Dims())
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
