"""Folders of packages, as in the package ``ament_index_python``."""

from hprm.ros._ament_index_python.packages import PackageNotFoundError as PackageNotFoundError
from hprm.ros._ament_index_python.packages import get_package_prefix as get_package_prefix
from hprm.ros._ament_index_python.packages import (
    get_package_share_directory as get_package_share_directory,
)
from hprm.ros._ament_index_python.packages import (
    get_package_share_path as get_package_share_path,
)
