"""What the robot records, and how, from its parameters `record.*`."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vibro_ros.bag.recorder import Topic
from vibro_ros.bag.writer import Storage
from vibro_ros.messages.topics import LASTING, OPERATIONS, OPERATIONS_TYPE, ROBOT_TOPICS
from vibro_ros.model.parameters import Value
from vibro_ros.ros.node import qos
from vibro_ros.ros.topics.outputs import PUBLISHED, Outputs

_ALL = "all"


@dataclass(frozen=True)
class Plan:
    """How the robot records.

    Attributes
    ----------
    directory : Path
        Where bags are made.
    topics : tuple of Topic
        What is recorded, under resolved names.
    storage : Storage
        How bags lie on the disk.
    metadata : mapping of str to str
        What each bag says of itself.
    snapshot : float
        Time [s] that is kept in memory until it is asked for; 0 records everything.
    checkpoint : Topic or None
        Where a bag that may lack the run's beginning has the device's whole state now and then.
    namespace : str
        The robot's, for the folders' names.
    """

    directory: Path
    topics: tuple[Topic, ...]
    storage: Storage
    metadata: Mapping[str, str]
    snapshot: float = 0.0
    checkpoint: Topic | None = None
    namespace: str = "/"


def plan_recording(settings: Mapping[str, Value], received: Mapping[str, str], outputs: Outputs,
                   metadata: Mapping[str, str]) -> Plan:
    """How to record, from the device's parameters.

    Parameters
    ----------
    settings : mapping
        The parameters `record.*`.
    received : mapping of str to str
        Resolved names of the topics of `INPUTS`.
    outputs : Outputs
        The robot's other topics; recorded under their resolved names.
    metadata : mapping of str to str
        What each bag says of itself.

    Raises
    ------
    ValueError
        For a topic that the robot does not have, and for limits that make no sense.
    """
    storage = Storage(settings["record.compression"], int(settings["record.max_size"]),
                      settings["record.max_duration"], int(settings["record.max_bytes"]))
    topics = _chosen(settings["record.topics"], {**_published(outputs), **_received(received)})
    return Plan(Path(settings["record.directory"]).expanduser(), topics, storage, metadata, settings["record.snapshot"])


def check_directory(directory: Path) -> None:
    """Make the folder of recordings if need be (ValueError when nothing can be written there)."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=directory).close()
    except OSError as error:
        raise ValueError(f"record.directory: cannot record to {directory}: {error.strerror}; give a folder that can be "
                         "written") from error


def _chosen(names: Sequence[str], topics: Mapping[str, Topic]) -> tuple[Topic, ...]:
    """The topics that are named, by the robot's own names for them or by resolved ones."""
    if not names:
        raise ValueError(f"record.topics: [] names no topic; give [{_ALL}], some of {', '.join(topics)}, or "
                         "record.enabled false to record nothing")
    if _ALL in names:
        return tuple(topics.values())
    by_name = {**{topic.name: topic for topic in topics.values()}, **topics}
    for name in names:
        if name not in by_name:
            raise ValueError(f"record.topics: {name!r} is not a topic of the robot; choose from {', '.join(topics)}, "
                             f"or {_ALL}")
    return tuple(dict.fromkeys(by_name[name] for name in names))


def _published(outputs: Outputs) -> dict[str, Topic]:
    return {topic: Topic(outputs.publishers[topic].topic_name, ROBOT_TOPICS[topic], profile.depth, topic in LASTING)
            for topic, profile in PUBLISHED.items() if topic in outputs.publishers}


def _received(names: Mapping[str, str]) -> dict[str, Topic]:
    types = {**ROBOT_TOPICS, OPERATIONS: OPERATIONS_TYPE}
    return {name: Topic(resolved, types[name], qos.COMMANDS.depth) for name, resolved in names.items()}
