"""What takes long before a run can begin, in a thread that can be left alone.

While a compiler works, signals wait for it, and its finalisers swallow exceptions. Here the main thread only waits: it
hears every signal at once, can say how far the work is, and can leave.
"""

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar, cast

from vibro_ros.process.front_door import say
from vibro_ros.simulation.kernels import compile_kernels, kernel_count
from vibro_ros.solver.kernel_cache import progress

POLL = 0.05  # s, between two looks whether the work is done
REPORTS = 10.0  # s, between two lines that say how far it is
_STACK = 64 * 2**20  # bytes; the compiler's recursion is deep, and the usual stack of a thread is 2 MiB in some shells

Result = TypeVar("Result")


class Preparation(Generic[Result]):
    """A piece of work that may compile kernels, begun at once.

    Parameters
    ----------
    work : callable
        Done in the thread.
    method : str
        The `solver.method` whose kernels it compiles.
    tell : callable
        Is given lines for people: only when something is really compiled, or cannot be kept.
    """

    def __init__(self, work: Callable[[], Result], method: str, tell: Callable[[str], object]):
        self._work, self._tell, self._count = work, tell, kernel_count(method)
        self._result: Result | None = None
        self._error: BaseException | None = None
        self._begun, self._due, self._compiled = time.monotonic(), 0.0, len(progress.done)
        self._before = len(progress.done) + len(progress.loaded)  # of other work
        usual = threading.stack_size(_STACK)
        self._thread = threading.Thread(target=self._run, name="preparation", daemon=True)
        self._thread.start()
        threading.stack_size(usual)

    def done(self) -> bool:
        """Whether the work is done; asked again and again, it says how far it is."""
        over = not self._thread.is_alive()
        under_way = list(progress.under_way)
        if under_way and not over and time.monotonic() >= self._due:
            self._report(under_way[0])
        return over

    def wait(self) -> Result:
        """What the work returns, once it is done; an error of the work is raised."""
        while not self.done():
            self._thread.join(POLL)
        return self.result()

    def result(self) -> Result:
        """What the work has returned; an error of the work is raised."""
        if self._error is not None:
            raise self._error
        if progress.unwritable and len(progress.done) > self._compiled:
            self._tell(f"the compiled kernels cannot be kept: {progress.unwritable}; every start compiles them anew. "
                       "Set NUMBA_CACHE_DIR to a folder that can be written and has room")
        return cast(Result, self._result)

    def _run(self) -> None:
        try:
            self._result = self._work()
        except BaseException as error:  # the main thread raises it
            self._error = error

    def _report(self, kernel: str) -> None:
        if not self._due:
            self._tell("compiling: the first start after an update takes half a minute; Ctrl-C stops it")
        else:
            ready = len(progress.done) + len(progress.loaded) - self._before
            self._tell(f"compiling {kernel}: {ready} of {self._count} kernels are ready after "
                       f"{time.monotonic() - self._begun:.0f} s")
        self._due = time.monotonic() + REPORTS


def prepare_kernels(program: str, method: str) -> None:
    """Compile the kernels of a `solver.method`, or load them; how far that is goes to stderr, after `program`."""
    Preparation(lambda: compile_kernels(method), method, lambda text: say(program, text)).wait()
