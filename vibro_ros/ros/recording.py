"""The robot's bag: which topics, and what the bag says of itself."""

from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path

from rclpy.impl.rcutils_logger import RcutilsLogger

from vibro_ros.bag.recorder import Recorder, Topic, new_bag_folder
from vibro_ros.model.parameters import Value
from vibro_ros.ros import qos
from vibro_ros.ros.inputs import Inputs
from vibro_ros.ros.outputs import TOPICS, Outputs
from vibro_ros.ros.throttle import Throttle


class Recording:
    """The bag of one run, or none; a context manager that seals it.

    Parameters
    ----------
    recorder : Recorder or None
        None records nothing.
    log : logger
        Where lost messages are reported.
    """

    def __init__(self, recorder: Recorder | None, log: RcutilsLogger):
        self._recorder = recorder
        self._log = log
        self._throttle = Throttle(burst=1)

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        if self._recorder:
            self._recorder.close()

    @property
    def fault(self) -> str | None:
        """Why the recording stopped; None while it goes on, or when nothing is recorded."""
        return self._recorder.fault if self._recorder else None

    def record(self, topic: str, stamp: int, data: bytes) -> None:
        """Queue one message for the bag: resolved topic name, ROS time [ns], serialised message. Never blocks."""
        if self._recorder is None or self._recorder.write(topic, stamp, data):
            return
        text = self._throttle.admit(f"not recorded: {self.fault or 'the disk is too slow, messages are dropped'}")
        if text:
            self._log.error(text)

    def destination(self) -> str:
        """Where the bag is, for people."""
        return f"recording to {self._recorder.folder}" if self._recorder else "not recording"

    def summary(self) -> str:
        """Where the bag is and what is in it, for people."""
        if self._recorder is None:
            return "nothing recorded"
        return f"bag {self._recorder.folder}: {self._recorder.written} messages, {self._recorder.dropped} dropped"


def open_recording(settings: Mapping[str, Value], inputs: Inputs, outputs: Outputs, metadata: Mapping[str, str],
                   log: RcutilsLogger) -> Recording:
    """A new bag of everything that is published and received, if `settings` ask for one.

    Parameters
    ----------
    settings : mapping
        `record.enabled` and `record.directory`.
    inputs, outputs : Inputs, Outputs
        The robot's topics; recorded under their resolved names.
    metadata : mapping of str to str
        What the bag says of itself.
    log : logger
        Where lost messages are reported.

    Raises
    ------
    ValueError
        When the folder cannot be written.
    """
    if not settings["record.enabled"]:
        return Recording(None, log)
    folder = new_bag_folder(Path(settings["record.directory"]), datetime.now())
    try:
        return Recording(Recorder(folder, [*_published(outputs), *_received(inputs)], metadata), log)
    except OSError as error:
        raise ValueError(f"record.directory: {error}") from error


def _published(outputs: Outputs) -> Iterator[Topic]:
    for topic, (kind, profile) in TOPICS.items():
        yield Topic(outputs.publishers[topic].topic_name, _type_name(kind), profile.depth)


def _received(inputs: Inputs) -> Iterator[Topic]:
    for subscription in inputs.subscriptions.values():
        yield Topic(subscription.topic_name, _type_name(subscription.msg_type), qos.COMMANDS.depth)


def _type_name(kind: type) -> str:
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
