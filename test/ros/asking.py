"""Requests to services, and how not to lose them.

DDS drops a request, or its answer, if server and client know each other on one side only, as on a busy machine.
`service_is_ready` tells of the client's side alone.
"""

import time
from collections.abc import Callable
from functools import partial

import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter

AGAIN = 5.0  # s
ROBOT = "/vibro_robot"


def known_client(bench, kind: type, name: str, node: str = ROBOT):
    """Return a client of `node`'s service `name` after both have discovered each other, so that no request is lost."""
    client = bench.node.create_client(kind, f"{node}/{name}")
    bench.spin_until(client.service_is_ready, name)
    wait_until_known(bench, node)
    return client


def answered_once(bench, kind: type, name: str, node: str = ROBOT, **fields):
    """Return the answer of `node`'s service `name` to one request."""
    client = known_client(bench, kind, name, node)
    future = client.call_async(kind.Request(**fields))
    bench.spin_until(future.done, f"answer of {name}")
    bench.node.destroy_client(client)
    return future.result()


def wait_until_known(bench, node: str = ROBOT) -> None:
    """Wait until `node` knows all clients of `bench`: it discovers them in order, and has answered the youngest."""
    answer_of(bench, GetParameters, f"{node}/get_parameters")


def set_parameter(bench, name: str, value: float) -> None:
    """Set one parameter of the robot, which must accept it."""
    wanted = Parameter(name, value=value).to_parameter_msg()
    (result,) = answer_of(bench, SetParameters, f"{ROBOT}/set_parameters", parameters=[wanted]).results
    assert result.successful, result.reason


def answer_of(bench, kind: type, name: str, **fields):
    """Return the answer of the service `name`, asked until it answers: repetition must do no harm."""
    client = bench.node.create_client(kind, name)
    bench.spin_until(client.service_is_ready, name)
    futures, asked_at = [], 0.0

    def answered() -> bool:
        nonlocal asked_at
        if time.monotonic() >= asked_at + AGAIN:
            asked_at = time.monotonic()
            futures.append(client.call_async(kind.Request(**fields)))
        return any(future.done() for future in futures)

    bench.spin_until(answered, f"answer of {name}")
    bench.node.destroy_client(client)
    return next(future.result() for future in futures if future.done())


@pytest.fixture
def call(bench) -> Callable:
    """Call a service of the robot and return its answer."""
    return partial(answered_once, bench)
