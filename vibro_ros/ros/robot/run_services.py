"""The services by which a run is reset, paused and stepped."""

import time
from collections.abc import Callable, Generator
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from vibro_ros.messages.operations import PAUSE, RESET, RESUME, STEP, Operation
from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.ros.node.requests import Request
from vibro_ros.ros.robot.operations import Operations

PATIENCE = 5.0
"""Longest time [s] that an answer waits for the stepping thread, which looks every 0.05 s unless it is computing."""


def offer_run_services(node: SteadyNode, operations: Operations) -> None:
    """Offer `~/reset`, `~/pause` and `~/step`."""
    group, ask = ReentrantCallbackGroup(), operations.ask
    for kind, name, operation in (
            (Trigger, "~/reset", lambda _: Operation(RESET)), (Trigger, "~/step", lambda _: Operation(STEP, steps=1)),
            (SetBool, "~/pause", lambda request: Operation(PAUSE if request.data else RESUME))):
        node.create_service(kind, name, _answering(node, ask, operation), callback_group=group)


async def finished(node: Node, request: Request, patience: float = PATIENCE) -> None:
    """Wait until a request is answered, or up to `patience` [s], while the executor runs other callbacks."""
    begun = time.monotonic()
    request.add_done_callback(lambda _: node.executor and node.executor.wake())
    while not request.done() and time.monotonic() < begun + patience:
        await _Turn()


def outcome(request: Request, patience: float = 0.0) -> tuple[bool, str]:
    """Whether what was asked for is done, and the words that say so; waits up to `patience` [s]."""
    try:
        return True, request.result(patience)
    except FutureTimeoutError:
        if request.cancel():
            return False, "the simulation has not answered in time; nothing was changed"
        return False, "the simulation has not answered in time; it may still do what was asked"
    except (ValueError, RuntimeError) as error:
        return False, str(error)


class _Turn:
    """Waits for the executor's next turn."""

    def __await__(self) -> Generator[None, None, None]:
        yield


def _answering(node: Node, ask: Callable[[Operation], Request], operation: Callable[[Any], Operation]
               ) -> Callable[[Any, Any], Any]:
    """The callback of a service whose answer says success and a message."""
    async def answer(request: Any, response: Any) -> Any:
        asked = ask(operation(request))
        await finished(node, asked)
        response.success, response.message = outcome(asked)
        return response

    return answer
