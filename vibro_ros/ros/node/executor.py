"""An executor that goes on, whatever a callback raises."""

from typing import Any

from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException

from vibro_ros.ros.node.refusals import Refusals


class SteadyExecutor(SingleThreadedExecutor):
    """Runs callbacks in the caller's thread, and counts and says what they raise instead of raising it.

    KeyboardInterrupt, and the end of ROS while waiting, are raised as ever.

    Parameters
    ----------
    refusals : Refusals
        Counts and says.
    """

    def __init__(self, refusals: Refusals):
        super().__init__()
        self._refusals = refusals

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait up to `timeout_sec` [s] for one callback, and run it."""
        try:
            task, entity, _ = self.wait_for_ready_callbacks(timeout_sec=timeout_sec)
        except (ShutdownException, TimeoutException):
            return
        task()
        if error := task.exception():
            if entity:
                _release(entity)
            self._refusals.catch(_name_of(entity), error)


def _release(entity: Any) -> None:
    """Let `entity` and its callback group run again: an error while a message is taken leaves both marked as busy."""
    entity._executor_event = False
    if not entity.callback_group.can_execute(entity):
        entity.callback_group.ending_execution(entity)


def _name_of(entity: Any) -> str:
    """The topic or service of an entity; else what it is, such as Timer."""
    kind = type(entity).__name__ if entity else "task"
    return getattr(entity, "topic_name", None) or getattr(entity, "service_name", None) or kind
