"""Stands for the package of ROS 2 with messages of sensors."""
