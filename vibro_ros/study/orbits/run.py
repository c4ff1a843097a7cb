"""A study of orbits at work: it looks for orbits, follows their branches, then those of doubled period."""

import contextlib
import errno
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import cast

from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.search import Seed, lies_on
from vibro_ros.orbits.special_points import DOUBLING
from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.process.front_door import say
from vibro_ros.simulation.processes import in_processes
from vibro_ros.study.orbits.branch_files import MOST_BRANCHES, BranchFiles, branch_of
from vibro_ros.study.orbits.plan import DOUBLED, DOWN, UP, Plan, Task
from vibro_ros.study.progress import Progress

_LINES = 10.0  # s between lines that say how far a branch is
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
    workers : int
        Processes.

    Attributes
    ----------
    done : list of (Task, Branch)
        The branches so far, by their numbers.
    """

    def __init__(self, plan: Plan, folder: Path, workers: int):
        self._plan, self._files, self._workers = plan, BranchFiles(folder, plan), workers
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
        plan = self._plan
        with contextlib.closing(in_processes(plan.seeds, plan.begin, min(self._workers, len(plan.begin)))) as jobs, \
                Progress("orbits looked for", "value", len(plan.begin)) as progress:
            found = list[tuple[float, list[Seed]]]()
            for value, job in zip(plan.begin, jobs, strict=True):
                found.append((value, cast(list[Seed], job.outcome())))
                progress.add(1)
        yield from found

    def _follow(self, tasks: Sequence[Task]) -> None:
        """Do the tasks, or read what was done before; their branches come in the order of the tasks."""
        numbers = range(len(self.done), len(self.done) + len(tasks))
        if numbers.stop > MOST_BRANCHES:
            raise RuntimeError(f"there are more than {MOST_BRANCHES} branches; give fewer --turns or a smaller range")
        known = {number: self._kept(number) for number in numbers}
        missing = [(number, task) for number, task in zip(numbers, tasks, strict=True) if known[number] is None]
        for number, task in missing:
            say("study", f"branch {number}: {task.turns} turn{'s' * (task.turns > 1)}, {task.way} from "
                         f"{self._plan.name} = {task.value:.9g}, at most {self._plan.points} orbits")
        jobs = in_processes(self._branch, missing, max(1, min(self._workers, len(missing))))
        with contextlib.closing(jobs):
            for (number, _), job in zip(missing, jobs, strict=True):
                known[number] = branch = cast(Branch, job.outcome())
                self._keep(number, branch)
        self.done += [(task, branch) for task, branch in zip(tasks, known.values(), strict=True) if branch is not None]

    def _branch(self, numbered: tuple[int, Task]) -> Branch:
        """Follow a branch and say now and then how far it is, in whatever process this is."""
        number, task = numbered
        said = time.monotonic()

        def notice(orbits: int, value: float) -> None:
            nonlocal said
            if time.monotonic() - said > _LINES:
                said = time.monotonic()
                say("study", f"branch {number}: {orbits} orbits, {self._plan.name} = {value:.6g}")

        return self._plan.branch(task, notice)

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
