"""Start and end of every executable: signals, streams, arguments, errors and exit codes.

SIGINT, SIGTERM and SIGHUP mean the same: end, and leave nothing broken behind. Their effect depends on the stage;
`enter` begins the first stage before anything that takes long to import:

- while the executable is imported, a stop signal ends the process at once, because nothing is open yet;
- while its `main` runs, it raises KeyboardInterrupt; once `main` has entered a `StopRequest`, it is a request;
- after `main` it has no effect.

SIGHUP stays ignored if it is ignored when the process starts, as `nohup` wants. SIGINT does not, because a shell script
ignores it for every program that it starts with `&`, and a robot must obey it all the same, as other ROS nodes do.
SIGQUIT (Ctrl-\\) always ends the process at once.
"""

import argparse
import atexit
import errno
import io
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module, metadata
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from vibro_ros.process.executables import EXECUTABLES, shows_live_robot
from vibro_ros.process.files import one_line, user_path

FAILURE, BAD_INPUT = 1, 2
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
MIDDLEWARES = "share/ament_index/resource_index/rmw_typesupport"
"""Folder below an installation's prefix that has a file for each middleware."""
LAUNCHED = "--launched"
"""Option by which a signal is the normal end of another executable, too: a launch file reports any other exit code as
a process that has died."""


class Parser(argparse.ArgumentParser):
    """The argument parser of an executable, with `--version`.

    Its errors are ValueErrors, which `exit_code` prints in one line. Arguments of the type `Path` are a `user_path`.
    """

    def __init__(self, *, prog: str, **options: Any):
        super().__init__(prog=prog, **options)
        self.register("type", Path, user_path)
        self.add_argument("--version", action=_Version)

    def error(self, message: str) -> NoReturn:
        """Raise `message` as a ValueError, like all other bad input; of a missing value it says the form."""
        option = re.fullmatch(r"argument (--[\w-]+).*: expected one argument", message)
        if option and (form := re.search(rf"{option[1]} (.+?)\]?(?:\s|$)", self.format_usage())):
            message = f"{message}, as in {option[1]} {form[1]}"
        raise ValueError(f"{message}; `{self.prog} --help` shows what there is")


class _Version(argparse.Action):
    """Prints the program's name and the version of its package, and ends the parsing as `--help` does."""

    def __init__(self, option_strings: Sequence[str], dest: str = argparse.SUPPRESS):
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help="say which version this is")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(f"{parser.prog} {metadata.version(_process.package)}")
        parser.exit()


