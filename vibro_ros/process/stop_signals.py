"""SIGINT, SIGTERM and SIGHUP, which mean the same: end, and leave nothing broken behind.

A signal that is ignored when the process starts stays ignored if it is SIGHUP: that is what `nohup` is for. SIGINT is
not: a shell script ignores it for every program that it starts with `&`, and a robot must hear it all the same, as
other ROS nodes do. SIGQUIT (Ctrl-\\) always ends the process where it stands.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from vibro_ros.process.executables import shows_live_robot

ENDLESS = {"robot", "live_view"}
"""Executables that a signal ends well, with exit code 0, like a `view` of a live robot; the others exit with 128 + its
number."""
_STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopRequest:
    """Whether a stop signal came, and the number of the first; a context that catches them.

    While the executable starts, the first signal is a request and a second one ends the process at once.
    """

    def __init__(self):
        self.signal: int | None = None
        self._held = False

    def hold(self) -> None:
        """From now on further signals change nothing: something is open that must be closed well."""
        self._held = True

    def __enter__(self) -> "StopRequest":
        self._before = {number: signal.getsignal(number) for number in process.heard}
        _on_stop_signals(self._receive)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self else before)

    @property
    def exit_code(self) -> int:
        """128 + the signal's number, by which a shell knows what ended a program; 0 if no signal came."""
        return 128 + self.signal if self.signal is not None else 0

    def __bool__(self) -> bool:
        return self.signal is not None

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self.signal is not None and not self._held:
            process.leave(number, frame)
        self.signal = self.signal or number


class Process:
    """This process: its program, and the signals that came.

    `endless` says whether the program runs until a signal ends it, so that the signal is no failure, `stage` in words
    when a signal came. `heard` are the stop signals that were not ignored when the process began, `signal` is the
    number of the one that interrupted the process first; `defers` says whether the interruption waits for the end of
    `interrupted_afterwards`.
    """

    def __init__(self):
        self.program = ""
        self.endless = False
        self.stage = " while starting"
        self.heard = _STOP_SIGNALS
        self.signal: int | None = None
        self.defers = False

    def code_after(self, number: int) -> int:
        """Exit code of a process that the signal `number` ends."""
        return 0 if self.endless else 128 + number

    def leave(self, number: int, frame: FrameType | None) -> None:
        """End the process at once. An exception might be swallowed: by a finaliser, or a callback of C code."""
        try:
            os.write(2, f"{self.program}: stopped{self.stage}\n".encode())
        except OSError:
            pass
        os._exit(self.code_after(number))

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt at the first signal; end at the second, which comes if the first was swallowed."""
        self.stage = ""
        if self.signal is not None:
            self.leave(number, frame)
        self.signal = number
        if not self.defers:
            raise KeyboardInterrupt


process = Process()
"""This one."""


def end_at_once(program: str) -> None:
    """Let stop signals end the process from now on: an executable `program` that has nothing open yet."""
    process.program = program
    process.endless = program in ENDLESS or program == "view" and shows_live_robot(sys.argv[1:])
    process.heard = tuple(number for number in _STOP_SIGNALS
                          if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN)
    _on_stop_signals(process.leave)


def interrupt_what_runs() -> None:
    """Let stop signals raise KeyboardInterrupt from now on."""
    _on_stop_signals(process.interrupt)


def change_nothing() -> None:
    """Let stop signals do nothing any more: the process is at its end."""
    _on_stop_signals(signal.SIG_IGN)


def interrupted_code() -> int:
    """Exit code of an executable that ends because of a KeyboardInterrupt: 128 + the signal's number."""
    return process.code_after(process.signal or signal.SIGINT)


def interrupt_again() -> None:
    """Raise the KeyboardInterrupt of an earlier stop signal once more, if one came.

    For the next step of a long work: the first may have been swallowed, by a finaliser or by `except:` in a library.
    """
    if process.signal is not None:
        raise KeyboardInterrupt


@contextmanager
def interrupted_afterwards() -> Iterator[None]:
    """Raise the KeyboardInterrupt of a stop signal that comes inside at the end.

    For code that calls back from where Python can only ignore an exception, such as the hooks of a fork.
    """
    before, process.defers = process.signal, True
    try:
        yield
    finally:
        process.defers = False
    if process.signal != before:
        raise KeyboardInterrupt


def _on_stop_signals(receive: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    for number in process.heard:
        signal.signal(number, receive)
