"""A goal of the controller's feedback, pursued on the exact simulator in simulated time, without ROS.

`python test/ros/goal_trial.py 50` prints the table of docs/guide/scripts.md, in about ten minutes.
"""

import sys
from collections.abc import Callable, Iterable

import numpy as np

import vibro_ros
from vibro_ros.model.scene import Scene
from vibro_ros.ros.controller.feedback import (
    DEFAULT_MOTOR_RANGE,
    RATE,
    Goal,
    GoalError,
    GoalTracking,
    MeanPosition,
    PositionGoal,
    SpeedGoal,
)
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

    @property
    def mean_speed(self) -> float:
        """Mean speed of the body [m/s] over the second half of the last goal."""
        half = len(self.positions) // 2
        return (self.positions[-1] - self.positions[half]) * ODOMETRY_RATE / (len(self.positions) - 1 - half)

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


FAST = (100.0, 222.0), -0.34, 0.001
"""Range of the motor [rad/s], reach [m/s] and gap [m] with which `device` goes much faster than with its own gap."""

STOPPING = 2.0
"""Time [s] in which motor and body come to rest."""


def main(starts: int) -> None:
    """Print the errors of goals of the scene `device`, each from `starts` random starts, and how many were missed."""
    for speed, within, (motor, reach, gap) in (
            *((speed, 0.005, (DEFAULT_MOTOR_RANGE, -0.06, 0.0)) for speed in (-0.005, -0.02, -0.06)),
            *((speed, 0.02, FAST) for speed in (-0.1, -0.2, -0.3))):
        held, missed = [], 0
        for number in range(starts):
            trial = _turned(number, gap)
            try:
                trial.pursue(SpeedGoal(speed, within, motor), 10.0 if gap == 0.0 else 20.0, reach)
            except GoalError:
                missed += 1
            held.append(1e3 * trial.mean_speed)
        error = max(abs(mean - 1e3 * speed) for mean in held)
        print(f"hold {1e3 * speed:g} mm/s: largest error {error:.1f}, mean {np.mean(held):.1f}, standard deviation "
              f"{np.std(held):.1f} mm/s; {missed} of {starts} missed", flush=True)
    for within in (0.005, 0.001):
        for way, rests in ((0.01, False), (0.01, True), (0.1, False), (0.5, False)):
            errors, times, missed = [], [], 0
            for number in range(starts):
                trial = _turned(number, 0.0)
                if rests:
                    trial.turn(0.0, STOPPING)
                target = float(trial.device.state.body_position) - way
                try:
                    trial.pursue(PositionGoal(target, within, DEFAULT_MOTOR_RANGE), 60.0, -0.06)
                except GoalError:
                    missed += 1
                    continue
                errors.append(1e3 * abs(float(trial.device.state.body_position) - target))
                times.append(trial.took)
            print(f"go {way:g} m{' after a stop' * rests} within {1e3 * within:g} mm: largest error {max(errors):.2f}"
                  f" mm, {np.median(times):.1f} s in the median, {max(times):.1f} s at most; {missed} of {starts} "
                  "missed", flush=True)


def _turned(number: int, gap: float) -> Trial:
    """Return a trial whose motor has turned at up to 110 rad/s for up to 5 s, drawn by the seed `number`."""
    generator = np.random.default_rng(number)
    trial = Trial(vibro_ros.load_scene("device").with_parameters(
        {"effects.motor": "ramp", "motor.speed": 0.0, "upper.gap": gap, "inclined.gap": gap}))
    trial.turn(generator.uniform(0.0, 110.0), generator.uniform(0.0, 5.0))
    return trial


if __name__ == "__main__":
    main(int(sys.argv[1]))
