"""A goal of the controller's feedback, pursued on the exact simulator in simulated time, without ROS."""

from collections.abc import Callable, Iterable

from vibro_ros.model.scene import Scene
from vibro_ros.ros.controller.feedback import RATE, Goal, GoalTracking, MeanPosition
from vibro_ros.simulation.simulator import Simulator

ODOMETRY_RATE = 200
"""Samples of odometry a second, as the robot publishes them unless it is told otherwise."""

Samples = Iterable[tuple[int, float]]
"""Of odometry: stamps [ns] and positions [m]."""


class Trial:
    """A goal pursued on a device. `heard` turns stamp [ns] and position [m] of a sample into what odometry reports. The
    last goal took `took` [s]; `positions` [m] at each sample, `commands` [rad/s] and the log belong to it.
    """

    def __init__(self, scene: Scene, heard: Callable[[int, float], Samples] = lambda *sample: (sample,)):
        self.device, self.took = Simulator(scene), 0.0
        self.positions, self.commands, self.words = list[float](), list[float](), list[str]()
        self._heard = heard

    def turn(self, speed: float, duration: float) -> None:
        """Turn the motor at `speed` [rad/s] for `duration` [s]."""
        self.device.command(motor_speed=speed)
        self.device.advance_to(self.device.time + duration)

    def pursue(self, goal: Goal, duration: float, reach: float) -> None:
        """Pursue a goal as the controller does.

        Raises
        ------
        GoalError
            When it is missed.
        """
        start, mean, tick = self.device.time, MeanPosition(), 0
        tracking = GoalTracking(goal, 0.0, duration, reach, mean)
        while not tracking.over:
            self.took = tick / ODOMETRY_RATE
            self.device.advance_to(start + self.took)
            self.positions.append(float(self.device.state.body_position))
            for stamp, position in self._heard(round(self.took * 1e9), self.positions[-1]):
                mean.add(stamp, position, self.took)
            if tick % round(ODOMETRY_RATE / RATE) == 0:
                self._command(tracking)
            tick += 1

    def _command(self, tracking: GoalTracking) -> None:
        speed = tracking.motor_speed(self.took)
        self.words += tracking.take_words()
        if speed is not None:
            self.commands.append(speed)
            self.device.command(motor_speed=speed)
