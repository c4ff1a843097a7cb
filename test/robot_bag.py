"""Bags as the robot records them, made without ROS, with any scene, commands and operations; and changes of such bags.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

import vibro_ros
from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.bag.recorder import BagWriter, Storage
from vibro_ros.bag.stream import BagStream
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.messages.codec import deserialised, new_message, serialised
from vibro_ros.messages.topics import CHECKPOINT, OPERATIONS, ROBOT_TOPICS, SENSOR_TOPICS, TOPICS
from vibro_ros.model.scene import Scene
from vibro_ros.recordings.rerun import RecordedRun, Rerun
from vibro_ros.sensors.device import sensors_on
from vibro_ros.simulation.provenance import provenance

START = 1_763_700_000_000_000_000  # ns
KINDS = {**{name: kind for name, kind in ROBOT_TOPICS.items() if name not in ("tf", "tf_static")},
         OPERATIONS: TOPICS[OPERATIONS].type, CHECKPOINT: TOPICS[CHECKPOINT].type}
PLAIN = Storage()
Inputs = Mapping[int, Mapping[str, float | bytes] | str]
Message = tuple[str, int, bytes]


def robot_bag(folder: Path, scene: Scene | str, ticks: int, inputs: Inputs | None = None, rate: float = 200.0,
              checkpoints: tuple[int, ...] = (), storage: Storage = PLAIN) -> Path:
    """Record `ticks` samples; `inputs` has commands, or the text of an operation, by the number of the sample."""
    scene = vibro_ros.load_scene(scene) if isinstance(scene, str) else scene
    settings = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS} | {"rate.publish": rate}
    kinds = KINDS | {SENSOR_TOPICS[name]: TOPICS[SENSOR_TOPICS[name]].type for name in sensors_on(scene)}
    topics = {name: f"/{name}" for name in kinds}
    facts = RecordedRun(settings, scene, START, topics)
    custom = {"scene": scene.name, "topics": json.dumps(topics), "dropped": "0", "lost": "0",
              **provenance({**settings, **scene.parameters}, START)}
    rerun, messages = Rerun(facts, scene), []
    for tick in range(ticks):
        stamp = facts.stamp(tick)
        rerun.go_to(tick)
        messages += [(f"/{name}", stamp, data) for name, data in rerun.published()]
        if tick in checkpoints:
            messages.append((f"/{CHECKPOINT}", stamp, holding(TOPICS[CHECKPOINT].type, rerun.device.checkpoint())))
        for name, data in _inputs((inputs or {}).get(tick, {})):
            messages.append((f"/{name}", stamp, data))
            rerun.receive(name, data)
    return _written(folder, [Topic(f"/{name}", kind, 10) for name, kind in kinds.items()], messages,
                    {**custom, "written": str(len(messages))}, storage)


def _inputs(inputs: Mapping[str, float | bytes] | str) -> list[tuple[str, bytes]]:
    if isinstance(inputs, str):
        return [(OPERATIONS, holding(TOPICS[OPERATIONS].type, inputs))]
    return [(name, value if isinstance(value, bytes) else holding(ROBOT_TOPICS[name], value))
            for name, value in inputs.items()]


def holding(kind: str, data: float | str | np.ndarray) -> bytes:
    """Return a serialised message of a type whose `data` is given."""
    message = new_message(kind)
    message.data = data
    return serialised(message, kind)


def rewritten(bag: Path, folder: Path, change: Callable[[list[Message]], Iterable[Message]] = list,
              storage: Storage = PLAIN, known: bool = True, **custom_data: str | None) -> Path:
    """Return the same bag with a changed list of messages, another storage, or other custom data or none."""
    with BagStream(bag) as stream:
        topics = [Topic(name, information.type_name, 10) for name, information in stream.topics.items()]
        custom = {key: text for key, text in (stream.metadata | custom_data).items() if known and text is not None}
        return _written(folder, topics, change(list(stream.messages())), custom, storage)


def edit_each(changed: Callable[[Message], Message | None]) -> Callable[[list[Message]], list[Message]]:
    """Return a change of each message, or its removal."""
    return lambda messages: list(filter(None, map(changed, messages)))


def edit_topic(topic: str, change: Callable[[object], None],
               when: Callable[[int], bool] = lambda stamp: True) -> Callable[[list[Message]], list[Message]]:
    """Return a change of the messages of a topic that were recorded at given stamps [ns]."""
    def of(message: Message) -> Message:
        name, stamp, data = message
        if name == f"/{topic}" and when(stamp):
            content = deserialised(data, ROBOT_TOPICS[topic])
            change(content)
            data = serialised(content, ROBOT_TOPICS[topic])
        return name, stamp, data
    return edit_each(of)


def without_earlier(time: float) -> Callable[[list[Message]], list[Message]]:
    """Return a change that removes all messages before a time [s]."""
    return edit_each(lambda message: message if message[1] >= START + round(time * 1e9) else None)


def without_topics(*topics: str) -> Callable[[list[Message]], list[Message]]:
    """Return a change that removes all messages on some topics."""
    return edit_each(lambda message: None if message[0] in topics else message)


def _written(folder: Path, topics: Sequence[Topic], messages: Iterable[Message], custom: dict[str, str],
             storage: Storage) -> Path:
    writer = BagWriter(folder, defined(topics), custom, storage)
    for count, (topic, stamp, data) in enumerate(messages):
        writer.write(topic, stamp, bytes(data))
        if count % 100 == 0:
            writer.flush()  # a chunk each
    writer.flush()
    writer.close({})
    return folder


def offset_times(begin: float, end: float, count: int = 20_000, seed: int = 0) -> np.ndarray:
    """Return ascending instants [s] that coincide with no sample, step or node."""
    return np.sort(np.random.default_rng(seed).uniform(begin, end, count))
