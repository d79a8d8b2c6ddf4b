"""What programs take from rclpy's extension module by its other name."""

from hprm.ros import _rclpy_pybind11 as rclpy_implementation

__all__ = ["rclpy_implementation"]
