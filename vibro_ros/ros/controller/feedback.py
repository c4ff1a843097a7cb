"""Feedback from the position of the body to the speed of the motor: one entry of a script under way.

The mean speed over the motor's speed is neither monotonic nor single-valued: it has peaks where the crank meets the
masses' resonances, and may depend on what went before. So no law here trusts its slope. What `holding.py` and
`approach.py` rest on is that the robot stands still while the motor does, goes one way only, and goes at least at
`reach` at the largest motor speed.

Nothing in the three knows ROS: the caller says what time it is and what odometry told.
"""

from vibro_ros.ros.controller.approach import Approach
from vibro_ros.ros.controller.goals import Goal, GoalError, SpeedGoal
from vibro_ros.ros.controller.holding import Holding
from vibro_ros.ros.controller.track import Track

RATE = 20.0
"""Commands a second."""
SILENCE = 2.0
"""Longest time [s] without a new sample of odometry."""
MOST_LEAPS = 3
"""Leaps of the position in one entry after which odometry is not believed any more."""


class Pursuit:
    """A goal, and the law by which it is pursued.

    Parameters
    ----------
    goal : Goal
        What to reach.
    began : float
        When the entry begins, in the time of the calls [s].
    duration : float
        How long to hold a speed, or the longest time to reach a position [s].
    reach : float
        Mean speed [m/s] that the robot holds at most; its sign is that of the way it goes.
    track : Track
        What odometry tells; the caller adds to it.
    """

    def __init__(self, goal: Goal, began: float, duration: float, reach: float, track: Track):
        self._began, self._track, self._leaps = began, track, track.leaps
        self._law: Holding | Approach = (Holding(goal, duration, reach) if isinstance(goal, SpeedGoal)
                                         else Approach(goal, duration, reach))

    @property
    def over(self) -> bool:
        """Whether the position was reached, or the speed held to the end."""
        return self._law.over

    def take_words(self) -> list[str]:
        """What there is to say since the last call."""
        words, self._law.words = self._law.words, []
        return words

    def motor_speed(self, time: float) -> float | None:
        """The motor speed [rad/s] to command at `time` [s]; None as long as odometry has told nothing.

        Raises
        ------
        GoalError
            With the reason; the motor is then to be stopped.
        """
        self._check_odometry(time)
        if self._track.position is None:
            return None
        return self._law.step(time - self._began, self._track)

    def _check_odometry(self, time: float) -> None:
        track = self._track
        silence = time - max(self._began, self._began if track.heard is None else track.heard)
        if silence > SILENCE:
            refused = f", and {track.refused} samples refused, the last for {track.reason}" if track.refused else ""
            raise GoalError(f"no odometry for {silence:.1f} s{refused}; is there a robot that publishes odom?")
        if (leaps := track.leaps - self._leaps) > MOST_LEAPS:
            raise GoalError(f"the position in odom leapt {leaps} times; let one robot alone publish there")
