"""Holding a mean speed: the body follows a position that moves on at that speed.

The mean speed is right as long as the distance to this position stays bounded. That holds even where no motor speed
gives the wanted mean: the motor then alternates between two that lie on either side of it.
"""

from collections import deque

from vibro_ros.ros.controller.goals import GoalError, SpeedGoal, way
from vibro_ros.ros.controller.track import Track

BANDWIDTH = 1.5
"""Of following [rad/s], if the mean speed were in proportion to the motor's speed up to `reach`."""
INTEGRAL = 0.25
"""Gain of the integral part, as a part of `BANDWIDTH` squared, for which the following would be critically damped."""
LONGEST_LEAD = 0.7
"""Time [s] at `reach` that the moving position may be ahead of the body or behind it: it does not run away from a robot
that cannot follow, which would have to make up for all of it later."""
LONGEST_STEP = 0.5
"""Longest time [s] that one step may count for, after a pause of odometry."""
SHORT = 1.0
"""Time [s] over which the mean speed is looked at to say when it has settled, and how far it strays."""


class Holding:
    """A proportional and integral law on the distance to the moving position.

    Parameters
    ----------
    goal : SpeedGoal
        What to hold.
    duration : float
        How long [s]; the mean speed counts over the second half.
    reach : float
        Mean speed [m/s] that the robot holds at most; its sign is that of the way it goes.
    """

    def __init__(self, goal: SpeedGoal, duration: float, reach: float):
        self.over, self.words = False, list[str]()
        self._goal, self._duration, self._reach = goal, duration, reach
        self._low, self._high = goal.motor
        self._gain = BANDWIDTH * (self._high - self._low) / abs(reach)
        self._integral = self._low + (self._high - self._low) * min(1.0, goal.speed / reach)
        self._target = 0.0
        self._before: tuple[float, float, int] | None = None  # stamp, position, leaps of the last step
        self._way = self._span = 0.0
        self._short: deque[tuple[float, float]] = deque()
        self._settled: float | None = None
        self._strays = (goal.speed, goal.speed)
        self._at_high = self._at_low = 0.0

    def step(self, time: float, track: Track) -> float:
        """The motor speed [rad/s] to command, `time` [s] after the beginning.

        Raises
        ------
        GoalError
            At the end, when the speed was not held.
        """
        stamp, position = track.stamp, track.position
        assert stamp is not None and position is not None
        if self._before is None or self._before[2] != track.leaps:  # from here on, then
            self._target = position
            self._short.clear()
            elapsed = 0.0
        else:
            elapsed = min(stamp - self._before[0], LONGEST_STEP)
            self._measure(time, stamp, position)
        self._before = stamp, position, track.leaps
        if time >= self._duration:
            self._finish()
        return self._follow(elapsed, position)

    def _follow(self, elapsed: float, position: float) -> float:
        lead_most, sign = LONGEST_LEAD * abs(self._reach), 1.0 if self._reach > 0.0 else -1.0
        lead = sign * (self._target + self._goal.speed * elapsed - position)
        lead = min(max(lead, -lead_most), lead_most)
        self._target = position + sign * lead
        wanted = self._integral + self._gain * lead
        speed = min(max(wanted, self._low), self._high)
        if wanted == speed or (wanted - speed) * lead < 0.0:  # else the integral part would wind up
            self._integral += INTEGRAL * BANDWIDTH * self._gain * lead * elapsed
            self._integral = min(max(self._integral, self._low), self._high)
        self._at_high += elapsed if speed == self._high else 0.0
        self._at_low += elapsed if speed == self._low else 0.0
        return speed

    def _measure(self, time: float, stamp: float, position: float) -> None:
        """Add the way since the last step to what counts; see whether the speed has settled."""
        self._short.append((stamp, position))
        while self._short[0][0] < stamp - SHORT:
            self._short.popleft()
        span = stamp - self._short[0][0]
        if span >= 0.9 * SHORT:
            mean = (position - self._short[0][1]) / span
            if self._settled is None and abs(mean - self._goal.speed) <= self._goal.within:
                self._settled = time
                self.words.append(f"settled after {time:.1f} s: mean over {SHORT:g} s is {mean:.4f} m/s")
            if time >= self._duration / 2.0 + SHORT:
                self._strays = min(mean, self._strays[0]), max(mean, self._strays[1])
        if time >= self._duration / 2.0 and self._before:
            self._way += position - self._before[1]
            self._span += stamp - self._before[0]

    def _finish(self) -> None:
        self.over = True
        if self._span < self._duration / 4.0:
            raise GoalError(f"odom told of {self._span:.1f} s of the last {self._duration / 2.0:g} s: too little to "
                            "know the mean speed")
        mean = self._way / self._span
        low, high = self._strays
        said = (f"mean speed {mean:.4f} m/s over the last {self._span:.1f} s, {low:.4f} to {high:.4f} m/s over "
                f"{SHORT:g} s each")
        if abs(mean - self._goal.speed) > self._goal.within:
            wanted = f"{self._goal.speed:g} m/s not held within {self._goal.within:g} m/s"
            raise GoalError(f"{wanted}: {said}{self._cause()}")
        self.words.append(f"held: {said}")

    def _cause(self) -> str:
        if self._at_high > self._duration / 4.0:
            return (f"; the motor was at {self._high:g} rad/s for {self._at_high:.1f} s: the robot goes no faster "
                    f"{way(self._reach)}; give a smaller speed or a wider motor_speed")
        if self._at_low > self._duration / 4.0:
            return (f"; the motor was at {self._low:g} rad/s for {self._at_low:.1f} s: the robot goes no slower; "
                    "give a larger speed or a wider motor_speed")
        return "; give more time or a wider tolerance"
