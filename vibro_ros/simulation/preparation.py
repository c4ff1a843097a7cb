"""Work that takes long before a run can begin, and how far it is.

While a compiler works, signals wait for it, and its finalisers swallow exceptions. An executable leaves such work to a
thread that can be left alone: its main thread hears every signal at once. A Python program compiles in its own thread,
and another thread tells how far it is.
"""

import sys
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar, cast

from vibro_ros.process.entry_point import say
from vibro_ros.simulation.kernels import compile_kernels, compiled_methods
from vibro_ros.solver.compilation import progress

POLL = 0.05  # s, between two looks whether the work is done
REPORTS = 10.0  # s, between two lines that say how far it is
RENEWAL = 0.5  # s, after which the one line on a terminal is written again
_STACK = 64 * 2**20  # bytes; the compiler's recursion is deep, and the usual stack of a thread is 2 MiB in some shells

Result = TypeVar("Result")


class CompilationReport:
    """Says what is being compiled, and how far it is: on a terminal in one line of stderr that renews itself.

    Parameters
    ----------
    tell : callable
        Is given lines for people: only when something is really compiled, or cannot be kept.
    """

    def __init__(self, tell: Callable[[str], object]):
        self._tell, self._terminal = tell, sys.stderr.isatty()
        self._begun, self._due, self._compiled = time.monotonic(), 0.0, len(progress.done)

    def look(self) -> None:
        """Say how far it is, if that is due."""
        under_way, now = progress.under_way[:1], time.monotonic()
        if not under_way or now < self._due:
            return
        text = f"compiling {under_way[0]}, {now - self._begun:.0f} s so far"
        if not self._due:
            self._tell("compiling: the first start after an update takes a minute; Ctrl-C stops it")
        elif self._terminal:  # the cursor goes back, so that whatever is written next takes the line's place
            self._renew(text)
        else:
            self._tell(text)
        self._due = now + (RENEWAL if self._terminal else REPORTS)

    def end(self) -> None:
        """Say why kernels are not kept."""
        if self._terminal and self._due:
            self._renew("")
        if progress.unwritable and len(progress.done) > self._compiled:
            self._tell(f"the compiled kernels cannot be kept: {progress.unwritable}; every start compiles them again. "
                       "Set NUMBA_CACHE_DIR to a folder that only you can write and that has room")

    def _renew(self, text: str) -> None:
        print(f"{text}\033[K", end="\r", file=sys.stderr, flush=True)


class Preparation(Generic[Result]):
    """A piece of work that may compile kernels, begun at once in a thread.

    Parameters
    ----------
    work : callable
        Done in the thread.
    tell : callable
        As for `CompilationReport`.
    """

    def __init__(self, work: Callable[[], Result], tell: Callable[[str], object]):
        self._work, self._report = work, CompilationReport(tell)
        self._result: Result | None = None
        self._error: BaseException | None = None
        usual = threading.stack_size(_STACK)
        self._thread = threading.Thread(target=self._run, name="preparation", daemon=True)
        self._thread.start()
        threading.stack_size(usual)

    def done(self) -> bool:
        """Whether the work is done; asked again and again, it says how far it is."""
        over = not self._thread.is_alive()
        if not over:
            self._report.look()
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
        self._report.end()
        return cast(Result, self._result)

    def _run(self) -> None:
        try:
            self._result = self._work()
        except BaseException as error:  # the main thread raises it
            self._error = error


def prepare_kernels(program: str, method: str) -> None:
    """Compile the kernels of a `solver.method`, or load them; how far that is goes to stderr, after `program`."""
    Preparation(lambda: compile_kernels(method), lambda text: say(program, text)).wait()


def provide_kernels(method: str) -> None:
    """Compile the kernels of a `solver.method`, or load them, in this thread; how far that is goes to stderr."""
    if method in compiled_methods:
        return
    report, over = CompilationReport(lambda text: say("vibro_ros", text)), threading.Event()

    def tell() -> None:
        while not over.wait(POLL):
            report.look()

    thread = threading.Thread(target=tell, name="report", daemon=True)
    thread.start()
    try:
        compile_kernels(method)
    finally:
        over.set()
        thread.join()
    report.end()
