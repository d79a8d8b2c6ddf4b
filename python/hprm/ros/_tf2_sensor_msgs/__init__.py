"""Transforming clouds of points, as in the package ``tf2_sensor_msgs``.

Importing it registers the function, so that ``Buffer.transform`` takes a ``PointCloud2``.
"""

from hprm.ros._tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud, transform_points

__all__ = ["do_transform_cloud", "transform_points"]
