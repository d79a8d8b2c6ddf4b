"""Launch files in XML, as the package ``launch_xml``."""
