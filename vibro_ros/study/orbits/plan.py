"""What a study of orbits is asked for, and the tasks that it consists of: a branch each."""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.branch import Branch, Notice, branch_from, doubled_branch_from, family_of
from vibro_ros.orbits.family import Family
from vibro_ros.orbits.orbit import Seed, seeds_of
from vibro_ros.process.front_door import say
from vibro_ros.study.running.runner import Piece

UP, DOWN, DOUBLED = "upwards", "downwards", "doubled"
_LINES = 10.0  # s between lines that say how far a branch is


class Task(NamedTuple):
    """One branch to follow.

    Attributes
    ----------
    way : str
        `UP` or `DOWN` from an orbit, or `DOUBLED` from a period doubling.
    turns : int
        Of the orbit that it begins with.
    phase : float
        Crank angle at the cut [rad].
    state : ndarray, shape (n,)
        At the cut, in units of the machine.
    value : float
        The parameter there, in its unit.
    parent : int or None
        Number of the branch whose period doubles.
    """

    way: str
    turns: int
    phase: float
    state: np.ndarray
    value: float
    parent: int | None


@dataclass(frozen=True)
class Plan:
    """What is asked for.

    Attributes
    ----------
    scene : Scene
        The machine, its motor running.
    name : str
        The parameter that changes.
    low, high : float
        Its range, in its unit.
    begin : tuple of float
        Values at which orbits are looked for, in its unit.
    turns : int
        Turns after which orbits repeat themselves at most.
    starts : int
        Starts at each of these values.
    points : int
        Most orbits of a branch.
    """

    scene: Scene
    name: str
    low: float
    high: float
    begin: tuple[float, ...]
    turns: int
    starts: int
    points: int

    def document(self) -> dict[str, object]:
        """All that decides the branches."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name != self.name}
        return {"scene": self.scene.name, "set": fixed, "vary": {self.name: {"from": self.low, "to": self.high}},
                "units_at": self.scene[self.name], "begin": list(self.begin), "turns": self.turns,
                "starts": self.starts, "points": self.points}

    def family(self, turns: int, phase: float) -> Family:
        """The orbits over the range; ValueError for a range that the scene refuses."""
        return family_of(self.scene, self.name, self.low, self.high, turns, phase)

    def seeds(self, value: float) -> list[Seed]:
        """Orbits at a value of the parameter; their states in the units of the family."""
        scene = self.scene.with_parameters({self.name: value})
        found = []
        for seed in seeds_of(scene, self.starts, self.turns):
            family = self.family(seed.turns, seed.phase)
            ratio = family.units_of(scene) / family.units
            found.append(Seed(seed.turns, float(seed.phase), seed.state * ratio))
        return found

    def branch(self, task: Task, notice: Notice | None = None) -> Branch:
        """Follow a branch; `notice` hears of each orbit."""
        family = self.family(task.turns, task.phase)
        share = family.share(task.value)
        if task.way == DOUBLED:
            return doubled_branch_from(family, task.state, share, self.points, notice)
        direction = 1.0 if task.way == UP else -1.0
        return branch_from(family, task.state, share, direction, self.points, notice)


def seeds_of_piece(plan: Plan, piece: Piece) -> list[list[Seed]]:
    """The orbits at the value of `plan.begin` that a piece has the number of, as one result."""
    return [plan.seeds(plan.begin[piece.number])]


def branches_of_piece(plan: Plan, tasks: dict[int, Task], piece: Piece) -> list[Branch]:
    """The branch that a piece has the number of, as one result; now and then a line says how far it is."""
    return [plan.branch(tasks[piece.number], _notice(plan, piece.number))]


def _notice(plan: Plan, number: int) -> Notice:
    said = time.monotonic()

    def notice(orbits: int, value: float) -> None:
        nonlocal said
        if time.monotonic() - said > _LINES:
            said = time.monotonic()
            say("study", f"branch {number}: {orbits} orbits, {plan.name} = {value:.6g}")

    return notice
