"""Launch files in YAML, as the package ``launch_yaml``."""
