"""Feedback control of the body's speed and position by the motor's speed: goals, odometry, two control laws.

The mean speed as a function of the motor's speed is neither monotonic nor single-valued: it has peaks at the resonances
of the masses, and may depend on the earlier motion. So no law here uses its slope. `SpeedLaw` and `PositionLaw` assume
only that the robot stands still while the motor does, goes in one direction only, and goes at least at `reach` at the
largest motor speed.

Nothing here needs ROS: the caller passes the time and the samples of odometry.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

DEFAULT_TOLERANCE = 0.005  # default tolerance of a goal [m/s or m]
DEFAULT_MOTOR_RANGE = (0.0, 100.0)  # default range of motor speeds [rad/s] that feedback uses


class GoalError(RuntimeError):
    """A goal was not reached, or odometry cannot be believed."""


@dataclass(frozen=True)
class SpeedGoal:
    """Goal of holding a mean speed [m/s] of the body; negative backwards.

    `within` is the tolerance [m/s] of the mean over the second half of the entry, `motor` the least and the largest
    motor speed [rad/s] to use.
    """

    speed: float
    within: float
    motor: tuple[float, float]

    def describe(self) -> str:
        """Return the goal in words."""
        low, high = self.motor
        return f"hold {self.speed:g} m/s within {self.within:g} m/s, motor {low:g} to {high:g} rad/s"


@dataclass(frozen=True)
class PositionGoal:
    """Goal of reaching a position [m] of the body, in the frame of `odom`, and stopping there.

    `within` is the tolerance [m] of the final position, `motor` the least and the largest motor speed [rad/s] to use.
    """

    position: float
    within: float
    motor: tuple[float, float]

    def describe(self) -> str:
        """Return the goal in words."""
        low, high = self.motor
        return f"go to {self.position:g} m within {self.within:g} m, motor {low:g} to {high:g} rad/s"


Goal = SpeedGoal | PositionGoal


def check_reach(goals: Iterable[tuple[str, Goal]], reach: float) -> None:
    """Refuse goals that a robot which goes in one direction only cannot reach, as far as known before it starts.

    `goals` are pairs of an entry's number and its goal, in order; `reach` is the largest mean speed [m/s] that the
    robot holds, with the sign of its direction. ValueError names the entry, the limit and the remedy.
    """
    last_position: tuple[str, PositionGoal] | None = None
    for entry, goal in goals:
        if isinstance(goal, SpeedGoal):
            if not 0.0 < goal.speed / reach <= 1.0:
                low, high = sorted((0.0, reach))
                raise ValueError(f"entry {entry}: hold_speed: {goal.speed:g} m/s is out of reach of a robot that goes "
                                 f"{direction(reach)}; give one between {low:g} and {high:g} m/s, and not 0, or set "
                                 "`reach` for another robot")
            continue
        if last_position:
            earlier, passed = last_position
            if (goal.position - passed.position) * reach < -(goal.within + passed.within) * abs(reach):
                raise ValueError(f"entry {entry}: go_to: {goal.position:g} m is out of reach after entry {earlier} "
                                 f"went to {passed.position:g} m: the robot goes {direction(reach)} only; give "
                                 "positions in the order in which it passes them")
        last_position = entry, goal


def direction(reach: float) -> str:
    """Return in words the direction in which a robot with this `reach` [m/s] goes."""
    return "backwards" if reach < 0.0 else "forwards"


WINDOW = 0.25  # time [s] over which a position is averaged, because the body swings with every turn of the crank
FARTHEST = 1e9  # largest distance [m] from the origin in odometry; a sample beyond is refused
LEAP, FASTEST = 0.1, 5.0
"""A step between two samples of more than `LEAP` [m] plus `FASTEST` [m/s] times their distance in time is a reset."""


class MeanPosition:
    """Moving average of the body's position over the last `WINDOW`, from samples of odometry in ascending time.

    `position` and `stamp` are the means over the window of the position [m] and of its time [s], counted from the first
    sample; None before it. `last_received` is the caller's time [s] at which the last sample was added. The window
    starts over at each leap of the position; `leaps` counts them. `refused` counts refused samples, `reason` says why
    the last was.
    """

    def __init__(self):
        self.last_received: float | None = None
        self.leaps = self.refused = 0
        self.reason = ""
        self._first: int | None = None
        self._samples: deque[tuple[float, float]] = deque()

    @property
    def position(self) -> float | None:
        """Mean position [m] of the window."""
        return math.fsum(position for _, position in self._samples) / len(self._samples) if self._samples else None

    @property
    def stamp(self) -> float | None:
        """Mean time [s] of the window."""
        return math.fsum(stamp for stamp, _ in self._samples) / len(self._samples) if self._samples else None

    def add(self, nanoseconds: int, position: float, time: float) -> None:
        """Add a sample with the stamp `nanoseconds` at the caller's `time` [s], or refuse it."""
        if not abs(position) <= FARTHEST:  # also for NaN
            self._refuse(f"a position of {position} m")
            return
        self._first = nanoseconds if self._first is None else self._first
        stamp = (nanoseconds - self._first) / 1e9
        if self._samples and stamp <= self._samples[-1][0]:
            self._refuse(f"a stamp {self._samples[-1][0] - stamp:g} s before the latest")
            return
        if self._samples and abs(position - self._samples[-1][1]) > LEAP + FASTEST * (stamp - self._samples[-1][0]):
            self.leaps += 1
            self._samples.clear()
        self.last_received = time
        self._samples.append((stamp, position))
        while self._samples[0][0] < stamp - WINDOW:
            self._samples.popleft()

    def _refuse(self, reason: str) -> None:
        self.refused, self.reason = self.refused + 1, reason


