"""A lamp whose brightness is a parameter, which another program sets."""

import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node


class Dimmer(Node):
    def __init__(self):
        super().__init__("dimmer")
        steps = FloatingPointRange(from_value=0.0, to_value=1.0, step=0.0)
        described = ParameterDescriptor(floating_point_range=[steps])
        self.declare_parameter("brightness", 0.5, described)
        self.declare_parameter("colour", "white")
        self.add_on_set_parameters_callback(self.judge)
        self.timer = self.create_timer(0.5, self.show)
        self.shown = 0

    def judge(self, parameters):
        for parameter in parameters:
            if parameter.name == "colour" and parameter.value not in ("white", "red"):
                return SetParametersResult(successful=False, reason="no such lamp")
        return SetParametersResult(successful=True)

    def show(self):
        brightness = self.get_parameter("brightness").value
        colour = self.get_parameter("colour").value
        print(f"{colour} at {brightness}", flush=True)
        self.shown += 1
        if self.shown == 4:
            raise SystemExit


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Dimmer())
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
