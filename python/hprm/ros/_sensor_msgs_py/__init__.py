"""Point clouds as arrays: what ``sensor_msgs_py`` has for programs."""