BANDWIDTH = 1.5
"""Bandwidth [rad/s] of the speed law, if the mean speed were proportional to the motor's speed up to `reach`."""
INTEGRAL = 0.25  # integral gain as a fraction of `BANDWIDTH` squared; with it the control would be critically damped
LONGEST_LEAD = 0.7
"""Largest distance of the target position from the body, as time [s] at `reach`: the target does not run away from a
robot that cannot follow, which would have to catch up later."""
LONGEST_STEP = 0.5  # longest time [s] that one step counts for, after a pause of odometry
SHORT_MEAN = 1.0  # time [s] of the mean speeds that show when the speed has settled, and how far it strays


class SpeedLaw:
    """Holds a mean speed: by a PI law the body follows a target position that moves at that speed.

    The mean speed is right as long as the distance to the target stays bounded. That works even where no motor speed
    gives the wanted mean: the motor then alternates between two speeds on either side of it. The mean is judged over
    the second half of `duration` [s].
    """

    def __init__(self, goal: SpeedGoal, duration: float, reach: float):
        self.over, self.words = False, list[str]()
        self._goal, self._duration, self._reach = goal, duration, reach
        self._low, self._high = goal.motor
        self._gain = BANDWIDTH * (self._high - self._low) / abs(reach)
        self._integral = self._low + (self._high - self._low) * min(1.0, goal.speed / reach)
        self._target = 0.0
        self._last_stamp = self._last_position = 0.0  # of the last step
        self._leaps: int | None = None  # leaps of the position until the last step; None before the first
        self._distance = self._span = 0.0
        self._short: deque[tuple[float, float]] = deque()
        self._settled: float | None = None
        self._strays = (goal.speed, goal.speed)
        self._at_high = self._at_low = 0.0

    def step(self, time: float, mean: MeanPosition) -> float:
        """Return the motor speed [rad/s] to command, `time` [s] after the beginning.

        GoalError at the end, when the speed was not held.
        """
        stamp, position = mean.stamp, mean.position
        assert stamp is not None and position is not None
        if self._leaps != mean.leaps:  # the first step, or one after a leap
            self._target = position
            self._short.clear()
            elapsed = 0.0
        else:
            elapsed = min(stamp - self._last_stamp, LONGEST_STEP)
            self._measure(time, stamp, position)
        self._last_stamp, self._last_position, self._leaps = stamp, position, mean.leaps
        if time >= self._duration:
            self._finish()
        return self._follow(elapsed, position)

    def _follow(self, elapsed: float, position: float) -> float:
        """Return the motor speed [rad/s] by the PI law, `elapsed` [s] after the last step."""
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
        """Add the distance since the last step to the mean; note whether the speed has settled, and its extremes."""
        self._short.append((stamp, position))
        while self._short[0][0] < stamp - SHORT_MEAN:
            self._short.popleft()
        span = stamp - self._short[0][0]
        if span >= 0.9 * SHORT_MEAN:
            mean = (position - self._short[0][1]) / span
            if self._settled is None and abs(mean - self._goal.speed) <= self._goal.within:
                self._settled = time
                self.words.append(f"settled after {time:.1f} s: mean over {SHORT_MEAN:g} s is {mean:.4f} m/s")
            if time >= self._duration / 2.0 + SHORT_MEAN:
                self._strays = min(mean, self._strays[0]), max(mean, self._strays[1])
        if time >= self._duration / 2.0:
            self._distance += position - self._last_position
            self._span += stamp - self._last_stamp

    def _finish(self) -> None:
        """End, with a GoalError if the mean speed misses the goal."""
        self.over = True
        if self._span < self._duration / 4.0:
            raise GoalError(f"odom covers {self._span:.1f} s of the last {self._duration / 2.0:g} s: too little to "
                            "know the mean speed")
        mean = self._distance / self._span
        low, high = self._strays
        summary = (f"mean speed {mean:.4f} m/s over the last {self._span:.1f} s, {low:.4f} to {high:.4f} m/s over "
                   f"{SHORT_MEAN:g} s each")
        if abs(mean - self._goal.speed) > self._goal.within:
            advice = "give more time or a wider tolerance"
            if self._at_high > self._duration / 4.0:
                advice = (f"the motor was at {self._high:g} rad/s for {self._at_high:.1f} s: the robot goes no faster "
                          f"{direction(self._reach)}; give a smaller speed or a wider motor_speed")
            elif self._at_low > self._duration / 4.0:
                advice = (f"the motor was at {self._low:g} rad/s for {self._at_low:.1f} s: the robot goes no slower; "
                          "give a larger speed or a wider motor_speed")
            wanted = f"{self._goal.speed:g} m/s not held within {self._goal.within:g} m/s"
            raise GoalError(f"{wanted}: {summary}; {advice}")
        self.words.append(f"held: {summary}")


