"""The exceptions that programs import from rclpy's extension module, and nothing else of it."""

from hprm.ros.exceptions import InvalidHandle as InvalidHandle
from hprm.ros.exceptions import NodeNameNonExistentError as NodeNameNonExistentError
from hprm.ros.exceptions import RCLError as RCLError
from hprm.ros.exceptions import RCLInvalidROSArgsError as RCLInvalidROSArgsError
from hprm.ros.exceptions import UnknownROSArgsError as UnknownROSArgsError
from hprm.ros.exceptions import UnsupportedEventTypeError as UnsupportedEventTypeError
