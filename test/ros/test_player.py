from functools import partial

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros.controller.player import Player


def test_time_between_two_instants_is_never_beyond_the_second(domain_id: int):
    """Where the clock was read twice, one wait in fifty told of a time after the instant."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = Node("player", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    told: list[float] = []
    try:
        player = Player(node, executor, {}, (), "", meanwhile=told.append, period=1e-6)
        moments = [(5e-4 * k, partial(told.append, 5e-4 * k)) for k in range(3000)]
        with StopRequest() as stop:
            assert player.run(moments, 0.0, stop) == 0
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert len(told) > len(moments) + 300, "too few waits to tell"
    assert told == sorted(told)
