"""Long work before a run can begin, with reports of its progress.

Signals wait until a compiler has finished, and its finalisers swallow exceptions. An executable therefore compiles in
a daemon thread, so that its main thread receives every signal at once. A Python program compiles in the calling thread,
and another thread reports the progress.
"""

import sys
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar, cast

from vibro_ros.process.entry_point import say
from vibro_ros.simulation.kernels import compile_kernels, compiled_methods
from vibro_ros.solver.compilation import progress

POLL = 0.05  # s, between two checks whether the work is done
REPORTS = 10.0  # s, between two lines of progress
RENEWAL = 0.5  # s, after which the one line on a terminal is written again
_STACK = 64 * 2**20  # bytes; the compiler's recursion is deep, and the usual stack of a thread is 2 MiB in some shells

Result = TypeVar("Result")


class CompilationReport:
    """Progress report of a compilation; on a terminal, one line of stderr that is rewritten.

    Parameters
    ----------
    tell : callable
        Called with lines for people, only when something is really compiled, or cannot be stored.
    """

    def __init__(self, tell: Callable[[str], object]):
        self._tell, self._terminal = tell, sys.stderr.isatty()
        self._begun, self._due, self._compiled = time.monotonic(), 0.0, len(progress.done)

    def look(self) -> None:
        """Report the progress, if a report is due."""
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
        """Clear the line of progress, and report why kernels could not be stored."""
        if self._terminal and self._due:
            self._renew("")
        if progress.unwritable and len(progress.done) > self._compiled:
            self._tell(f"the compiled kernels cannot be kept: {progress.unwritable}; every start compiles them again. "
                       "Set NUMBA_CACHE_DIR to a folder that only you can write and that has room")

    def _renew(self, text: str) -> None:
        print(f"{text}\033[K", end="\r", file=sys.stderr, flush=True)


class Preparation(Generic[Result]):
    """A piece of work that may compile kernels, started at once in a thread.

    Parameters
    ----------
    work : callable
        The function to call in the thread.
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
        """Return whether the work is done; if it is not, report the progress when a report is due."""
        over = not self._thread.is_alive()
        if not over:
            self._report.look()
        return over

    def wait(self) -> Result:
        """Wait for the work, and return its result or raise its error."""
        while not self.done():
            self._thread.join(POLL)
        return self.result()

    def result(self) -> Result:
        """Return the result of the finished work, or raise its error."""
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
    """Compile or load the kernels of a `solver.method` in a thread; progress goes to stderr, after `program`."""
    Preparation(lambda: compile_kernels(method), lambda text: say(program, text)).wait()


def provide_kernels(method: str) -> None:
    """Compile or load the kernels of a `solver.method` in this thread; progress goes to stderr."""
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
