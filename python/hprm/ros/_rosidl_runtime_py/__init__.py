"""Messages as dicts and YAML, and classes by name: what ``rosidl_runtime_py`` has for programs."""

from hprm.ros._rosidl_runtime_py.convert import message_to_ordereddict, message_to_yaml
from hprm.ros._rosidl_runtime_py.set_message import set_message_fields

__all__ = ["message_to_ordereddict", "message_to_yaml", "set_message_fields"]
