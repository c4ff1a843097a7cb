"""What is computed apart in a study of orbits, on processes of this machine or of a cluster: orbits, and branches."""

import time
from dataclasses import dataclass

from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.search import Seed
from vibro_ros.process.front_door import say
from vibro_ros.study.orbits.plan import Plan, Task
from vibro_ros.study.running.pieces import Piece

RUN_TIME = 1000.0
"""Robot time [s] of a search or a branch, about: so long that each is handed out alone."""
_LINES = 10.0  # s between lines that say how far a branch is


@dataclass(frozen=True)
class Search:
    """Looks for orbits; a callable, which other processes get as it is.

    Attributes
    ----------
    plan : Plan
        Whose values are numbered by the starts of a piece.
    study : str
        See `Work`.
    run_time : float
        See `Work` [s].
    """

    plan: Plan
    study: str = "orbits"
    run_time: float = RUN_TIME

    def __call__(self, piece: Piece) -> list[list[Seed]]:
        """The orbits at each value of a piece."""
        return [self.plan.seeds(self.plan.begin[number]) for number in piece.starts if number is not None]

    def piece(self, number: int) -> Piece:
        """The search at one value."""
        return Piece({self.plan.name: self.plan.begin[number]}, (number,))


@dataclass(frozen=True)
class Following:
    """Follows branches, and says now and then how far they are; a callable, which other processes get as it is.

    Attributes
    ----------
    plan : Plan
        What is asked for.
    tasks : dict of int to Task
        By the numbers of the branches, which are the starts of a piece.
    study : str
        See `Work`.
    run_time : float
        See `Work` [s].
    """

    plan: Plan
    tasks: dict[int, Task]
    study: str = "orbits"
    run_time: float = RUN_TIME

    def __call__(self, piece: Piece) -> list[Branch]:
        """The branches of a piece."""
        return [self._branch(number) for number in piece.starts if number is not None]

    def piece(self, number: int) -> Piece:
        """One branch."""
        return Piece({self.plan.name: self.tasks[number].value}, (number,))

    def _branch(self, number: int) -> Branch:
        said = time.monotonic()

        def notice(orbits: int, value: float) -> None:
            nonlocal said
            if time.monotonic() - said > _LINES:
                said = time.monotonic()
                say("study", f"branch {number}: {orbits} orbits, {self.plan.name} = {value:.6g}")

        return self.plan.branch(self.tasks[number], notice)
