"""The buffer without nodes and the exceptions, as in the package ``tf2_py``."""

from hprm.ros._tf2_ros._core import BufferCore as BufferCore
from hprm.ros._tf2_ros._errors import ConnectivityException as ConnectivityException
from hprm.ros._tf2_ros._errors import ExtrapolationException as ExtrapolationException
from hprm.ros._tf2_ros._errors import InvalidArgumentException as InvalidArgumentException
from hprm.ros._tf2_ros._errors import LookupException as LookupException
from hprm.ros._tf2_ros._errors import TimeoutException as TimeoutException
from hprm.ros._tf2_ros._errors import TransformException as TransformException
