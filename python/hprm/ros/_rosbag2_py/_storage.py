"""What programs say of bags, and are told, in the terms of ``rosbag2_py``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any


@dataclass
class StorageOptions:
    """Which bag, and its format; what else there is in ROS must have its default value."""

    uri: str
    storage_id: str = ""
    max_bagfile_size: int = 0
    max_bagfile_duration: int = 0
    max_cache_size: int = 0
    storage_preset_profile: str = ""
    storage_config_uri: str = ""
    snapshot_mode: bool = False
    start_time_ns: int = -1
    end_time_ns: int = -1
    custom_data: dict[str, str] = field(default_factory=dict)

    def refuse_others(self) -> None:
        """Raise ``RuntimeError`` if there is an option that has no meaning here."""
        known = StorageOptions(self.uri, self.storage_id, max_cache_size=self.max_cache_size)
        for name, value in vars(known).items():
            if getattr(self, name) != value:
                raise RuntimeError(f"hprm.ros has no StorageOptions.{name}; leave it out")


@dataclass
class ConverterOptions:
    """Formats of messages: always CDR."""

    input_serialization_format: str = ""
    output_serialization_format: str = ""

    def refuse_others(self) -> None:
        """Raise ``RuntimeError`` for another format."""
        for name, value in vars(self).items():
            if value not in ("", "cdr"):
                raise RuntimeError(f"{name} is cdr, not {value!r}")


@dataclass
class StorageFilter:
    """Which topics are read: all if neither names nor an expression are stated, without some."""

    topics: list[str] = field(default_factory=list)
    regex: str = ""
    exclude_topics: list[str] = field(default_factory=list)
    regex_to_exclude: str = ""
    #: What ``regex`` is called in Humble.
    topics_regex: str = ""

    def passes(self, topic: str) -> bool:
        """Tell whether a topic is read."""
        pattern = self.regex or self.topics_regex
        if topic in self.exclude_topics or _matches(self.regex_to_exclude, topic):
            return False
        is_all = not self.topics and not pattern
        return is_all or topic in self.topics or _matches(pattern, topic)


def _matches(pattern: str, topic: str) -> bool:
    return bool(pattern and re.fullmatch(pattern, topic))


def get_default_storage_id() -> str:
    """Return the format of bags that are written if nothing else is said."""
    return "mcap"


class TopicMetadata:
    """A topic of a bag: its name, its type, and the format of its messages."""

    def __init__(
        self,
        id: int = 0,
        name: str = "",
        type: str = "",
        serialization_format: str = "cdr",
        offered_qos_profiles: Any = "",
        type_description_hash: str = "",
    ) -> None:
        """Describe a topic. Humble has no ``id``: there, all arguments are given by name."""
        self.id = id
        self.name = name
        self.type = type
        self.serialization_format = serialization_format
        self.offered_qos_profiles = offered_qos_profiles
        self.type_description_hash = type_description_hash

    def equals(self, other: TopicMetadata) -> bool:
        """Tell whether another one describes the same topic."""
        return vars(self) == vars(other)

    def __repr__(self) -> str:
        return f"TopicMetadata(name={self.name!r}, type={self.type!r})"


@dataclass
class TopicInformation:
    """A topic, and how many messages of it there are."""

    topic_metadata: TopicMetadata
    message_count: int


@dataclass
class BagMetadata:
    """What a bag has in it."""

    storage_identifier: str
    bag_size: int
    relative_file_paths: list[str]
    starting_time: datetime
    duration: timedelta
    message_count: int
    topics_with_message_count: list[TopicInformation]
