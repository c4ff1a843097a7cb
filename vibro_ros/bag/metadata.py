"""metadata.yaml of a bag folder, as rosbag2 of Jazzy writes it (version 9)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

BAG_VERSION = 9
FILE_NAME = "metadata.yaml"

_FOREVER = {"sec": 9223372036, "nsec": 854775807}  # how ROS writes "no deadline"


@dataclass(frozen=True)
class TopicInformation:
    """What a bag says of a topic.

    Attributes
    ----------
    name, type_name : str
        Full name and ROS type.
    qos : list of dict
        Offered QoS profiles, as rosbag2 writes them.
    type_hash : str
        RIHS01 hash of the type; empty when unknown.
    encoding : str
        Serialisation; ROS 2 has one.
    """

    name: str
    type_name: str
    qos: list[dict]
    type_hash: str
    encoding: str = "cdr"


@dataclass(frozen=True)
class FileInformation:
    """One file of a bag: its name, times of the first and last message [ns] (0 when empty), messages by topic."""

    name: str
    first: int
    last: int
    counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())


def reliable_qos(depth: int) -> dict:
    """The QoS profile that the robot offers: reliable, volatile, the last `depth` messages kept."""
    return {"history": "keep_last", "depth": depth, "reliability": "reliable", "durability": "volatile",
            "deadline": dict(_FOREVER), "lifespan": dict(_FOREVER), "liveliness": "automatic",
            "liveliness_lease_duration": dict(_FOREVER), "avoid_ros_namespace_conventions": False}


def bag_information(storage: str, files: Sequence[FileInformation], topics: Iterable[TopicInformation],
                    custom: Mapping[str, str]) -> dict:
    """What metadata.yaml tells of a bag, its files in the order of time.

    Parameters
    ----------
    storage : str
        ``mcap`` or ``sqlite3``.
    files : sequence of FileInformation
        In the order of time.
    topics : iterable of TopicInformation
        Every topic, those without messages too.
    custom : mapping of str to str
        The bag's custom data.
    """
    filled = [file for file in files if file.messages]
    first = min((file.first for file in filled), default=0)
    last = max((file.last for file in filled), default=0)
    return {
        "version": BAG_VERSION,
        "storage_identifier": storage,
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


def as_text(information: Mapping[str, object]) -> str:
    """YAML of anything made of dicts, lists, texts and numbers."""
    return yaml.dump(information, Dumper=_Dumper, sort_keys=False, allow_unicode=True)


def write_metadata(folder: Path, information: dict) -> None:
    """Write metadata.yaml into a bag folder, whole or not at all (OSError)."""
    file = folder / FILE_NAME
    fresh = file.with_suffix(".yaml.tmp")
    try:
        fresh.write_text(as_text({"rosbag2_bagfile_information": information}), encoding="utf-8")
        fresh.replace(file)
    except OSError:
        fresh.unlink(missing_ok=True)
        raise


def read_metadata(folder: Path) -> dict | None:
    """What metadata.yaml of a bag folder tells; None when it is missing or cannot be understood."""
    try:
        content = yaml.load((folder / FILE_NAME).read_text(encoding="utf-8"), Loader=_Loader)
        information = content["rosbag2_bagfile_information"]
        return information if isinstance(information, dict) else None
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError):
        return None


def custom_data(text: str) -> dict[str, str]:
    """The custom data of metadata as text, as files keep it inside; empty when there are none."""
    try:
        found = yaml.load(text, Loader=_Loader)["custom_data"]
    except (ValueError, TypeError, KeyError, yaml.YAMLError):
        return {}
    return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}


def qos_profiles(text: str) -> list[dict]:
    """The QoS profiles of a channel's label; none when they cannot be understood."""
    try:
        found = yaml.load(text, Loader=_Loader)
    except yaml.YAMLError:
        return []
    return found if isinstance(found, list) else []


_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):
    def ignore_aliases(self, data: object) -> bool:
        """Write equal parts out: yaml-cpp reads anchors, but people do not."""
        return True
