"""The pieces that the runs of a study are cut into: each is computed by whoever gets it, with the same numbers."""

from collections.abc import Iterator, Sized
from dataclasses import dataclass
from typing import Protocol, TypeVar

from vibro_ros.model.parameters import Value

#: Most rows of a piece: all of the same machine, whose equations are compiled once.
PIECE = 16

Result = TypeVar("Result", bound=Sized)
ResultOf = TypeVar("ResultOf", bound=Sized, covariant=True)


@dataclass(frozen=True)
class Piece:
    """Rows of one machine.

    Attributes
    ----------
    changes : dict
        Values of the parameters that vary.
    starts : tuple of (int or None)
        Numbers of the starts.
    """

    changes: dict[str, Value]
    starts: tuple[int | None, ...]


class Work(Protocol[ResultOf]):
    """What a study does with every piece; a callable, which other processes get as it is."""

    @property
    def study(self) -> str:
        """Of `origin.MODULES`: whose numbers these are."""

    @property
    def run_time(self) -> float:
        """Robot time of a run [s], about."""

    def __call__(self, piece: Piece) -> ResultOf:
        """Run a piece; as many rows as it has starts."""


def tasks(items: Iterator[Piece], run_time: float, time: float, most: int) -> Iterator[tuple[Piece, ...]]:
    """Pieces, together as long as their runs of `run_time` [s] have at most `time` [s] of robot time, and there are at
    most `most` runs."""
    rows_of_task = max(1, min(most, int(time / run_time)))
    task: list[Piece] = []
    rows = 0
    for item in items:
        if task and rows + len(item.starts) > rows_of_task:
            yield tuple(task)
            task, rows = [], 0
        task.append(item)
        rows += len(item.starts)
    if task:
        yield tuple(task)
