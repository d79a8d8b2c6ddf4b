"""Where launch files in XML come from, as in ``launch_xml.launch_description_sources``."""

from hprm.ros._launch.launch_description_sources import FrontendLaunchDescriptionSource


class XMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """A launch file in XML."""
