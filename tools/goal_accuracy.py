"""How well feedback holds speeds and reaches positions: many runs on the exact simulator, in simulated time, no ROS."""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.ros.controller.feedback import (
    MOTOR_RANGE,
    RATE,
    WITHIN,
    Goal,
    GoalError,
    PositionGoal,
    Pursuit,
    SpeedGoal,
    Track,
)
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.simulation.simulator import Simulator

ODOMETRY_RATE = 200
"""Samples of odometry a second, as the robot publishes them unless it is told otherwise."""
HOLD = 10.0
"""How long a speed is held [s]."""
PATIENCE = 60.0
"""Longest time [s] to reach a position."""
SHARES = (1 / 12, 1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6, 1.0)
"""Speeds to hold, as parts of the reach."""
WAYS = (0.01, 0.1, 0.5)
"""Ways to go [m]."""
LONGEST_START, FASTEST_START = 5.0, 110.0
"""A run begins when the motor has turned for up to so long [s] at up to this speed [rad/s]."""
BREAK = 2.0
"""Time [s] in which the robot comes to rest before it is sent to a position."""

Samples = Iterable[tuple[int, float]]
"""Of odometry: stamps [ns] and positions [m]."""


class Trial:
    """A goal pursued on a device; `heard` makes of a sample, its stamp [ns] and position [m], what odometry tells.

    The last goal took `took` [s]; `positions` [m] at each sample, `commands` [rad/s] and the words said are its own.
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
        start, track, tick = self.device.time, Track(), 0
        pursuit = Pursuit(goal, 0.0, duration, reach, track)
        while not pursuit.over:
            self.took = tick / ODOMETRY_RATE
            self.device.advance_to(start + self.took)
            self.positions.append(float(self.device.state.body_position))
            for stamp, position in self._heard(round(self.took * 1e9), self.positions[-1]):
                track.add(stamp, position, self.took)
            if tick % round(ODOMETRY_RATE / RATE) == 0:
                self._command(pursuit)
            tick += 1

    def _command(self, pursuit: Pursuit) -> None:
        speed = pursuit.motor_speed(self.took)
        self.words += pursuit.take_words()
        if speed is not None:
            self.commands.append(speed)
            self.device.command(motor_speed=speed)


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; the exit code."""
    options = _parser().parse_args(words)
    if options.runs < 1 or options.reach == 0.0:
        raise ValueError(f"--runs {options.runs} --reach {options.reach:g}: give a run at least, and no reach of 0")
    scene = load_scene(options.scene).with_parameters({"effects.motor": "ramp", "motor.speed": 0.0})
    compile_kernels(scene["solver.method"])
    print(f"| hold | mean of {options.runs} runs [mm/s] | standard deviation | largest error | missed |")
    print("|---|---|---|---|---|")
    for share in SHARES:
        print(_held(scene, share * options.reach, options.reach, options.runs), flush=True)
    print("\n| go | within | largest error [mm] | time: median [s] | longest [s] | missed |\n|---|---|---|---|---|---|")
    for way in WAYS:
        for within in (WITHIN, 0.001):
            print(_reached(scene, way, within, options.reach, options.runs), flush=True)
    return 0


def _held(scene: Scene, speed: float, reach: float, runs: int) -> str:
    """A row: the mean speed over the second half of each run, by the device's own positions."""
    means, missed = [], 0
    for trial in _started(scene, runs):
        try:
            trial.pursue(SpeedGoal(speed, WITHIN, MOTOR_RANGE), HOLD, reach)
        except GoalError:
            missed += 1
        half = len(trial.positions) // 2
        span = (len(trial.positions) - 1 - half) / ODOMETRY_RATE
        means.append((trial.positions[-1] - trial.positions[half]) / span * 1e3)
    worst = np.abs(np.array(means) - speed * 1e3).max()
    return f"| {speed * 1e3:.0f} mm/s | {np.mean(means):.1f} | {np.std(means):.1f} | {worst:.1f} | {missed} |"


def _reached(scene: Scene, way: float, within: float, reach: float, runs: int) -> str:
    """A row: how far from the position the body stands, and after what time."""
    off, times, missed = [0.0], [], 0
    for trial in _started(scene, runs):
        trial.turn(0.0, BREAK)
        target = float(trial.device.state.body_position) + np.copysign(way, reach)
        try:
            trial.pursue(PositionGoal(target, within, MOTOR_RANGE), PATIENCE, reach)
        except GoalError:
            missed += 1
            continue
        off.append(abs(float(trial.device.state.body_position) - target) * 1e3)
        times.append(trial.took)
    median, longest = (f"{np.median(times):.1f}", f"{max(times):.1f}") if times else ("-", "-")
    return f"| {way:g} m | {within * 1e3:g} mm | {max(off):.2f} | {median} | {longest} | {missed} |"


def _started(scene: Scene, runs: int) -> Iterable[Trial]:
    """As many trials, each with a motor that has turned at another speed and for another time."""
    starts = np.random.default_rng(1)
    for _ in range(runs):
        trial = Trial(scene)
        trial.turn(float(starts.uniform(0.0, FASTEST_START)), float(starts.uniform(0.0, LONGEST_START)))
        yield trial


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="device", help="a shipped scene's name or a path (default %(default)s)")
    parser.add_argument("--reach", type=float, default=-0.06, metavar="SPEED",
                        help="the controller's parameter [m/s] (default %(default)g)")
    parser.add_argument("--runs", type=int, default=50, help="of each row (default %(default)d)")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