APPROACH = 0.7
"""Distance at which the motor begins to slow down, as time [s] at `reach`; it is also the time constant of the
approach."""
CREEP = 0.3  # least motor speed of the approach, as a share of the motor's range: below it the robot hardly moves
BOOST = 0.1  # rate [1/s] at which this share grows while the robot does not come nearer
LOOK_BACK = 1.0  # time [s] over which it is checked whether the robot comes nearer
NEARER_SHARE, NEARER_DISTANCE = 0.1, 0.0005
"""The robot comes nearer if it covers this fraction of the distance, or this many metres, in `LOOK_BACK`."""
STOP_MARGIN = 0.1  # the motor stops when the distance left after braking is this fraction of the tolerance
BRAKING = 0.3
"""Time [s] for which a stopping robot counts as going on at its speed: half of its motor's ramp, and half of the window
of the mean."""
SPEED_OVER = 0.25  # time [s] over which the speed for the braking distance is measured
STANDSTILL_TIME, STANDSTILL_SHARE = 0.5, 0.05
"""The body is at rest when it moves by no more than this fraction of the tolerance in this time [s]."""


class PositionLaw:
    """Reaches a position within `duration` [s] and stops there, by a proportional law that never drives backwards."""

    def __init__(self, goal: PositionGoal, duration: float, reach: float):
        self.over, self.words = False, list[str]()
        self._goal, self._duration, self._reach = goal, duration, reach
        self._low, self._high = goal.motor
        self._share = CREEP
        self._begun = self._stopping = False
        self._distances: deque[tuple[float, float]] = deque()
        self._time = 0.0

    def step(self, time: float, mean: MeanPosition) -> float:
        """Return the motor speed [rad/s] to command, `time` [s] after the beginning; 0 at the end.

        GoalError when the position is out of reach, was passed, or was not reached in time.
        """
        assert mean.position is not None
        distance = (self._goal.position - mean.position) * (1.0 if self._reach > 0.0 else -1.0)
        if not self._begun:
            self._begin(distance, time, mean.position)
        if distance < -self._goal.within:
            raise GoalError(f"{self._goal.position:g} m was passed by {-distance:.4f} m, and the robot goes "
                            f"{direction(self._reach)} only; give a smaller motor_speed or a wider tolerance")
        if time > self._duration:
            raise GoalError(f"{self._goal.position:g} m not reached within {self._duration:g} s: {distance:.4f} m are "
                            "left; give more time, or a wider motor_speed")
        if self._stopping:
            self._judge(distance, time)
        self._distances.append((time, distance))
        elapsed, self._time = time - self._time, time
        ahead = distance - self._braking_distance()
        if not self._stopping and ahead <= STOP_MARGIN * self._goal.within:
            self._stopping = True
            self._distances.clear()
            self._distances.append((time, distance))
        return 0.0 if self._stopping else self._approach(distance, ahead, elapsed)

    def _begin(self, distance: float, time: float, position: float) -> None:
        """Check before anything moves whether the position can be reached, and say how long it takes at least."""
        self._begun, self._time = True, time
        if distance < -self._goal.within:
            raise GoalError(f"{self._goal.position:g} m is out of reach: the robot is at {position:.4f} m and goes "
                            f"{direction(self._reach)} only; give one {'above' if self._reach > 0.0 else 'below'} that")
        least = distance / abs(self._reach)
        if least > self._duration:
            raise GoalError(f"{self._goal.position:g} m is out of reach within {self._duration:g} s: {distance:.4f} m "
                            f"at {abs(self._reach):g} m/s take {least:.1f} s; give more time")
        self.words.append(f"{distance:.4f} m to go, in {max(least, 0.0):.1f} s at least")

    def _braking_distance(self) -> float:
        """Return the distance [m] that the robot still covers after the motor stops, by its speed over `SPEED_OVER`."""
        recent = [sample for sample in self._distances if sample[0] >= self._time - SPEED_OVER]
        span = recent[-1][0] - recent[0][0]
        return max(0.0, recent[0][1] - recent[-1][1]) / span * BRAKING if span > 0.5 * SPEED_OVER else 0.0

    def _approach(self, distance: float, ahead: float, elapsed: float) -> float:
        """Return the motor speed [rad/s] at this distance, `ahead` of which is left after braking [m]."""
        while self._distances[0][0] < self._time - LOOK_BACK:
            self._distances.popleft()
        approached = self._distances[0][1] - distance
        is_stuck = (self._time - self._distances[0][0] >= 0.9 * LOOK_BACK
                    and approached < min(NEARER_SHARE * distance, NEARER_DISTANCE))
        boost = BOOST * elapsed if is_stuck else -BOOST * elapsed
        self._share = min(max(self._share + boost, CREEP), 1.0)
        slowed = self._share + (1.0 - self._share) * ahead / (APPROACH * abs(self._reach))
        return self._low + (self._high - self._low) * min(1.0, slowed)

    def _judge(self, distance: float, time: float) -> None:
        """Once the body is at rest, end if it has reached the position, else drive on."""
        while len(self._distances) > 1 and self._distances[1][0] <= time - STANDSTILL_TIME:
            self._distances.popleft()
        moved = abs(self._distances[0][1] - distance)
        if time - self._distances[0][0] < STANDSTILL_TIME or moved > STANDSTILL_SHARE * self._goal.within:
            return
        if distance <= self._goal.within:
            self.over = True
            self.words.append(f"reached after {time:.1f} s: {abs(distance) * 1e3:.1f} mm "
                              f"{'short of' if distance > 0.0 else 'beyond'} {self._goal.position:g} m, and at rest")
            return
        self._stopping = False
        self._distances.clear()


