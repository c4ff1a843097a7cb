"""How every executable is entered and left: signals, streams, arguments, errors and exit codes.

`enter` runs before anything that takes long to import, so that Ctrl-C at any instant ends the process with one line and
the documented exit code. Three stages:

- while the executable is imported, a stop signal ends the process at once: nothing is open yet;
- while its `main` runs, it raises KeyboardInterrupt, until `main` enters a `StopRequest`: then it is a request;
- when `main` is over, it changes nothing any more.
"""

import argparse
import atexit
import errno
import io
import os
import resource
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any, NoReturn

from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.stop_signals import change_nothing, end_at_once, interrupt_what_runs, interrupted_code
from vibro_ros.process.untrusted import one_line

FAILURE, BAD_INPUT = 1, 2
ADDRESS_SPACE = 2_000_000_000
"""Bytes of address space that an executable needs at most on two cores: below it scipy's libraries wait for memory
without end, deaf to signals, or end the process without a word that helps."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, written by `exit_code`."""

    def error(self, message: str) -> NoReturn:
        """Raise `message` as the ValueError that bad input is everywhere else."""
        raise ValueError(f"{message}; `{self.prog} --help` shows what there is")


def enter(program: str) -> int:
    """Run an executable as the whole of this process.

    Returns the exit code: what `main` returned; 0 or 128 + the signal's number if a signal stopped it before.
    """
    end_at_once(program)
    open_streams()
    interrupted: list[int] = []
    atexit.register(_leave, interrupted)  # before all others, so that it comes after them
    try:
        code = _run(program)
    except KeyboardInterrupt:
        code = interrupted_code()
        interrupted.append(code)
        say(program, "stopped")
    finally:
        change_nothing()
    try:
        sys.stdout.flush()
    except OSError as error:
        say(program, f"{error.filename}: {error.strerror}")
        code = code or FAILURE
    threading = sys.modules.get("threading")
    if threading and any(thread.daemon for thread in threading.enumerate()):
        os._exit(code)  # a thread that was left alone, such as a compilation, would crash the interpreter's end
    return code


def exit_code(program: str, body: Callable[[], int]) -> int:
    """The exit code of `body()`; a foreseen error is one line on stderr, which `program` begins, never a traceback.

    It is 2 for bad input (ValueError), 1 for a failure (RuntimeError, OSError, MemoryError).
    """
    try:
        return body()
    except ValueError as error:
        say(program, str(error))
        return BAD_INPUT
    except MemoryError:
        say(program, "not enough memory; free some, or give less at a time")
    except OSError as error:
        say(program, f"{error.filename}: {error.strerror}" if error.filename else str(error))
    except RuntimeError as error:
        say(program, str(error))
    return FAILURE


def say(program: str, text: str) -> None:
    """Write one line on stderr."""
    print(f"{program}: {one_line(' '.join(text.split()))}", file=sys.stderr, flush=True)


def _run(program: str) -> int:
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < ADDRESS_SPACE:
        say(program, f"the address space is limited to {limit / 1e6:.0f} MB, and {ADDRESS_SPACE / 1e6:.0f} MB are "
            f"needed; raise it with `ulimit -v {ADDRESS_SPACE // 1000}`, or `ulimit -v unlimited`")
        return FAILURE
    try:
        main = import_module(EXECUTABLES[program].module).main
    except ModuleNotFoundError as error:
        missing = (error.name or str(error)).partition(".")[0]
        of_ros = missing == "rclpy" or missing.endswith(("_msgs", "_srvs", "_interfaces"))
        say(program, f"{missing}: no such Python module here; " + (
            "ROS 2 is missing. Source an installation of it (. /opt/ros/jazzy/setup.bash), or run `make setup` in a "
            f"clone and then .venv/bin/{program}, or add the wheels to this Python: pip install '.[ros]' in a clone"
            if of_ros else "install what setup.py names"))
        return FAILURE
    interrupt_what_runs()
    try:
        return main(sys.argv[1:])
    except SystemExit as end:  # of argparse, after --help
        return end.code if isinstance(end.code, int) else 0


def _leave(interrupted: list[int]) -> None:
    """End an interrupted process with its exit code: Python would end by SIGINT if the interrupt met code that `exec`
    runs, whoever has caught it."""
    if interrupted:
        os._exit(interrupted[0])


class Forgiving(io.FileIO):
    """A file descriptor to which writing succeeds also when nobody reads any more.

    A reader that has gone, be it `head` or a closed terminal, must not end a robot that seals its bag, nor a `recover`
    at the first of its bags. Any other error, such as that of a full disk, is raised once; later output is dropped.
    """

    _UNREAD = (errno.EPIPE, errno.EIO, errno.ECONNRESET)  # a pipe without reader, a closed terminal, a lost connection

    def __init__(self, descriptor: int):
        super().__init__(descriptor, "w", closefd=False)
        self._dropping = False

    def write(self, data: Any) -> int:
        """Write `data`; the number of bytes written, or dropped."""
        try:
            return memoryview(data).nbytes if self._dropping else super().write(data)
        except OSError as error:
            self._dropping = True
            if error.errno in self._UNREAD:
                return memoryview(data).nbytes
            name = ("standard input", "standard output", "standard error")[self.fileno()]
            raise OSError(error.errno, error.strerror, name) from None


def open_streams() -> None:
    """Renew `sys.stdout` and `sys.stderr`, and take every closed standard descriptor.

    A descriptor below 3 that is left closed goes to the next file that is opened: a log line would land in a bag.
    A character that the stream's encoding lacks is written as `\\u03c6`.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
    sys.stdout, sys.stderr = _stream(1, sys.stdout), _stream(2, sys.stderr)


def _stream(descriptor: int, before: Any) -> io.TextIOWrapper:
    file = io.BufferedWriter(Forgiving(descriptor))
    encoding = before.encoding if before else "utf-8"
    return io.TextIOWrapper(file, encoding, errors="backslashreplace",
                            line_buffering=descriptor == 2 or os.isatty(descriptor))


def __getattr__(name: str) -> Callable[[], int]:
    """What the console script of an installed executable calls, such as `robot`."""
    if name in EXECUTABLES:
        return partial(enter, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
