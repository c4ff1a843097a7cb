"""metadata.yaml held against the files of its bag."""

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

from vibro_ros.bag.metadata import bag_information
from vibro_ros.bag.part import PartContents

_SAID = ("message_count", "starting_time", "duration")


def tells(information: Mapping, contents: Sequence[PartContents]) -> bool:
    """Whether a bag's information tells what its files hold, so that every reader of ROS finds it.

    Parameters
    ----------
    information : mapping
        Of metadata.yaml.
    contents : sequence of PartContents
        Of the files, in the order of time.
    """
    topics = {topic.name: topic for one in contents for topic in one.topics}
    expected = bag_information("", [one.information for one in contents], topics.values(), {})
    try:
        if not _are_names(information["relative_file_paths"], [one.information.name for one in contents]):
            return False
        if expected["message_count"] and any(information[key] != expected[key] for key in _SAID):
            return False
        said = {one["topic_metadata"]["name"]: one for one in information["topics_with_message_count"]}
        return all(_is_topic(said[one["topic_metadata"]["name"]], one)
                   for one in expected["topics_with_message_count"] if one["message_count"])
    except (KeyError, TypeError, AttributeError):
        return False


def _are_names(told: Sequence[str], names: Sequence[str]) -> bool:
    """Whether exactly these files are told, each once; old releases put the bag's own name before it."""
    paths = [PurePosixPath(name) for name in told]
    plain = all(len(path.parts) <= 2 and ".." not in path.parts and not path.is_absolute() for path in paths)
    return plain and sorted(path.name for path in paths) == sorted(names)


def _is_topic(told: Mapping, expected: Mapping) -> bool:
    """Whether a topic is told as it is; rosbags and rosbag2 find no message of one that is not."""
    said, right = told["topic_metadata"], expected["topic_metadata"]
    profiles = said.get("offered_qos_profiles")
    return (told["message_count"] == expected["message_count"] and said["type"] == right["type"]
            and said["serialization_format"] == right["serialization_format"]
            and (not isinstance(profiles, list) or not _is_by_name(profiles) or not
                 _is_by_name(right["offered_qos_profiles"]) or profiles == right["offered_qos_profiles"]))


def _is_by_name(profiles: Sequence[Mapping]) -> bool:
    """Whether profiles name their policies, as from version 9 on; before, they were numbers."""
    return bool(profiles) and all(isinstance(one.get("history"), str) for one in profiles)
