"""Reaching a position and standing there: at a speed in proportion to the distance, because there is no way back."""

from collections import deque

from vibro_ros.ros.controller.goals import GoalError, PositionGoal, way
from vibro_ros.ros.controller.track import Track

APPROACH = 0.7
"""Time [s] at `reach` below which the motor is slowed down; the distance then shrinks to 1/e in as long."""
CREEP = 0.3
"""Least share of the motor's range while the position is approached: below it the robot hardly moves."""
BOOST = 0.1
"""What is added to this share in a second [1/s] while the robot does not come nearer."""
LOOK_BACK = 1.0
"""Time [s] over which it is seen whether the robot comes nearer."""
NEARER = 0.1, 0.0005
"""The robot comes nearer if it makes this part of the distance in `LOOK_BACK`, or this many metres."""
EARLY = 0.1
"""Part of the tolerance that is left when the motor is told to stop: its way until it stands."""
BRAKING = 0.3
"""Time [s] for which the robot goes on at its speed: half of its motor's ramp, and half of the track's window."""
SPEED_OVER = 0.25
"""Time [s] over which its speed is seen for that."""
STANDSTILL = 0.5, 0.05
"""The body is at rest when it moved for so long [s] by no more than this part of the tolerance."""


class Approach:
    """A proportional law on the distance, with a stop at the end.

    Parameters
    ----------
    goal : PositionGoal
        What to reach.
    duration : float
        Longest time [s].
    reach : float
        Mean speed [m/s] that the robot holds at most; its sign is that of the way it goes.
    """

    def __init__(self, goal: PositionGoal, duration: float, reach: float):
        self.over, self.words = False, list[str]()
        self._goal, self._duration, self._reach = goal, duration, reach
        self._low, self._high = goal.motor
        self._share = CREEP
        self._begun = self._stopping = False
        self._distances: deque[tuple[float, float]] = deque()
        self._time = 0.0

    def step(self, time: float, track: Track) -> float:
        """The motor speed [rad/s] to command, `time` [s] after the beginning; 0 at the end.

        Raises
        ------
        GoalError
            When the position is out of reach, was passed, or was not reached in time.
        """
        assert track.position is not None
        distance = (self._goal.position - track.position) * (1.0 if self._reach > 0.0 else -1.0)
        if not self._begun:
            self._begin(distance, time, track.position)
        if distance < -self._goal.within:
            raise GoalError(f"{self._goal.position:g} m was passed by {-distance:.4f} m, and the robot goes "
                            f"{way(self._reach)} only; give a smaller motor_speed or a wider tolerance")
        if time > self._duration:
            raise GoalError(f"{self._goal.position:g} m not reached within {self._duration:g} s: {distance:.4f} m are "
                            "left; give more time, or a wider motor_speed")
        if self._stopping:
            self._judge(distance, time)
        self._distances.append((time, distance))
        elapsed, self._time = time - self._time, time
        ahead = distance - self._braking_distance()
        if not self._stopping and ahead <= EARLY * self._goal.within:
            self._stopping = True
            self._distances.clear()
            self._distances.append((time, distance))
        return 0.0 if self._stopping else self._approach(distance, ahead, elapsed)

    def _begin(self, distance: float, time: float, position: float) -> None:
        """Say what it takes, or why it cannot be done, before anything moves."""
        self._begun, self._time = True, time
        if distance < -self._goal.within:
            raise GoalError(f"{self._goal.position:g} m is out of reach: the robot is at {position:.4f} m and goes "
                            f"{way(self._reach)} only; give a position beyond it")
        least = distance / abs(self._reach)
        if least > self._duration:
            raise GoalError(f"{self._goal.position:g} m is out of reach within {self._duration:g} s: {distance:.4f} m "
                            f"at {abs(self._reach):g} m/s take {least:.1f} s; give more time")
        self.words.append(f"{distance:.4f} m to go, in {max(least, 0.0):.1f} s at least")

    def _braking_distance(self) -> float:
        """What the robot goes on for [m] when the motor is told to stop, by its speed in `SPEED_OVER`."""
        recent = [one for one in self._distances if one[0] >= self._time - SPEED_OVER]
        span = recent[-1][0] - recent[0][0]
        return max(0.0, recent[0][1] - recent[-1][1]) / span * BRAKING if span > 0.5 * SPEED_OVER else 0.0

    def _approach(self, distance: float, ahead: float, elapsed: float) -> float:
        while self._distances[0][0] < self._time - LOOK_BACK:
            self._distances.popleft()
        came = self._distances[0][1] - distance
        seen = self._time - self._distances[0][0] >= 0.9 * LOOK_BACK
        boost = BOOST * elapsed * (1.0 if seen and came < min(NEARER[0] * distance, NEARER[1]) else -1.0)
        self._share = min(max(self._share + boost, CREEP), 1.0)
        slowed = self._share + (1.0 - self._share) * ahead / (APPROACH * abs(self._reach))
        return self._low + (self._high - self._low) * min(1.0, slowed)

    def _judge(self, distance: float, time: float) -> None:
        """Once the body is at rest: done, or on again."""
        while len(self._distances) > 1 and self._distances[1][0] <= time - STANDSTILL[0]:
            self._distances.popleft()
        moved = abs(self._distances[0][1] - distance)
        if time - self._distances[0][0] < STANDSTILL[0] or moved > STANDSTILL[1] * self._goal.within:
            return
        if distance <= self._goal.within:
            self.over = True
            self.words.append(f"reached after {time:.1f} s: {abs(distance) * 1e3:.1f} mm "
                              f"{'short of' if distance > 0.0 else 'beyond'} {self._goal.position:g} m, and at rest")
            return
        self._stopping = False
        self._distances.clear()
