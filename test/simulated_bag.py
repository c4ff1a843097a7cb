"""A small bag as the robot records it, made without ROS: `replay` finds it identical."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from vibro_ros.bag.cdr import blank, serialised
from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.bag.stream import BagStream
from vibro_ros.bag.writer import BagWriter, Storage
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS, load_scene
from vibro_ros.messages.topics import CHECKPOINT, CHECKPOINT_TYPE, COMMAND_UNITS, ROBOT_TOPICS, TF_TOPICS
from vibro_ros.recordings.rerun import Rerun, RunFacts
from vibro_ros.simulation.provenance import provenance

START = 1_763_700_000_000_000_000  # ns
TICKS = 120
FLUSHES = 10  # ticks between two; a chunk each


def simulated_bag(folder: Path, storage: Storage, hostile: bytes = b"") -> int:
    """Record 120 samples with some commands, `hostile` among them if given, into `folder`; the number of messages."""
    scene = load_scene("device")
    settings = {one.name: one.default for one in DEVICE_PARAMETERS} | {"rate.publish": 50.0}
    kinds = {name: kind for name, kind in ROBOT_TOPICS.items() if name not in TF_TOPICS}  # it is to be small
    topics = {name: f"/{name}" for name in kinds}
    facts = RunFacts(settings, scene, START, topics)
    custom = {"scene": "device", "topics": json.dumps(topics), **provenance({**settings, **scene.parameters}, START)}
    writer = BagWriter(folder, defined([Topic(topics[name], kind, 10) for name, kind in kinds.items()]), custom,
                       storage)
    numbers = {name: number for number, name in enumerate(kinds, start=1)}
    rerun = Rerun(facts, scene)
    for tick in range(TICKS):
        stamp = facts.stamp(tick)
        for name, data in rerun.step():
            writer.write(numbers[name], stamp, data)
        for name, data in _commands(tick, hostile):
            writer.write(numbers[name], stamp, data)
            rerun.receive(name, data)
        if tick % FLUSHES == 0:
            writer.flush()
    writer.flush()
    written = writer.stored
    writer.close({"written": str(written), "dropped": "0", "lost": "0"})
    return written


def _commands(tick: int, hostile: bytes) -> list[tuple[str, bytes]]:
    if tick % 20 != 10:
        return []
    message = blank("std_msgs/msg/Float64")
    message.data = 60.0 + tick
    good = ("motor_speed", serialised(message, "std_msgs/msg/Float64"))
    return [good, *((name, hostile) for name in COMMAND_UNITS if hostile)]


def rewritten(folder: Path, target: Path, changed: Callable[[str, int, bytes], tuple | None] | None = None,
              custom: Mapping[str, str] | None = None, extra: Sequence[tuple[str, int, bytes]] = (),
              storage: Storage | None = None) -> Path:
    """A bag again, each message as `changed` gives it, or left out; `extra` messages on the checkpoint's topic."""
    with BagStream(folder) as stream:
        own = {**stream.metadata, **(custom or {})}
        names = {name: one.type_name for name, one in stream.topics.items()}
        if extra:
            names[f"/{CHECKPOINT}"] = CHECKPOINT_TYPE
            own["topics"] = json.dumps(json.loads(own["topics"]) | {CHECKPOINT: f"/{CHECKPOINT}"})
        writer = BagWriter(target, defined([Topic(name, kind, 10) for name, kind in names.items()]), own,
                           storage or Storage())
        messages = [changed(*message) if changed else message for message in stream.messages()]
        for topic, stamp, data in sorted([*filter(None, messages), *extra], key=lambda message: message[1]):
            writer.write(1 + list(names).index(topic), stamp, bytes(data))
        writer.flush()
        writer.close({})
    return target
