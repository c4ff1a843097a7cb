"""How every executable is entered and left: signals, streams, errors and exit codes.

`enter` runs before anything that takes long to import, so that Ctrl-C at any instant ends the process with one line and
the documented exit code. SIGINT, SIGTERM and SIGHUP, which a closed terminal sends, mean the same. Three stages:

- while the executable is imported, a signal ends the process at once: nothing is open yet;
- while its `main` runs, a signal raises KeyboardInterrupt, until `main` enters a `StopRequest`: then it is a request;
- when `main` is over, signals change nothing any more.

A signal that is ignored when the process starts stays ignored if it is SIGHUP: that is what `nohup` is for. SIGINT is
not: a shell script ignores it for every program that it starts with `&`, and a robot must hear it all the same, as
other ROS nodes do. SIGQUIT (Ctrl-\\) always ends the process where it stands.
"""

import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from types import FrameType

from vibro_ros.one_line import one_line
from vibro_ros.streams import Forgiving, open_streams

FAILURE, BAD_INPUT = 1, 2
MODULES = {
    "accuracy": "vibro_ros.study.accuracy",
    "controller": "vibro_ros.ros.controller",
    "demo": "vibro_ros.study.demo",
    "lateness": "vibro_ros.ros.lateness",
    "playback": "vibro_ros.ros.playback",
    "recover": "vibro_ros.study.recover",
    "replay": "vibro_ros.study.replay",
    "report": "vibro_ros.study.report",
    "robot": "vibro_ros.ros.robot",
    "tick_cost": "vibro_ros.ros.tick_cost",
}
"""Module of each executable; its `main` takes the words of the command line and returns the exit code."""
STOPPED_BY_DESIGN = {"robot"}
"""Executables that a signal ends well, with exit code 0; the others exit with 128 + its number."""
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
        self._before = {number: signal.getsignal(number) for number in _STOP_SIGNALS}
        _on_stop_signals(self._receive)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self else before)

    def __bool__(self) -> bool:
        return self.signal is not None

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self.signal is not None and not self._held:
            _process.leave(number, frame)
        self.signal = self.signal or number


class _Process:
    """What is known of this process: its program, and the signals that came."""

    def __init__(self):
        self.program = ""
        self.stage = " while starting"
        self.ignored: set[int] = set()
        self.interrupts = 0
        self.signal: int | None = None

    def code_after(self, number: int) -> int:
        """Exit code of a process that the signal `number` ends."""
        return 0 if self.program in STOPPED_BY_DESIGN else 128 + number

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
            self.signal, self.interrupts = self.signal or number, self.interrupts + 1
        if self.interrupts > MOST_INTERRUPTS:
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


_process = _Process()


def enter(program: str) -> int:
    """Run an executable as the whole of this process.

    Parameters
    ----------
    program : str
        A name of `MODULES`.

    Returns
    -------
    int
        The exit code: what `main` returned; 0 or 128 + the signal's number if a signal stopped it before.
    """
    _take_over(program)
    try:
        code = _run(MODULES[program]) if _has_folder(program) else BAD_INPUT
    except KeyboardInterrupt:
        code = interrupted_code()
        say(program, "stopped")
    finally:
        _on_stop_signals(signal.SIG_IGN)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)
    code = _flushed(program, code)
    if _works_on():
        os._exit(code)
    return code


def exit_code(program: str, body: Callable[[], int]) -> int:
    """The exit code of `body()`; a foreseen error is one line on stderr, never a traceback.

    Parameters
    ----------
    program : str
        Begins the line.
    body : callable
        Returns the exit code.

    Returns
    -------
    int
        What `body` returned; 2 for bad input (ValueError), 1 for a failure (RuntimeError, OSError, MemoryError).
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


def interrupted_code() -> int:
    """Exit code of an executable that ends because of a KeyboardInterrupt: 128 + the signal's number."""
    return _process.code_after(_process.signal or signal.SIGINT)


def say(program: str, text: str) -> None:
    """Write one line on stderr."""
    print(f"{program}: {one_line(' '.join(text.split()))}", file=sys.stderr, flush=True)


def _take_over(program: str) -> None:
    """Take signals and streams; a forked process, which others end by signals, gives the signals back."""
    _process.program = program
    _process.ignored = {number for number in (signal.SIGHUP,) if signal.getsignal(number) is signal.SIG_IGN}
    _on_stop_signals(_process.leave)
    os.register_at_fork(before=partial(signal.pthread_sigmask, signal.SIG_BLOCK, _STOP_SIGNALS),
                        after_in_parent=_unblock, after_in_child=_give_signals_back)
    open_streams()


def _run(module: str) -> int:
    try:
        main = import_module(module).main
    except ModuleNotFoundError as error:
        missing = (error.name or str(error)).partition(".")[0]
        say(_process.program, f"{missing}: no such Python module here; {_remedy(missing)}")
        return FAILURE
    signal.signal(signal.SIGALRM, _process.interrupt)
    sys.unraisablehook = _process.notice_swallowed
    _on_stop_signals(_process.interrupt)
    try:
        return main(sys.argv[1:])
    except SystemExit as end:  # of argparse, after --help
        return end.code or 0


def _remedy(module: str) -> str:
    if module == "rclpy" or module.endswith(("_msgs", "_srvs")):
        return "source a ROS 2 Jazzy installation, or use the environment that `make setup` makes"
    return "install what setup.py names"


def _has_folder(program: str) -> bool:
    """Whether the working folder exists: where it does not, libraries fail as they are imported."""
    try:
        os.getcwd()
    except OSError:
        folder = os.readlink("/proc/self/cwd").removesuffix(" (deleted)")
        say(program, f"{folder}: this working folder was deleted; change to another one")
        return False
    return True


def _flushed(program: str, code: int) -> int:
    try:
        sys.stdout.flush()
    except OSError as error:
        say(program, f"{error.filename}: {error.strerror}")
        return code or FAILURE
    return code


def _works_on() -> bool:
    """Whether a thread still works that was left alone, such as a compilation: it would crash the interpreter's end."""
    threading = sys.modules.get("threading")
    return threading is not None and any(thread.daemon for thread in threading.enumerate())


def _give_signals_back() -> None:
    _on_stop_signals(signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _unblock()


def _unblock() -> None:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOP_SIGNALS)


def _on_stop_signals(receive: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    for number in _STOP_SIGNALS:
        if number not in _process.ignored:
            signal.signal(number, receive)


# What the console scripts call.
accuracy, controller, recover, replay, report, robot = (
    partial(enter, name) for name in ("accuracy", "controller", "recover", "replay", "report", "robot"))