RATE = 20.0  # rate of feedback [commands/s]
ODOMETRY_TIMEOUT = 2.0  # longest time [s] without a new sample of odometry
MOST_LEAPS = 3  # most leaps of the position in one entry; with more, odometry is not trusted any more


class GoalTracking:
    """Pursues a goal by its control law.

    The goal `began` at this time [s] of the caller; a speed is held for `duration` [s], a position must be reached
    within it. The caller adds the samples of odometry to `mean`.
    """

    def __init__(self, goal: Goal, began: float, duration: float, reach: float, mean: MeanPosition):
        self._began, self._mean, self._leaps = began, mean, mean.leaps
        self._law: SpeedLaw | PositionLaw = (SpeedLaw(goal, duration, reach) if isinstance(goal, SpeedGoal)
                                         else PositionLaw(goal, duration, reach))

    @property
    def over(self) -> bool:
        """Whether the position was reached, or the speed held to the end."""
        return self._law.over

    def take_words(self) -> list[str]:
        """Return the sentences for the log since the last call."""
        words, self._law.words = self._law.words, []
        return words

    def motor_speed(self, time: float) -> float | None:
        """Return the motor speed [rad/s] to command at `time` [s]; None before the first sample of odometry.

        GoalError when the goal is missed; the caller must then stop the motor.
        """
        mean = self._mean
        silence = time - max(self._began, self._began if mean.last_received is None else mean.last_received)
        if silence > ODOMETRY_TIMEOUT:
            refused = f", and {mean.refused} samples refused, the last for {mean.reason}" if mean.refused else ""
            raise GoalError(f"no odometry for {silence:.1f} s{refused}; is there a robot that publishes odom?")
        if (leaps := mean.leaps - self._leaps) > MOST_LEAPS:
            raise GoalError(f"the position in odom leapt {leaps} times; let one robot alone publish there")
        return None if mean.position is None else self._law.step(time - self._began, mean)
