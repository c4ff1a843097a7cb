"""The bags of a run: when they begin, what goes into them, and how they end and fail."""

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from rclpy.impl.rcutils_logger import RcutilsLogger

from vibro_ros.bag.folders import BAG_PATTERN, bag_folders, unsealed_bags
from vibro_ros.bag.metadata import Topic as RecordedTopic
from vibro_ros.bag.recorder import Recorder, Storage
from vibro_ros.bag.stream import BagError
from vibro_ros.messages.topics import CHECKPOINT, INPUTS, TOPICS
from vibro_ros.model.parameters import Value
from vibro_ros.process.files import one_line, user_path
from vibro_ros.recordings.recover import InUseError, recover, recovery_lines
from vibro_ros.ros.node.refusals import Throttle
from vibro_ros.ros.robot.pacing import RobotTime

SEALING = 5.0  # longest wait [s] of `~/record` for the disk before it answers; other services wait meanwhile
CHECKPOINT_PERIOD = 500_000_000  # longest robot time [ns] between two checkpoints, about 6 kB each
CHECKPOINTS_A_FILE = 4
"""Fewest checkpoints in a file of limited size: a robot faster than real time may fill several files in a period."""
MOST_BAGS = 5  # most bags that `~/record` begins in a row; after them it begins at most one a second
MOST_UNSEALED = 10  # most unsealed bags that the log names at the start; the others are counted
_ALL = "all"
_TOO_MANY = f"more than {MOST_BAGS} bags were asked for at once; one a second can be begun, ask again"


@dataclass(frozen=True)
class Plan:
    """How the robot records: `topics`, with their resolved names, into bags in `directory`.

    `metadata` is each bag's custom data. The topic `checkpoint` has the device's whole state at intervals, in bags that
    may lack the run's beginning. The robot's `namespace` becomes part of the folders' names.
    """

    directory: Path
    topics: tuple[RecordedTopic, ...]
    storage: Storage
    metadata: Mapping[str, str]
    checkpoint: RecordedTopic | None = None
    namespace: str = "/"


def plan_recording(settings: Mapping[str, Value], topics: Mapping[str, str], metadata: Mapping[str, str],
                   namespace: str = "/") -> Plan:
    """Return the plan of a recording from the parameters `record.*`; `topics` has the robot's topics by resolved names.

    ValueError for a topic that the robot does not have, and for limits that contradict each other.
    """
    storage = Storage(settings["record.compression"], int(settings["record.max_size"]),
                      settings["record.max_duration"], int(settings["record.max_bytes"]))
    described = {name: recorded_topic(name, resolved) for name, resolved in topics.items()}
    checkpoint = described.pop(CHECKPOINT, None)
    return Plan(user_path(settings["record.directory"]), _chosen(settings["record.topics"], described), storage,
                metadata, checkpoint, namespace)


def recorded_topic(name: str, resolved: str) -> RecordedTopic:
    """Return the description for a bag of the topic `name`, a key of `TOPICS`, under its `resolved` name."""
    topic = TOPICS[name]
    return RecordedTopic(resolved, topic.type, topic.quality.depth, topic.quality.transient_local,
                         is_input=name in (*INPUTS, CHECKPOINT))


