"""A process that simulates scene after scene for another, which forked it."""

import itertools
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import fields
from multiprocessing.connection import Connection

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.samples import EVENT_DTYPE, Run, Samples
from vibro_ros.simulator import SimulationError

#: Scenes at a time that a worker is given: one runs while the other waits, so that it need not wait for us.
MOST_GIVEN = 2

#: Simulates a scene: yields None after each part, and at last the run.
Simulation = Callable[[Scene], Iterator[Run | None]]

# Bytes of a result whose memory is kept for the next one: getting new memory costs as much as copying.
_KEPT_ROOM = 1 << 24

_SAMPLED = [field.name for field in fields(Samples)]

_FORK = multiprocessing.get_context("fork")


def outcome_in_parts(run: Simulation, scene: Scene) -> Iterator[Run | str | None]:
    """As `run`; yields at last the run or what prevented it."""
    try:
        yield from run(scene)
    except SimulationError as error:
        yield str(error)
    except Exception as error:
        yield f"{type(error).__name__}: {error}"


class Worker:
    """A process that simulates scene after scene.

    Parameters
    ----------
    run : callable
        Simulates a scene.
    inherited : list of Connection
        Pipes to other workers, which the process closes.

    Attributes
    ----------
    pipe : Connection
        To it and from it.
    given : deque of int
        Numbers of the scenes it has been given and has not answered, in order.
    """

    def __init__(self, run: Simulation, inherited: list[Connection]):
        self.pipe, far = _FORK.Pipe()
        self.given: deque[int] = deque()
        # A room is free again before the worker needs it: it is given another scene for every outcome taken.
        self._all_rooms = [_Room() for _ in range(MOST_GIVEN)]
        self._rooms = itertools.cycle(self._all_rooms)
        self._process = _FORK.Process(target=_work, args=(far, self._all_rooms, [*inherited, self.pipe], run),
                                      daemon=True, name="simulate_many")
        self._process.start()
        far.close()

    def give(self, number: int, scene: Scene) -> None:
        """Add a scene to its work: it has fewer than `MOST_GIVEN`."""
        self.given.append(number)
        try:
            self.pipe.send(scene)
        except OSError:  # it has ended: `answer` says so
            pass

    def answer(self) -> tuple[int, Run | str]:
        """Number and outcome of the oldest scene it was given."""
        number, room = self.given.popleft(), next(self._rooms)
        try:
            rest = self.pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            return number, f"its process ended with exit code {self._process.exitcode}"
        return number, room.take(rest)

    def kill(self) -> None:
        """End it: a kernel would not notice a gentler signal before its run is over."""
        self._process.kill()

    def forget(self) -> None:
        """Wait for its end and leave nothing of it behind."""
        self._process.join()
        self._process.close()
        self.pipe.close()
        for room in self._all_rooms:
            room.close()


def _work(pipe: Connection, rooms: list["_Room"], inherited: list[Connection], run: Simulation) -> None:
    """Answer every scene that comes, until nobody is left to ask."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent as well, which ends us
    for other in inherited:  # or we would keep each other alive if the parent were killed
        other.close()
    try:
        for room in itertools.cycle(rooms):
            *_, outcome = outcome_in_parts(run, pipe.recv())
            pipe.send(room.put(outcome))
    except (EOFError, OSError):
        pass


class _Room:
    """Memory that a worker shares with its parent for the arrays of one outcome: through a pipe they would cost the
    parent as much as a short run."""

    def __init__(self):
        self._file = os.memfd_create("simulate_many")

    def put(self, outcome: Run | str) -> str | tuple[int, int, dict]:
        """Put a run's arrays here; returns what else `take` needs of the outcome, or what prevented it."""
        if isinstance(outcome, str):
            return outcome
        try:
            self._write([*(getattr(outcome, name) for name in _SAMPLED), outcome.events])
        except OSError as error:
            return f"its result of {len(outcome.time)} samples could not be handed over: {error}; ask for fewer"
        return len(outcome.time), len(outcome.events), outcome.statistics

    def _write(self, arrays: list[np.ndarray]) -> None:
        offset = 0
        for array in arrays:
            part = memoryview(array.view(np.uint8))
            while part.nbytes:
                written = os.pwrite(self._file, part, offset)
                part, offset = part[written:], offset + written

    def take(self, rest: str | tuple[int, int, dict]) -> Run | str:
        """The outcome that was put here."""
        if isinstance(rest, str):
            return rest
        count, event_count, statistics = rest
        samples = [np.empty(count) for _ in _SAMPLED]
        events = np.empty(event_count, dtype=EVENT_DTYPE)
        if self._read([*samples, events]) > _KEPT_ROOM:
            os.ftruncate(self._file, 0)
        return Run(*samples, events, statistics)

    def _read(self, arrays: list[np.ndarray]) -> int:
        """Fill `arrays`; returns their size [bytes]."""
        offset = 0
        for array in arrays:
            part = memoryview(array.view(np.uint8))
            while part.nbytes:
                read = os.preadv(self._file, [part], offset)
                if read == 0:
                    raise EOFError(f"a result ends {part.nbytes} bytes early; please report this")
                part, offset = part[read:], offset + read
        return offset

    def close(self) -> None:
        """Give the memory back."""
        os.close(self._file)
