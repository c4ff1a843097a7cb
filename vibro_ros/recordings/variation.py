"""What a recorded robot would have done with other parameters: the same commands at the same instants, a new bag."""

import json
from collections.abc import Iterator, Mapping
from itertools import count
from pathlib import Path

from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.bag.stream import QOS_DEPTH, BagError, BagStream
from vibro_ros.bag.writer import BagWriter, Storage
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.messages.topics import COMMAND_UNITS, INPUTS, LASTING, OPERATIONS, OPERATIONS_TYPE, ROBOT_TOPICS
from vibro_ros.model.scene import Scene
from vibro_ros.recordings.rerun import SAMPLED, Rerun, RunFacts, most_ticks, run_facts, ticks
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.provenance import provenance

FLUSH_MESSAGES = 2000  # between two looks at the disk; a chunk of MCAP is written earlier when it is full

_TYPES = {**ROBOT_TOPICS, OPERATIONS: OPERATIONS_TYPE}


def write_variation(bag: Path, changes: Mapping[str, object]) -> tuple[Path, str]:
    """Simulate a recorded run with `changes` of its scene, from its start to its last message, into a new bag.

    Parameters
    ----------
    bag : Path
        The recording; nothing is ever written into it.
    changes : mapping of str to value
        Parameters of the scene.

    Returns
    -------
    folder : Path
        ``<bag>_replay`` beside the recording, with ``_2``, ``_3``, … where taken.
    failure : str
        Why the simulation could not go on to the end; empty when it could.

    Raises
    ------
    BagError
        When the recording cannot be read, or does not say what was simulated.
    ValueError
        For a bad change.
    OSError
        When the new bag cannot be written.
    """
    _check_of_scene(changes)
    with BagStream(bag) as stream:
        facts = run_facts(stream)
        if stream.start > facts.start:
            raise BagError(f"{bag}: begins {(stream.start - facts.start) * 1e-9:.3f} s after the robot started, and "
                           "what another would have done until then is unknown; give a bag of the run's beginning")
        rerun = Rerun(facts, facts.scene.with_parameters(changes))
        topics = _topics(stream, facts)
        writer = BagWriter(_new_folder(bag), defined([*topics.values()]),
                           _metadata(stream, facts, rerun.scene, changes), Storage())
        numbers = {name: number for number, name in enumerate(topics, start=1)}
        writer.begin_files_with([(numbers[name], data) for name, data in rerun.lasting.items() if name in numbers])
        try:
            return writer.folder, _write(writer, numbers, _messages(stream, facts, rerun))
        finally:
            writer.flush()
            writer.close({"written": str(writer.stored), "dropped": "0", "lost": "0"})


def _check_of_scene(changes: Mapping[str, object]) -> None:
    """Refuse parameters of the node: when commands took effect is counted in samples of the recorded rate."""
    of_node = {parameter.name for parameter in DEVICE_PARAMETERS}
    for name, value in changes.items():
        if name in of_node:
            raise ValueError(f"{name}={value}: is a parameter of the node, which the recording fixes; change one of "
                             f"the scene, such as guide.angle=1.2, or record again with -p {name}:={value}")


def _write(writer: BagWriter, numbers: Mapping[str, int], messages: Iterator[tuple[int, str, bytes]]) -> str:
    """Write every message; why the simulation could not go on, or nothing."""
    try:
        for written, (stamp, name, data) in enumerate(messages):
            writer.write(numbers[name], stamp, data)
            if written % FLUSH_MESSAGES == 0:
                writer.flush()
    except SimulationError as error:
        return str(error)
    return ""


def _topics(stream: BagStream, facts: RunFacts) -> dict[str, Topic]:
    """Every topic that the recorded robot had, under the recorded names; an earlier version had fewer."""
    names = facts.topics
    if missing := [name for name in (*SAMPLED, "impacts", *COMMAND_UNITS) if name not in names]:
        raise BagError(f"{stream.folder}: says nothing of the topics {', '.join(missing)}; give a bag that the robot "
                       "recorded itself")
    depths = {topic: one.qos_depth for topic, one in stream.topics.items()}
    return {name: Topic(names[name], kind, depths.get(names[name], QOS_DEPTH), name in LASTING)
            for name, kind in _TYPES.items() if name in names}  # a bag of an earlier version has fewer


def _messages(stream: BagStream, facts: RunFacts, rerun: Rerun) -> Iterator[tuple[int, str, bytes]]:
    """Recorded stamp [ns], the robot's own name of the topic, and message, of all that the changed robot records."""
    most = most_ticks(stream, facts)
    for stamp, group in ticks(stream, facts):
        tick = facts.tick(stamp)
        if tick is None or tick <= rerun.tick:
            raise BagError(f"{stream.folder}: its stamp {stamp} is of no sample; give a bag that the robot recorded")
        if tick > most:
            raise BagError(f"{stream.folder}: its stamp {stamp} is that of sample {tick}, and its messages are of "
                           f"{most} samples at most; give a bag with the robot's own stamps")
        while rerun.tick < tick:
            for name, data in rerun.step():
                yield facts.stamp(rerun.tick), name, data
        for name, data in group:
            if name in INPUTS:
                yield stamp, name, data
                rerun.receive(name, data)


def _metadata(stream: BagStream, facts: RunFacts, scene: Scene, changes: Mapping[str, object]) -> dict[str, str]:
    return {"scene": scene.name, "topics": json.dumps(facts.topics),
            **provenance({**facts.settings, **scene.parameters}, facts.start),
            "replay_of": stream.folder.resolve().name, "changes": json.dumps(dict(changes))}


def _new_folder(bag: Path) -> Path:
    bag = bag.resolve()
    folder, suffixes = bag.with_name(f"{bag.name}_replay"), count(2)
    while folder.exists() or folder.is_symlink():
        folder = bag.with_name(f"{bag.name}_replay_{next(suffixes)}")
    return folder
