"""Where launch files in YAML come from, as in ``launch_yaml.launch_description_sources``."""

from hprm.ros._launch.launch_description_sources import FrontendLaunchDescriptionSource


class YAMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """A launch file in YAML."""
