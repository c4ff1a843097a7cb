"""A function's application to one item: what it gave, or what prevented it."""

from collections.abc import Callable
from typing import Any


class Job:
    """A job that is to be done.

    Attributes
    ----------
    item : object
        What the function is applied to.
    result : object
        What it returned.
    error : Exception or None
        What it raised instead.
    done : bool
        Whether it is over.
    size : int
        Bytes that its result took on its way from another process.
    """

    def __init__(self, item: Any):
        self.item, self.done, self.size = item, False, 0
        self.result: Any = None
        self.error: Exception | None = None

    def do(self, function: Callable) -> None:
        """Apply `function` to the item."""
        try:
            self.end(function(self.item), None)
        except Exception as error:
            self.end(None, error)

    def outcome(self) -> object:
        """Return the result, or raise the error."""
        if self.error is not None:
            raise self.error
        return self.result

    def end(self, result: object, error: Exception | None, size: int = 0) -> None:
        """Take in what came of it."""
        self.result, self.error, self.size, self.done = result, error, size, True
