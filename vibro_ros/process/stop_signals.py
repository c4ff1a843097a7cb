"""SIGINT, SIGTERM and SIGHUP, which mean the same: end, and leave nothing broken behind.

A signal that is ignored when the process starts stays ignored if it is SIGHUP: that is what `nohup` is for. SIGINT is
not: a shell script ignores it for every program that it starts with `&`, and a robot must hear it all the same, as
other ROS nodes do. SIGQUIT (Ctrl-\\) always ends the process where it stands.
"""

import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from types import FrameType

from vibro_ros.process.streams import Forgiving

STOPPED_BY_DESIGN = {"robot", "view", "live_view", "look"}
"""Executables that a signal ends well, with exit code 0; the others exit with 128 + its number. `view` is one of them
unless it has a recording to read."""
MOST_INTERRUPTS = 2
"""Signals that raise KeyboardInterrupt; the one after them ends the process at once, whatever has swallowed these."""

_STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_AGAIN = 0.05  # s, after which a KeyboardInterrupt that was swallowed, or came at a bad moment, is raised again


class StopRequest:
    """Whether a stop signal came; a context that catches them.

    While the executable starts, the first signal is a request and a second one ends the process at once.

    Attributes
    ----------
    signal : int or None
        Number of the signal that came first.
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
    """What is known of this process: its program, and the signals that came.

    Attributes
    ----------
    program : str
        Name of the executable.
    stage : str
        Words that say when a signal came.
    heard : tuple of int
        Stop signals that were not ignored when it began.
    signal : int or None
        Number of the signal that interrupted the process first.
    has_an_end : bool
        Whether the process ends by itself when its work is done, although its program is of `STOPPED_BY_DESIGN`.
    """

    def __init__(self):
        self.program = ""
        self.has_an_end = False
        self.stage = " while starting"
        self.heard = _STOP_SIGNALS
        self.signal: int | None = None
        self._interrupts = 0

    def code_after(self, number: int) -> int:
        """Exit code of a process that the signal `number` ends."""
        return 0 if self.program in STOPPED_BY_DESIGN and not self.has_an_end else 128 + number

    def leave(self, number: int, frame: FrameType | None) -> None:
        """End the process at once. An exception might be swallowed: by a finaliser, or a callback of C code."""
        try:
            os.write(2, f"{self.program}: stopped{self.stage}\n".encode())
        except OSError:
            pass
        os._exit(self.code_after(number))

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt in what runs; a little later if it writes, or it would write the same again."""
        self.stage = ""
        if number != signal.SIGALRM:
            self.signal, self._interrupts = self.signal or number, self._interrupts + 1
        if self._interrupts > MOST_INTERRUPTS:
            self.leave(number, frame)
        if frame is not None and frame.f_code is Forgiving.write.__code__:
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)
            return
        raise KeyboardInterrupt

    def notice_swallowed(self, unraisable) -> None:
        """Raise a KeyboardInterrupt anew that Python has dropped, because it met a finaliser or a callback."""
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)
        else:
            sys.__unraisablehook__(unraisable)


process = Process()
"""This one."""


def end_at_once(program: str) -> None:
    """Let stop signals end the process from now on: an executable `program` that has nothing open yet."""
    process.program = program
    process.heard = tuple(number for number in _STOP_SIGNALS
                          if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN)
    _on_stop_signals(process.leave)
    os.register_at_fork(before=partial(signal.pthread_sigmask, signal.SIG_BLOCK, _STOP_SIGNALS),
                        after_in_parent=_unblock, after_in_child=_give_signals_back)


def interrupt_what_runs() -> None:
    """Let stop signals raise KeyboardInterrupt from now on."""
    signal.signal(signal.SIGALRM, process.interrupt)
    sys.unraisablehook = process.notice_swallowed
    _on_stop_signals(process.interrupt)


def change_nothing() -> None:
    """Let stop signals do nothing any more: the process is at its end."""
    _on_stop_signals(signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_IGN)


def interrupted_code() -> int:
    """Exit code of an executable that ends because of a KeyboardInterrupt: 128 + the signal's number."""
    return process.code_after(process.signal or signal.SIGINT)


def _give_signals_back() -> None:
    """In a forked process, which others end by signals: let them do what they usually do."""
    _on_stop_signals(signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _unblock()


def _unblock() -> None:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOP_SIGNALS)


def _on_stop_signals(receive: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    for number in process.heard:
        signal.signal(number, receive)
