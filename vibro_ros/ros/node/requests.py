"""What other threads ask of the stepping thread, and how they learn what came of it."""

from collections.abc import Callable
from concurrent.futures import Future

from vibro_ros.messages.operations import Operation


class Request(Future):
    """An operation that was asked for: a future of the words that answer it; ValueError where it is refused.

    Parameters
    ----------
    operation : Operation
        What is asked.
    counted : callable, optional
        Given the number of samples of a `step` so far, after each one, by the thread that takes them.

    Attributes
    ----------
    completed : int
        Samples that a `step` has taken so far.
    given_up : bool
        Whether the asker wants no more of them.
    """

    def __init__(self, operation: Operation, counted: Callable[[int], object] | None = None):
        super().__init__()
        self.operation = operation
        self.completed = 0
        self.given_up = False
        self._counted = counted

    def count(self) -> None:
        """Take note that another sample is out."""
        self.completed += 1
        if self._counted:
            self._counted(self.completed)

    def give_up(self) -> None:
        """Ask for no more samples; the answer says how many there were."""
        self.given_up = True
