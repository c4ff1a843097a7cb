"""The robot's bags: what is recorded by the parameters `record.*`, when bags begin and end, and failures."""

import math
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
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
from vibro_ros.process.files import one_line
from vibro_ros.recordings.recover import InUseError, described, recover
from vibro_ros.ros.node.refusals import Throttle
from vibro_ros.ros.robot.publishers import RobotPublishers

SEALING = 5.0
"""Longest time [s] that the answer of `~/record` waits for the disk; commands wait with it."""
CHECKPOINT_PERIOD = 500_000_000
"""Longest robot time [ns] between two checkpoints, about 6 kB each."""
CHECKPOINTS_A_FILE = 4
"""Checkpoints in a file of limited size at least: a robot faster than real time fills several in that time."""
MOST_BAGS = 5
"""Bags that `~/record` begins one right after the other; from then on it begins at most one a second."""
MOST_UNSEALED = 10
"""Unsealed bags that are named at the start; how many more there are is said."""
_ALL = "all"
_TOO_MANY = f"more than {MOST_BAGS} bags were asked for at once; one a second can be begun, ask again"


@dataclass(frozen=True)
class Plan:
    """How the robot records: `topics` under resolved names into bags in `directory`.

    `metadata` is what each bag says of itself. On `checkpoint` a bag that may lack the run's
    beginning has the device's whole state now and then. The robot's namespace is for the folders' names.
    """

    directory: Path
    topics: tuple[RecordedTopic, ...]
    storage: Storage
    metadata: Mapping[str, str]
    checkpoint: RecordedTopic | None = None
    namespace: str = "/"


def plan_recording(settings: Mapping[str, Value], received: Mapping[str, str], publishers: RobotPublishers,
                   about: Mapping[str, str]) -> Plan:
    """How to record, from the parameters `record.*`: the resolved names of `received`, and the topics of `publishers`.

    ValueError for a topic that the robot does not have, and for limits that make no sense.
    """
    storage = Storage(settings["record.compression"], int(settings["record.max_size"]),
                      settings["record.max_duration"], int(settings["record.max_bytes"]))
    topics = {name: recorded_topic(name, resolved) for name, resolved in {**publishers.topics, **received}.items()}
    chosen = _chosen(settings["record.topics"], topics)
    return Plan(Path(settings["record.directory"]).expanduser(), chosen, storage, about)


def recorded_topic(name: str, resolved: str) -> RecordedTopic:
    """One of the robot's topics, by its own name, as a bag has it under its `resolved` name."""
    topic = TOPICS[name]
    return RecordedTopic(resolved, topic.type, topic.quality.depth, topic.quality.transient_local,
                         is_input=name in (*INPUTS, CHECKPOINT))


