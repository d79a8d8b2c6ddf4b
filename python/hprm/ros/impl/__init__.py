"""Modules of ``rclpy.impl`` that programs import, mostly for annotations."""