def enter(program: str, executables: Mapping[str, Any] = EXECUTABLES) -> int:
    """Run an executable as the whole of this process; another package gives its own list, of entries as `Executable`.

    Returns the exit code: that of `main`; 0 or 128 + the signal's number if a KeyboardInterrupt ended `main`.
    """
    executable = executables["live_view" if program == "view" and shows_live_robot(sys.argv[1:]) else program]
    _process.program, _process.endless = program, executable.endless
    _process.package = executable.module.partition(".")[0]
    if _process.package == "vibro_ros":  # no program of the device needs BLAS, whose second thread would spin for 0.1 s
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # hashlib has digests of its own, which it takes where OpenSSL is missing: 3 MB less
        sys.modules.setdefault("_hashlib", None)  # type: ignore[arg-type]  # as Python documents
    _on_stop_signals(_end_at_once)
    _open_streams()
    interrupted: list[int] = []
    # Python ends by SIGINT, although the interrupt was caught, if it came in code that `exec` runs. This handler is
    # registered first, so that it runs after all others.
    atexit.register(lambda: interrupted and os._exit(interrupted[0]))
    try:
        code = _run(program, executable.module)
    except KeyboardInterrupt:
        code = interrupted_code()
        interrupted.append(code)
        say(program, "stopped")
    finally:
        _on_stop_signals(signal.SIG_IGN)
    try:
        sys.stdout.flush()
    except OSError as error:
        say(program, f"standard output: {error.strerror}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # else Python tries again, and reports a second error
        code = code or FAILURE
    threading = sys.modules.get("threading")
    if threading and any(thread.daemon for thread in threading.enumerate()):
        os._exit(code)  # a daemon thread would crash the interpreter's shutdown
    return code


def exit_code(program: str, body: Callable[[], int]) -> int:
    """Run `body` and return its exit code; an expected error becomes one line on stderr, without a traceback.

    The line begins with `program`. The code is 2 for bad input (ValueError), 1 for a failure (RuntimeError, OSError,
    MemoryError).
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


class StopRequest:
    """A context that catches stop signals; true once one has come, and `signal` is the number of the first.

    Until `hold` is called, a second signal ends the process at once.
    """

    def __init__(self):
        self.signal: int | None = None
        self._ignores_second = False

    def hold(self) -> None:
        """Ignore a second signal from now on, because something is open that must be closed, such as a bag."""
        self._ignores_second = True

    def __enter__(self) -> "StopRequest":
        self._earlier_handlers = {number: signal.getsignal(number) for number in STOP_SIGNALS}
        self.signal = _process.signal  # of a signal before, whose KeyboardInterrupt a finaliser has swallowed
        _on_stop_signals(self._receive)  # last: a signal may come at once
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._earlier_handlers.items():
            signal.signal(number, signal.SIG_IGN if self else handler)

    @property
    def exit_code(self) -> int:
        """128 + the signal's number, as shells expect; 0 if no signal came, or if a signal is the normal end."""
        return _code_after(self.signal) if self.signal is not None else 0

    def __bool__(self) -> bool:
        return self.signal is not None

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self.signal is not None and not self._ignores_second:
            _end_at_once(number, frame)
        self.signal = self.signal or number


class _Process:
    """State of this process: name of the `program` and of its `package`, whether it is `endless`, number of the first
    stop `signal` that interrupted it, and whether it `defers` the KeyboardInterrupt to the end of
    `interrupted_afterwards`."""

    program, package, endless = "", "vibro_ros", False
    signal: int | None = None
    defers = False


_process = _Process()


def interrupt_on_signals() -> None:
    """Let a stop signal raise KeyboardInterrupt from now on, and a second one end the process, because the first
    KeyboardInterrupt may have been swallowed."""
    _on_stop_signals(_interrupt)


def interrupted_code() -> int:
    """Return the exit code of an executable that ends because of a KeyboardInterrupt."""
    return _code_after(_process.signal or signal.SIGINT)


def interrupt_again() -> None:
    """Raise KeyboardInterrupt again if a stop signal came earlier.

    For each step of a long computation: the first KeyboardInterrupt may have been swallowed, by a finaliser or by
    `except:` in a library.
    """
    if _process.signal is not None:
        raise KeyboardInterrupt


@contextmanager
def interrupted_afterwards() -> Iterator[None]:
    """Defer the KeyboardInterrupt of a stop signal that comes within this context to its end.

    For callbacks from which Python ignores exceptions, such as the hooks of a fork.
    """
    earlier_signal, _process.defers = _process.signal, True
    try:
        yield
    finally:
        _process.defers = False
    if _process.signal != earlier_signal:
        raise KeyboardInterrupt


def _on_stop_signals(receive: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    for number in STOP_SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, receive)


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _process.signal is not None:
        _end_at_once(number, frame)
    _process.signal = number
    if not _process.defers:
        raise KeyboardInterrupt


def _end_at_once(number: int, frame: FrameType | None) -> None:
    """End the process without an exception, which a finaliser or a callback of C code might swallow."""
    stage = " while starting" if _process.signal is None else ""
    try:
        os.write(2, f"{_process.program}: stopped{stage}\n".encode())
    except OSError:
        pass
    os._exit(_code_after(number))


def _code_after(number: int) -> int:
    return 0 if _process.endless or LAUNCHED in sys.argv[1:] else 128 + number


def _run(program: str, module: str) -> int:
    if fault := _middleware_fault(program):
        say(program, fault)
        return BAD_INPUT
    try:
        main = import_module(module).main
    except ModuleNotFoundError as error:
        missing = (error.name or str(error)).partition(".")[0]
        of_ros = missing == "rclpy" or missing.endswith(("_msgs", "_srvs", "_interfaces"))
        say(program, f"{missing}: no such Python module here; " + (
            "ROS 2 is missing. Source an installation of it (. /opt/ros/jazzy/setup.bash), or run `make setup` in a "
            f"clone and then .venv/bin/{program}, or add the wheels to this Python: pip install '.[ros]' in a clone"
            if of_ros else "install what setup.py names"))
        return FAILURE
    interrupt_on_signals()
    try:
        return main(sys.argv[1:])
    except SystemExit as end:  # raised by argparse, after --help
        return end.code if isinstance(end.code, int) else 0


def _middleware_fault(program: str) -> str:
    """Return why rcl would end the process, with code 102, while `program` imports rclpy; empty if it does not.

    Where no middleware is registered, as in an installation by `pip install --user`, or another one may be loaded
    before rcl by LD_PRELOAD, rcl is left to judge.
    """
    wanted = os.environ.get("RMW_IMPLEMENTATION")
    if not wanted or "LD_PRELOAD" in os.environ or not (_process.endless or program == "controller"):
        return ""
    prefixes = filter(None, [sys.prefix, *os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)])
    registered = {path.name for prefix in prefixes for path in Path(prefix, MIDDLEWARES).glob("*")}
    installed = sorted(registered - {"rmw_implementation"})
    return "" if not installed or wanted in installed else (
        f"RMW_IMPLEMENTATION={wanted}: is not installed, but {', '.join(installed)} is; unset RMW_IMPLEMENTATION, or "
        "install its package beside ROS 2 from apt, such as ros-jazzy-rmw-zenoh-cpp (the wheels of PyPI have Fast DDS "
        "alone)")


class _Output(io.FileIO):
    """An output stream that ignores a closed pipe or terminal, so that a robot can go on and seal its bag."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in (errno.EPIPE, errno.EIO, errno.ECONNRESET):
                raise
            return memoryview(data).nbytes


def _open_streams() -> None:
    """Replace `sys.stdout` and `sys.stderr`; a character that the encoding lacks is written as an escape."""
    for descriptor, name in ((1, "stdout"), (2, "stderr")):
        encoding = getattr(getattr(sys, name), "encoding", None) or "utf-8"
        setattr(sys, name, io.TextIOWrapper(
            io.BufferedWriter(_Output(descriptor, "w", closefd=False)), encoding, errors="backslashreplace",
            line_buffering=descriptor == 2 or os.isatty(descriptor)))


def __getattr__(name: str) -> Callable[[], int]:
    """Return the function that the console script of an executable calls, such as `robot`."""
    if name in EXECUTABLES:
        return partial(enter, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
