"""How a node's process starts, stops and fails; the same for every executable.

SIGINT and SIGTERM are taken here instead of by rclpy: rclpy's handlers shut the context down under the
threads that still publish, and a wait without end may then never return. While a process starts, a signal
interrupts it at once; once it runs, a signal is a request that its loop polls, so that it can say a last
word (seal the bag, stop the motor) while ROS is still up; once it ends, further signals change nothing.
"""

import argparse
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

import rclpy
from rclpy.exceptions import InvalidNamespaceException, InvalidNodeNameException
from rclpy.executors import Executor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.signals import SignalHandlerOptions

from vibro_ros.ros.executor import SteadyExecutor
from vibro_ros.ros.node import SteadyNode

BAD_INPUT = 2
FAILURE = 1
POLL = 0.05
"""Longest wait [s] of the executor before the loop looks whether it should end."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, said by `exit_code`."""

    def error(self, message: str) -> None:
        """Raise `message` as the ValueError that bad input is everywhere else."""
        raise ValueError(f"{message}; `{self.prog} --help` shows what there is")


class StopRequest:
    """Whether SIGINT or SIGTERM came; a context that catches them.

    Attributes
    ----------
    signal : int or None
        Number of the signal that came first.
    """

    def __init__(self):
        self.signal: int | None = None

    def __enter__(self) -> "StopRequest":
        _on_stop_signals(self._receive)
        return self

    def __exit__(self, *_: object) -> None:
        _on_stop_signals(signal.SIG_IGN)

    def __bool__(self) -> bool:
        return self.signal is not None

    def _receive(self, number: int, _: FrameType | None) -> None:
        self.signal = self.signal or number


def exit_code(program: str, body: Callable[[], int], interrupted: int) -> int:
    """Run `body` as the whole of this process; a foreseen error is one line on stderr, never a traceback.

    Parameters
    ----------
    program : str
        Begins the line.
    body : callable
        Returns the exit code.
    interrupted : int
        Exit code when a signal stops `body` before it runs its own `StopRequest`.

    Returns
    -------
    int
        What `body` returned; 2 for bad input (ValueError), 1 for a failure (RuntimeError, OSError).
    """
    _on_stop_signals(_interrupt)
    try:
        return body()
    except KeyboardInterrupt:
        _say(program, "stopped while starting")
        return interrupted
    except ValueError as error:
        _say(program, str(error))
        return BAD_INPUT
    except (RuntimeError, OSError) as error:
        _say(program, str(error))
        return FAILURE
    finally:
        _on_stop_signals(signal.SIG_IGN)


@contextmanager
def node_running(name: str, words: Sequence[str]) -> Iterator[tuple[SteadyNode, Executor]]:
    """A node and its executor, from `rclpy.init` to the clean end.

    The node takes every parameter override that it is given, so that misspelt ones can be found. Neither of the two
    ends by what peers send.

    Raises
    ------
    ValueError
        For ROS arguments, a node name or a namespace that ROS refuses.
    """
    set_logger_level("rcl", LoggingSeverity.FATAL)  # else rcl says first, in other words, what the error says
    try:
        rclpy.init(args=list(words), signal_handler_options=SignalHandlerOptions.NO)
        node = SteadyNode(name)
    except (RuntimeError, InvalidNodeNameException, InvalidNamespaceException) as error:
        rclpy.try_shutdown()
        raise ValueError(f"ROS refuses the arguments: {_first_sentence(error)}") from error
    finally:
        set_logger_level("rcl", LoggingSeverity.UNSET)
    executor = SteadyExecutor(node.refusals)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def spin_until(executor: Executor, done: Callable[[], bool], poll: float = POLL) -> None:
    """Run callbacks until `done`, which is looked at after each one and at least every `poll` [s]."""
    while not done():
        executor.spin_once(timeout_sec=poll)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Leave what is being started, once."""
    _on_stop_signals(signal.SIG_IGN)
    raise KeyboardInterrupt


def _on_stop_signals(receive: Callable[[int, FrameType | None], None] | signal.Handlers) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, receive)


def _say(program: str, text: str) -> None:
    print(f"{program}: {' '.join(text.split())}", file=sys.stderr, flush=True)


def _first_sentence(error: Exception) -> str:
    """The part of an rcl message that a user can act on: without the places in rcl's source."""
    text = str(error).removeprefix("failed to initialize rcl: ")
    return text.split(", at /")[0].splitlines()[0]