def check_directory(directory: Path) -> None:
    """Make the folder of recordings if it is missing (ValueError when it cannot be written to)."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=directory).close()
    except OSError as error:
        raise ValueError(f"record.directory: cannot record to {directory}: {error.strerror}; give a folder that can be "
                         "written") from error


def _chosen(names: Sequence[str], topics: Mapping[str, RecordedTopic]) -> tuple[RecordedTopic, ...]:
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


class Recording:
    """The bags of one run; a context manager that seals the last one.

    `record` and `checkpoint` are for threads that hold the run's lock, all else for the main thread. `faults` are the
    reasons why recordings stopped, in order; `latest` is the bag that is being written, or was written last, or None.
    """

    def __init__(self, plan: Plan, log: RcutilsLogger):
        self.faults: list[str] = []
        self._plan = plan
        self._log = log
        self._latched: list[tuple[str, bytes]] = []
        self._names = {topic.name for topic in (*plan.topics, *filter(None, [plan.checkpoint]))}
        self._complete_bag: Recorder | None = None  # the bag that has the run's beginning and keeps it
        self._checkpointed: Recorder | None = None  # the bag with the last checkpoint
        self._checkpoint_due = 0
        self._since_checkpoint = 0  # bytes of messages since then
        self._checkpoint_bytes = plan.storage.file_size / CHECKPOINTS_A_FILE or math.inf
        self._recorder: Recorder | None = None  # the bag that messages go to
        self.latest: Recorder | None = None
        self._watched: list[Recorder] = []
        self._logged_dropped = 0
        self._log_throttle = Throttle(burst=1)
        self._bag_throttle = Throttle(burst=MOST_BAGS)

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        for recorder in self._watched:
            recorder.close()
        self.watch()

    @property
    def is_backlogged(self) -> bool:
        """Whether a caller that can wait should let the disk catch up before the next messages."""
        recorder = self._recorder
        return recorder is not None and recorder.is_backlogged

    def begin(self) -> None:
        """Record from now on (ValueError when the folder cannot be written)."""
        try:
            self._recorder = self._new_bag(whole=not self._plan.storage.max_bytes)
        except OSError as error:
            raise ValueError(f"record.directory: {error}") from error
        self._complete_bag = None if self._plan.storage.max_bytes else self._recorder

    def announce(self, custom: Mapping[str, str], latched: Sequence[tuple[str, bytes]]) -> None:
        """Add to the custom data of each bag, and begin each file of every bag with the messages `latched`, pairs of
        resolved topic name and bytes; to be called before the first `record`.
        """
        self._plan = replace(self._plan, metadata={**self._plan.metadata, **custom})
        self._latched = [(topic, data) for topic, data in latched if topic in self._names]
        if self._recorder is not None:
            self._recorder.announce(custom, self._latched)

    def record(self, topic: str, stamp: int, data: bytes) -> None:
        """Queue one message for the bag: resolved topic name, ROS time [ns], serialised message. Never blocks."""
        recorder = self._recorder
        if recorder is not None and topic in self._names:
            self._since_checkpoint += len(data)
            recorder.write(topic, stamp, data)

    def checkpoint(self, robot_time: RobotTime, state: Callable[[], bytes]) -> None:
        """Record the device's whole state, if the bag needs it and a checkpoint is due.

        `state` returns the serialised message. With a checkpoint, a bag that was begun late, or whose beginning was
        deleted, can be replayed.
        """
        target = self._recorder
        if self._plan.checkpoint is None or target is None or target is self._complete_bag:
            return
        stamp = robot_time.stamp
        if (target is not self._checkpointed or stamp >= self._checkpoint_due
                or self._since_checkpoint >= self._checkpoint_bytes):
            self._checkpointed, self._checkpoint_due = target, stamp + CHECKPOINT_PERIOD
            self._since_checkpoint = 0
            self.record(self._plan.checkpoint.name, stamp, state())

    def switch(self, on: bool) -> tuple[bool, str]:
        """Begin a new bag if `on`, else seal the present one, as the service `~/record` asks.

        Return whether it was done, and where the bag is, or why it was not done.
        """
        try:
            return self._start() if on else self._stop()
        except (OSError, ValueError) as error:
            return False, str(error)

    def watch(self) -> None:
        """Log recordings that have stopped, and messages that were dropped, since the last call."""
        for recorder in [recorder for recorder in self._watched if recorder.ended]:
            self._watched.remove(recorder)
            if recorder.fault:
                self.faults.append(recorder.fault)
                self._log.error(f"not recorded: {recorder.fault}. The robot goes on; the service ~/record begins "
                                "another bag")
        dropped = self._recorder.dropped if self._recorder else 0
        # `accepting` is read last, because a recorder that stops refuses everything.
        if self._recorder and dropped > self._logged_dropped and self._recorder.accepting:
            self._logged_dropped = dropped
            if text := self._log_throttle.admit(f"not recorded: the disk is too slow, {dropped} messages dropped"):
                self._log.error(text)

    def destination(self) -> str:
        """Return in words where the bag is, or why there is none."""
        recorder = self._recorder
        if recorder is None or not recorder.accepting:
            return f"not recording: {recorder.fault}" if recorder and recorder.fault else "not recording"
        return f"recording to {recorder.folder}"

    def summary(self) -> str:
        """Return in words where the last bag is and what is in it."""
        return f"bag {_contents(self.latest)}" if self.latest else "nothing recorded"

    def _start(self) -> tuple[bool, str]:
        if self._recorder and self._recorder.accepting:
            return True, f"already {self.destination()}"
        if not self._bag_throttle.admit("a bag"):
            return False, _TOO_MANY
        self._recorder = self._new_bag()
        self._log.info(self.destination())
        return True, self.destination()

    def _stop(self) -> tuple[bool, str]:
        words, recorder, self._recorder = self.destination(), self._recorder, None
        if recorder is None or not recorder.accepting:
            return True, words
        if not recorder.close(SEALING):
            return False, f"{recorder.folder}: the disk does not answer; the bag will be sealed when it does"
        self.watch()
        words = recorder.fault or f"sealed {_contents(recorder)}"
        self._log.info(words)
        return recorder.fault is None, words

    def _new_bag(self, whole: bool = False) -> Recorder:
        checkpoint = [] if whole or self._plan.checkpoint is None else [self._plan.checkpoint]
        for folder in bag_folders(self._plan.directory, datetime.now(), self._plan.namespace):
            with suppress(FileExistsError):  # another bag of this second, or another robot's
                recorder = Recorder(folder, (*self._plan.topics, *checkpoint), self._plan.metadata,
                                    storage=self._plan.storage)
                break
        recorder.announce({}, self._latched)
        self.latest, self._logged_dropped = recorder, 0
        self._watched.append(recorder)
        return recorder


def _contents(recorder: Recorder) -> str:
    lost = f"{recorder.lost} lost, " if recorder.lost else ""
    return f"{recorder.folder}: {recorder.written} messages, {lost}{recorder.dropped} dropped"


def handle_unsealed_bags(directory: Path, seal: bool, log: RcutilsLogger) -> None:
    """Log the bags in `directory` that a killed robot has left unsealed, or `seal` them."""
    unsealed = unsealed_bags(directory, BAG_PATTERN)
    if not seal:
        for folder in unsealed[:MOST_UNSEALED]:
            name = one_line(folder)
            log.warning(f"{name}: not sealed, its robot was killed; seal it with `recover {name}`")
        if len(unsealed) > MOST_UNSEALED:
            log.warning(f"{directory}: {len(unsealed) - MOST_UNSEALED} more bags are not sealed")
        return
    for folder in unsealed:
        try:
            log.warning("; ".join(recovery_lines(recover(folder), str)))
        except InUseError:  # of two robots that start at once, the other seals it
            continue
        except BagError as error:
            log.error(str(error))
