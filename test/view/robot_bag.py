"""Bags as the robot records them, made without ROS: any scene, any commands and operations."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

import vibro_ros
from vibro_ros.bag.cdr import blank, serialised
from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.bag.stream import BagStream
from vibro_ros.bag.writer import BagWriter, Storage
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.messages.topics import (
    CHECKPOINT,
    CHECKPOINT_TYPE,
    OPERATIONS,
    OPERATIONS_TYPE,
    ROBOT_TOPICS,
    TF_TOPICS,
)
from vibro_ros.model.scene import Scene
from vibro_ros.recordings.rerun import Rerun, RunFacts
from vibro_ros.simulation.provenance import provenance

START = 1_763_700_000_000_000_000  # ns
KINDS = {**{name: kind for name, kind in ROBOT_TOPICS.items() if name not in TF_TOPICS},
         OPERATIONS: OPERATIONS_TYPE, CHECKPOINT: CHECKPOINT_TYPE}
Told = Mapping[int, Mapping[str, float] | str]
Message = tuple[str, int, bytes]


def robot_bag(folder: Path, scene: Scene | str, ticks: int, told: Told | None = None, rate: float = 200.0,
              checkpoints: tuple[int, ...] = ()) -> Path:
    """Record `ticks` samples; `told` are commands, or the text of an operation, by the number of the sample."""
    scene = vibro_ros.load_scene(scene) if isinstance(scene, str) else scene
    settings = {one.name: one.default for one in DEVICE_PARAMETERS} | {"rate.publish": rate}
    topics = {name: f"/{name}" for name in KINDS}
    facts = RunFacts(settings, scene, START, topics)
    custom = {"scene": scene.name, "topics": json.dumps(topics),
              **provenance({**settings, **scene.parameters}, START)}
    rerun, messages = Rerun(facts, scene), []
    for tick in range(ticks):
        stamp = facts.stamp(tick)
        messages += [(f"/{name}", stamp, data) for name, data in rerun.step()]
        if tick in checkpoints:
            state = blank(CHECKPOINT_TYPE)
            state.data = rerun.device.checkpoint()
            messages.append((f"/{CHECKPOINT}", stamp, serialised(state, CHECKPOINT_TYPE)))
        for name, data in _inputs((told or {}).get(tick, {})):
            messages.append((f"/{name}", stamp, data))
            rerun.receive(name, data)
    written(folder, messages, custom)
    return folder


def _inputs(told: Mapping[str, float] | str) -> list[tuple[str, bytes]]:
    if isinstance(told, str):
        return [(OPERATIONS, _serialised(OPERATIONS_TYPE, told))]
    return [(name, _serialised(ROBOT_TOPICS[name], value)) for name, value in told.items()]


def _serialised(kind: str, data: float | str) -> bytes:
    message = blank(kind)
    message.data = data
    return serialised(message, kind)


def written(folder: Path, messages: list[Message], custom: Mapping[str, str]) -> None:
    """Write a bag of these messages."""
    names = list(KINDS)
    writer = BagWriter(folder, defined([Topic(f"/{name}", KINDS[name], 10) for name in names]), dict(custom),
                       Storage())
    for count, (topic, stamp, data) in enumerate(messages):
        writer.write(1 + names.index(topic[1:]), stamp, bytes(data))
        if count % 2000 == 0:
            writer.flush()
    writer.flush()
    writer.close({"written": str(writer.stored), "dropped": "0", "lost": "0"})


def rewritten(folder: Path, target: Path, changed: Callable[[Message], Message | None] = lambda message: message,
              custom: Mapping[str, str] | None = None) -> Path:
    """The bag again with each message as `changed` gives it, or without it."""
    with BagStream(folder) as stream:
        known = dict(stream.metadata) if custom is None else dict(custom)
        written(target, list(filter(None, map(changed, stream.messages()))), known)
    return target


def offset_times(begin: float, end: float, count: int = 20_000, seed: int = 0) -> np.ndarray:
    """Ascending instants [s] that are no nodes of anything."""
    return np.sort(np.random.default_rng(seed).uniform(begin, end, count))
