"""A study of orbits at work: it looks for orbits, follows their branches, then those of doubled period."""

import contextlib
import errno
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import cast

from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.search import Seed, lies_on
from vibro_ros.orbits.special_points import DOUBLING
from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.process.front_door import say
from vibro_ros.study.orbits.branch_files import MOST_BRANCHES, BranchFiles, branch_of
from vibro_ros.study.orbits.plan import DOUBLED, DOWN, UP, Plan, Task
from vibro_ros.study.orbits.work import Following, Search
from vibro_ros.study.progress import Progress
from vibro_ros.study.running.pieces import Piece, Result, Work
from vibro_ros.study.running.runner import Runner

_SAME = 1e-6  # share of the range within which a period doubling that two branches have is one
_JOINS = 0.05  # share of the range within which a branch that joins another one ends at its period doubling


class OrbitsRun:
    """The branches of a plan in a folder that nobody else writes into.

    Parameters
    ----------
    plan : Plan
        What is asked for.
    folder : Path
        Of the branches' files.
    runner : Runner
        Who computes.

    Attributes
    ----------
    done : list of (Task, Branch)
        The branches so far, by their numbers.
    """

    def __init__(self, plan: Plan, folder: Path, runner: Runner):
        self._plan, self._files, self._runner = plan, BranchFiles(folder, plan), runner
        self._doubled: set[tuple[int, int]] = set()  # number of a branch and of its special point
        self.done: list[tuple[Task, Branch]] = []

    @property
    def in_words(self) -> str:
        """How much is done."""
        return f"{len(self.done)} branches are kept; the same command goes on from there"

    def do(self) -> None:
        """Follow every branch.

        Raises
        ------
        ForeignBlockError
            For files of another study.
        RuntimeError
            When the disk is full or refuses, or a run cannot go on; what is done is kept.
        """
        self._files.check_folder()
        for value, seeds in self._seeds():
            for seed in seeds:
                family = self._plan.family(seed.turns, seed.phase)
                if not any(lies_on(family, seed, family.share(value), branch) for _, branch in self.done):
                    self._follow([Task(way, seed.turns, seed.phase, seed.state, value, None) for way in (UP, DOWN)])
        while tasks := self._doublings():
            self._follow(tasks)

    def _seeds(self) -> Iterator[tuple[float, list[Seed]]]:
        begin, search = self._plan.begin, Search(self._plan)
        with contextlib.closing(self._computed(search, map(search.piece, range(len(begin))))) as results, \
                Progress("orbits looked for", "value", len(begin)) as progress:
            found = list[tuple[float, list[Seed]]]()
            for value, (seeds,) in zip(begin, results, strict=True):
                found.append((value, seeds))
                progress.add(1)
        yield from found

    def _follow(self, tasks: Sequence[Task]) -> None:
        """Do the tasks, or read what was done before; their branches come in the order of the tasks."""
        numbers = range(len(self.done), len(self.done) + len(tasks))
        if numbers.stop > MOST_BRANCHES:
            raise RuntimeError(f"there are more than {MOST_BRANCHES} branches; give fewer --turns or a smaller range")
        known = {number: self._kept(number) for number in numbers}
        missing = {number: task for number, task in zip(numbers, tasks, strict=True) if known[number] is None}
        for number, task in missing.items():
            say("study", f"branch {number}: {task.turns} turn{'s' * (task.turns > 1)}, {task.way} from "
                         f"{self._plan.name} = {task.value:.9g}, at most {self._plan.points} orbits")
        following = Following(self._plan, missing)
        with contextlib.closing(self._computed(following, map(following.piece, missing))) as results:
            for number, (branch,) in zip(missing, results, strict=True):
                known[number] = branch
                if len(branch):  # a branch that does not begin is tried again, which is soon done
                    self._keep(number, branch)
        self.done += [(task, branch) for task, branch in zip(tasks, known.values(), strict=True) if branch is not None]

    def _computed(self, work: Work[Result], pieces: Iterator[Piece]) -> Generator[Result, None, None]:
        """What the runner makes of the pieces, in order."""
        return cast("Generator[Result, None, None]",
                    self._runner(work, (self._plan.scene["solver.method"],), pieces))

    def _kept(self, number: int) -> Branch | None:
        table = self._files.read(number)
        if table is None:
            if self._files.path(number).exists():
                say("study", f"{self._files.path(number)}: is damaged, or of another pyarrow; it is done again")
            return None
        return branch_of(table, self._plan.name, coordinates(self._plan.scene))

    def _keep(self, number: int, branch: Branch) -> None:
        try:
            self._files.write(number, [branch])
        except OSError as error:
            remedy = "free some room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "let it be written"
            raise RuntimeError(f"{self._files.path(number)}: {error.strerror}; {remedy}. {self.in_words}") from error

    def _doublings(self) -> list[Task]:
        """The first period doubling of each branch whose branch of doubled period is not known yet."""
        tasks: list[Task] = []
        for parent, (_, branch) in enumerate(self.done):
            if 2 * branch.turns > self._plan.turns:
                continue
            for number, special in enumerate(branch.special_points):
                if special.kind != DOUBLING or (parent, number) in self._doubled:
                    continue
                self._doubled.add((parent, number))
                if not self._is_known(branch.turns, special.value, tasks):
                    tasks.append(Task(DOUBLED, branch.turns, special.phase, special.state, special.value, parent))
                    break
        return tasks

    def _is_known(self, turns: int, value: float, tasks: Sequence[Task]) -> bool:
        """Whether a branch begins at a period doubling of orbits of so many turns, or ends there."""
        span = self._plan.high - self._plan.low
        begun = (*tasks, *(task for task, _ in self.done))
        if any(task.way == DOUBLED and task.turns == turns and abs(task.value - value) < _SAME * span
               for task in begun):
            return True
        return any(branch.turns == 2 * turns and branch.end.startswith("joins")
                   and abs(branch.values[-1] - value) < _JOINS * span for _, branch in self.done)
