"""What a tick of the node costs by the accuracy asked for, against publishing the same messages without simulating;
and what publishing costs against rclpy with ready messages.

`make accuracy` runs it as a process of its own and puts what it prints into docs/accuracy.md.
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.fields import ALL, stamp_at
from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.ros.robot.pacing import Pacing
from vibro_ros.ros.topics.publishers import RobotPublishers, makers, transforms
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.simulation.samples import TIME
from vibro_ros.simulation.simulator import Simulator

RATES = (1000.0, 200.0)  # Hz
#: What is asked for: in words, and parameters of the scene.
ASKED: Mapping[str, Mapping[str, Value]] = {
    "`solver.method: exact`": {},
    **{f"`auto`, `solver.accuracy: {accuracy:g}`": {"solver.method": "auto", "solver.accuracy": accuracy}
       for accuracy in (1e-3, 1e-6, 1e-9)},
    **{f"`rk4`, `solver.step: {step:g}`": {"solver.method": "rk4", "solver.step": step} for step in (1e-5, 1e-6)},
}
_SPEED = 100.0  # rad/s
_HEADING = ("asked for", "what runs", "a tick", "99 of 100 within", "publishing = 1")


class Ticks:
    """Ticks at one rate [Hz], in real time, through the node's own publishers; a measurement lasts `duration` [s]."""

    def __init__(self, node: Node, scene: Scene, rate: float, duration: float):
        self._outputs, self._scene, self._rate = RobotPublishers(node, scene, transforms=ALL), scene, rate
        self._count = max(2, round(rate * duration))

    def published(self) -> np.ndarray:
        """Costs [s] of publishing alone, shape (ticks,): what a simulation has found before."""
        device, found = self._device(self._scene), []
        for tick in range(self._count):
            device.advance_to((tick + 1) / self._rate)
            found.append((device.values.copy(), device.take_events()))
        return self._paced(lambda tick: None, lambda tick: self._publish(*found[tick]))[1]

    def ready(self) -> np.ndarray:
        """Costs [s] of publishing by rclpy alone, shape (ticks,): the same messages, ready made, without impacts."""
        state, publishers = self._device(self._scene).state, self._outputs.publishers
        ready = [(publishers[topic], make(state, 0)) for topic, make in makers(self._scene, "").items()]
        if (frames := self._outputs.frames) is not None:
            turns = frames.turns(state.crank_angle)
            ready.append((publishers["tf"], transforms(frames, state, turns, 0)))

        def publish(tick):
            for publisher, message in ready:
                publisher.publish(message)

        return self._paced(lambda tick: None, publish)[1]

    def simulated(self, parameters: Mapping[str, Value]) -> tuple[np.ndarray, Simulator]:
        """Costs [s] of simulating and sampling, shape (ticks,), publishing done and left out; and what was run."""
        device = self._device(self._scene.with_parameters(parameters))
        found: list = []

        def step(tick):
            device.advance_to((tick + 1) / self._rate)
            found[:] = device.values, device.take_events()

        return self._paced(step, lambda tick: self._publish(*found))[0], device

    def _paced(self, step: Callable[[int], object], publish: Callable[[int], object]) -> np.ndarray:
        pacing, costs = Pacing(1.0, 0.1), np.empty((2, self._count))
        for tick in range(self._count):
            pacing.wait_until((tick + 1) / self._rate)
            begun = time.perf_counter()
            step(tick)
            simulated = time.perf_counter()
            publish(tick)
            costs[:, tick] = simulated - begun, time.perf_counter() - simulated
        return costs

    def _publish(self, values, events) -> None:
        self._outputs.publish(values, events, stamp_at(0, values.item(TIME)), partial(stamp_at, 0),
                              lambda topic, stamp, data: None)

    @staticmethod
    def _device(scene: Scene) -> Simulator:
        """Ready to run: what is compiled at the first call is not a tick's cost."""
        compile_kernels(scene["solver.method"])
        Simulator(scene).advance_to(0.01)
        return Simulator(scene)


def lines(ticks: Ticks, rate: float) -> list[str]:
    """The table of one rate, in Markdown; publishing is measured anew before each line."""
    table, bare, ready = [], [], []
    for asked, parameters in ASKED.items():
        bare.append(np.median(ticks.published()))
        ready.append(np.median(ticks.ready()))
        costs, device = ticks.simulated(parameters)
        table.append(_line(asked, _running(device), *_micro(costs), f"{np.median(costs) / bare[-1]:.2f}"))
    return [f"At {rate:g} Hz, where publishing a tick's messages costs {1e6 * np.median(bare):.0f} µs, "
            f"{np.median(np.divide(bare, ready)):.2f} of what rclpy takes for ready messages of these types:", "",
            _line(*_HEADING), "|---" * len(_HEADING) + "|", *table]


def _running(device: Simulator) -> str:
    method = device.scene["solver.method"]
    return method if method == "exact" else f"{method}, {device.scene['solver.step']:.2g} s"


def _micro(costs: np.ndarray) -> tuple[str, str]:
    """Median and 99th percentile."""
    return f"{1e6 * np.median(costs):.0f} µs", f"{1e6 * np.percentile(costs, 99.0):.0f} µs"


def _line(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=1.5, help="of each measurement [s] (default %(default)g)")
    duration = parser.parse_args(words).duration
    scene, context = load_scene("device").with_parameters({"motor.speed": _SPEED}), Context()
    rclpy.init(context=context)
    node = Node("tick_cost", context=context)
    try:
        print("\n\n".join("\n".join(lines(Ticks(node, scene, rate, duration), rate)) for rate in RATES))
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