def check_directory(directory: Path) -> None:
    """Make the folder of recordings if need be (ValueError when nothing can be written there)."""
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

    `record` is for the stepping thread, everything else for the main thread. `faults` says why recordings stopped, in
    order; `latest` is the bag that is being written, or was written last; None when there was none.
    """

    def __init__(self, plan: Plan, log: RcutilsLogger):
        self.faults: list[str] = []
        self._plan = plan
        self._log = log
        self._latched: list[tuple[str, bytes]] = []
        self._names = {topic.name for topic in (*plan.topics, *filter(None, [plan.checkpoint]))}
        self._whole: Recorder | None = None  # the one that holds the run's beginning, whatever comes
        self._checkpointed: Recorder | None = None  # where the last checkpoint is
        self._checkpoint_due = 0
        self._since_checkpoint = 0  # bytes of messages
        self._checkpoint_bytes = plan.storage.file_size / CHECKPOINTS_A_FILE or math.inf
        self._recorder: Recorder | None = None  # the one that messages go to
        self.latest: Recorder | None = None
        self._watched: list[Recorder] = []
        self._dropped = 0
        self._throttle = Throttle(burst=1)
        self._begun = Throttle(burst=MOST_BAGS)

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        for recorder in self._watched:
            recorder.close()
        self.watch()

    @property
    def is_backlogged(self) -> bool:
        """Whether the next messages had better wait, if they can, for the disk to write those before."""
        recorder = self._recorder
        return recorder is not None and recorder.is_backlogged

    @property
    def checkpoint_topic(self) -> str:
        """Resolved name of the topic of checkpoints; empty without any."""
        return self._plan.checkpoint.name if self._plan.checkpoint else ""

    def begin(self) -> None:
        """Record from now on (ValueError, OSError: see `Recorder`)."""
        self._recorder = self._new_bag(whole=not self._plan.storage.max_bytes)
        self._whole = None if self._plan.storage.max_bytes else self._recorder

    def latch(self, latched: Sequence[tuple[str, bytes]]) -> None:
        """Let each file of every bag begin with these, resolved topic name and message; before the first `record`."""
        self._latched = [(topic, data) for topic, data in latched if topic in self._names]
        if self._recorder is not None:
            self._recorder.latch(self._latched)

    def describe(self, custom: Mapping[str, str]) -> None:
        """Add to what each bag says of itself, before the messages that come from now on."""
        self._plan = replace(self._plan, metadata={**self._plan.metadata, **custom})
        if self._recorder is not None:
            self._recorder.describe(custom)

    def record(self, topic: str, stamp: int, data: bytes) -> None:
        """Queue one message for the bag: resolved topic name, ROS time [ns], serialised message. Never blocks."""
        recorder = self._recorder
        if recorder is not None and topic in self._names:
            self._since_checkpoint += len(data)
            recorder.write(topic, stamp, data)

    def checkpoint(self, stamp: int, messages: Callable[[], Iterable[tuple[str, bytes]]]) -> None:
        """Record the device's whole state, `messages` of topics and bytes, if the bag needs it; in the stepping thread.

        So a bag that was begun late, or whose beginning was deleted, can be replayed.
        """
        target = self._recorder
        if self._plan.checkpoint is None or target is None or target is self._whole:
            return
        if (target is not self._checkpointed or stamp >= self._checkpoint_due
                or self._since_checkpoint >= self._checkpoint_bytes):
            self._checkpointed, self._checkpoint_due = target, stamp + CHECKPOINT_PERIOD
            self._since_checkpoint = 0
            for topic, data in messages():
                self.record(topic, stamp, data)

    def switch(self, on: bool) -> tuple[bool, str]:
        """Begin a new bag, or seal the one that is written: what `~/record` asks for.

        Returns
        -------
        bool, str
            Whether it was done; where the bag is, or why not.
        """
        try:
            return self._start() if on else self._stop()
        except (OSError, ValueError) as error:
            return False, str(error)

    def watch(self) -> None:
        """Say what has gone wrong since the last call."""
        for recorder in [recorder for recorder in self._watched if recorder.ended]:
            self._watched.remove(recorder)
            if recorder.fault:
                self.faults.append(recorder.fault)
                self._log.error(f"not recorded: {recorder.fault}. The robot goes on; the service ~/record begins "
                                "another bag")
        dropped = self._recorder.dropped if self._recorder else 0
        # Asked last: one that stops refuses everything.
        if self._recorder and dropped > self._dropped and self._recorder.accepting:
            self._dropped = dropped
            text = self._throttle.admit(f"not recorded: the disk is too slow, {self._dropped} messages dropped")
            if text:
                self._log.error(text)

    def destination(self) -> str:
        """Where the bag is, or why there is none, for people."""
        recorder = self._recorder
        if recorder is None or not recorder.accepting:
            return f"not recording: {recorder.fault}" if recorder and recorder.fault else "not recording"
        return f"recording to {recorder.folder}"

    def summary(self) -> str:
        """Where the last bag is and what is in it, for people."""
        return f"bag {_contents(self.latest)}" if self.latest else "nothing recorded"

    def _start(self) -> tuple[bool, str]:
        if self._recorder and self._recorder.accepting:
            return True, f"already {self.destination()}"
        if not self._begun.admit("a bag"):
            return False, _TOO_MANY
        self._recorder = self._new_bag()
        self._log.info(self.destination())
        return True, self.destination()

    def _stop(self) -> tuple[bool, str]:
        said, recorder, self._recorder = self.destination(), self._recorder, None
        if recorder is None or not recorder.accepting:
            return True, said
        if not recorder.close(SEALING):
            return False, f"{recorder.folder}: the disk does not answer; the bag will be sealed when it does"
        self.watch()
        done = recorder.fault or f"sealed {_contents(recorder)}"
        self._log.info(done)
        return recorder.fault is None, done

    def _new_bag(self, whole: bool = False) -> Recorder:
        checkpoint = [] if whole or self._plan.checkpoint is None else [self._plan.checkpoint]
        for folder in bag_folders(self._plan.directory, datetime.now(), self._plan.namespace):
            with suppress(FileExistsError):  # another bag of this second, or another robot's
                recorder = Recorder(folder, (*self._plan.topics, *checkpoint), self._plan.metadata,
                                    storage=self._plan.storage)
                break
        recorder.latch(self._latched)
        self.latest, self._dropped = recorder, 0
        self._watched.append(recorder)
        return recorder


def open_recording(plan: Plan, enabled: bool, log: RcutilsLogger) -> Recording:
    """A recording, begun if `enabled` (ValueError when the folder cannot be written)."""
    recording = Recording(plan, log)
    try:
        if enabled:
            recording.begin()
    except OSError as error:
        raise ValueError(f"record.directory: {error}") from error
    return recording


def _contents(recorder: Recorder) -> str:
    """Where a bag is and what is in it, for people."""
    lost = f"{recorder.lost} lost, " if recorder.lost else ""
    return f"{recorder.folder}: {recorder.written} messages, {lost}{recorder.dropped} dropped"


def offer_recovery(directory: Path, do_it: bool, log: RcutilsLogger) -> None:
    """Say which bags in `directory` a killed robot has left unsealed, and seal them if `do_it`."""
    unsealed = unsealed_bags(directory, BAG_PATTERN)
    if not do_it:
        for folder in unsealed[:MOST_UNSEALED]:
            name = one_line(folder)
            log.warning(f"{name}: not sealed, its robot was killed; seal it with `recover {name}`")
        if len(unsealed) > MOST_UNSEALED:
            log.warning(f"{directory}: {len(unsealed) - MOST_UNSEALED} more bags are not sealed")
        return
    for folder in unsealed:
        try:
            log.warning("; ".join(described(recover(folder), str)))
        except InUseError:  # of two robots that start at once, the other seals it
            continue
        except BagError as error:
            log.error(str(error))
