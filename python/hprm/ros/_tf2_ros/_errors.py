"""The exceptions of transforms, as in ``tf2_py``."""


class TransformException(Exception):
    """What all exceptions of transforms have in common."""


class ConnectivityException(TransformException):
    """Two frames are in trees that are not connected."""


class LookupException(TransformException):
    """A frame does not exist, or the frames are no tree."""


class ExtrapolationException(TransformException):
    """There are no data for the requested time."""


class InvalidArgumentException(TransformException):
    """An argument cannot be: an empty name, or one with a slash in front."""


class TimeoutException(TransformException):
    """A transform did not become known in time."""
