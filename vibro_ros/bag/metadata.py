"""Metadata of a bag: metadata.yaml as rosbag2 of Jazzy writes it (version 9), and the descriptions of topics."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from vibro_ros.configuration.strict_yaml import Limits, parse_yaml, read_yaml
from vibro_ros.messages.codec import jazzy_types
from vibro_ros.process.files import replace_file

BAG_VERSION = 9
FILE_NAME = "metadata.yaml"
METADATA_NAME, METADATA_KEY = "rosbag2", "serialized_metadata"
"""Name and key of the record in an MCAP file that holds the bag's metadata as text."""
LIMITS = Limits(size=8 * 2**20, values=250_000)
"""Limits of metadata.yaml, which lists each file of a bag: enough for 20 thousand files."""
LABEL_LIMITS = Limits(size=50_000, values=2000, depth=8)
"""Limits of the QoS profiles of a topic; the profile of one publisher has about 20 values."""

LAST_STAMP = 2**63 - 2
"""Largest recorded stamp [ns]: rosbag2 has signed 64-bit stamps, and rosbags reserves the largest."""

_FOREVER = {"sec": 9223372036, "nsec": 854775807}  # how ROS writes "no deadline"


@dataclass(frozen=True)
class Topic:
    """A topic to record."""

    name: str  # fully resolved name, such as ``/odom``
    type_name: str  # ROS type, such as ``nav_msgs/msg/Odometry``; any type of ROS 2 Jazzy's common interfaces
    qos_depth: int  # history depth that the publisher offers
    transient_local: bool = False  # whether late subscribers get what was published before (transient local)
    # whether the topic is an input of the run: its messages are still recorded when others are dropped, because a
    # replay cannot compute them
    is_input: bool = False


@dataclass(frozen=True)
class TopicInformation:
    """Description of a topic in a bag.

    `qos` has the offered QoS profiles, as rosbag2 writes them; `type_hash` is the RIHS01 hash of the type, empty when
    unknown; `encoding` is the serialisation, always CDR.
    """

    name: str
    type_name: str
    qos: list[dict]
    type_hash: str
    encoding: str = "cdr"


@dataclass(frozen=True)
class FileInformation:
    """Description of a file of a bag: name, stamps of first and last message [ns] (0 if empty), messages by topic."""

    name: str
    first: int
    last: int
    counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())


def defined(topics: Sequence[Topic]) -> list[TopicInformation]:
    """Return the descriptions of topics to record (ValueError for an unknown type or a topic given twice)."""
    names = [topic.name for topic in topics]
    for topic in topics:
        if topic.type_name not in jazzy_types().fielddefs:
            raise ValueError(f"{topic.name}: unknown message type {topic.type_name!r}; give one of ROS 2 Jazzy's")
        if names.count(topic.name) > 1:
            raise ValueError(f"{topic.name}: given twice; a topic is recorded once")
    return [TopicInformation(topic.name, topic.type_name, [_offered_qos(topic)],
                             jazzy_types().hash_rihs01(topic.type_name)) for topic in topics]


def _offered_qos(topic: Topic) -> dict:
    return {"history": "keep_last", "depth": topic.qos_depth, "reliability": "reliable",
            "durability": "transient_local" if topic.transient_local else "volatile",
            "deadline": dict(_FOREVER), "lifespan": dict(_FOREVER), "liveliness": "automatic",
            "liveliness_lease_duration": dict(_FOREVER), "avoid_ros_namespace_conventions": False}


def definition_text(type_name: str) -> str:
    """Return a message definition in the format of MCAP files (ros2msg)."""
    return jazzy_types().generate_msgdef(type_name, ros_version=2)[0]


def channel_metadata(topic: TopicInformation) -> dict[str, str]:
    """Return the metadata that rosbag2 writes to a topic's channel."""
    return {"offered_qos_profiles": as_text(topic.qos).strip(), "topic_type_hash": topic.type_hash}


def bag_information(files: Sequence[FileInformation], topics: Iterable[TopicInformation],
                    custom: Mapping[str, str]) -> dict:
    """Return the content of metadata.yaml: the files in time order, and all topics, even those without messages."""
    filled = [file for file in files if file.messages]
    first = min((file.first for file in filled), default=0)
    last = max((file.last for file in filled), default=0)
    return {
        "version": BAG_VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": last - first},
        "starting_time": {"nanoseconds_since_epoch": first},
        "message_count": sum(file.messages for file in files),
        "topics_with_message_count": [
            {"topic_metadata": {"name": topic.name, "type": topic.type_name, "serialization_format": topic.encoding,
                                "offered_qos_profiles": topic.qos, "type_description_hash": topic.type_hash},
             "message_count": sum(file.counts.get(topic.name, 0) for file in files)} for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, "starting_time": {"nanoseconds_since_epoch": file.first},
                   "duration": {"nanoseconds": file.last - file.first}, "message_count": file.messages}
                  for file in files],
        "custom_data": dict(custom) or None,
        "ros_distro": "jazzy",
    }


def as_text(information: object) -> str:
    """Return dicts, lists, texts and numbers as YAML."""
    return yaml.dump(information, Dumper=_Dumper, sort_keys=False, allow_unicode=True)


def write_metadata(file: Path, information: dict) -> None:
    """Write a metadata.yaml, whole or not at all (OSError)."""
    replace_file(file, as_text({"rosbag2_bagfile_information": information}).encode())


def read_metadata(folder: Path) -> dict:
    """Read metadata.yaml of a bag folder (ValueError when it cannot be read, or is of a later version)."""
    document = read_yaml(folder / FILE_NAME, LIMITS, follow=False)
    information = document.get("rosbag2_bagfile_information") if isinstance(document, dict) else None
    if not isinstance(information, dict):
        raise ValueError(f"{FILE_NAME}: has no rosbag2_bagfile_information")
    version = information.get("version")
    if not isinstance(version, int) or not 0 < version <= BAG_VERSION:
        raise ValueError(f"{FILE_NAME}: is of version {version}, and {BAG_VERSION} is the last one known here")
    return information


def custom_data(text: str) -> dict[str, str]:
    """Return the custom data in the text of a bag's metadata; empty when there are none."""
    try:
        information = parse_yaml(text, LIMITS)
    except ValueError:
        return {}
    return custom_of(information) if isinstance(information, dict) else {}


def custom_of(information: Mapping[str, object]) -> dict[str, str]:
    """Return the custom data in a bag's metadata, as texts by name; empty when there are none."""
    custom = information.get("custom_data")
    return {str(key): str(value) for key, value in custom.items()} if isinstance(custom, dict) else {}


def qos_profiles(text: str) -> list[dict]:
    """Return the QoS profiles in the text of a channel's metadata; empty when it cannot be read."""
    try:
        profiles = parse_yaml(text, LABEL_LIMITS) if len(text) <= LABEL_LIMITS.size else None
    except ValueError:
        return []
    return [profile for profile in profiles if isinstance(profile, dict)] if isinstance(profiles, list) else []


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    def ignore_aliases(self, data: object) -> bool:
        """Return True, so that equal parts are written out: yaml-cpp reads anchors, but people do not."""
        return True
