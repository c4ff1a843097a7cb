"""What a script's entry may ask for by feedback: a mean speed or a position; and what of it a robot can reach."""

from collections.abc import Iterable
from dataclasses import dataclass

WITHIN = 0.005
"""Default tolerance of a goal [m/s or m]."""
MOTOR_RANGE = (0.0, 100.0)
"""Default range of the motor's speed [rad/s] that feedback uses."""


class GoalError(RuntimeError):
    """A goal was not reached, or odometry cannot be believed."""


@dataclass(frozen=True)
class SpeedGoal:
    """A mean speed of the body to hold.

    Attributes
    ----------
    speed : float
        Mean speed [m/s]; negative backwards.
    within : float
        Largest deviation [m/s] of the mean over the second half of the entry.
    motor : tuple of float
        Least and largest motor speed [rad/s] to use.
    """

    speed: float
    within: float
    motor: tuple[float, float]

    def describe(self) -> str:
        """What is to be done, for people."""
        return f"hold {self.speed:g} m/s within {self.within:g} m/s, {_motor_text(self.motor)}"

    def check_reach(self, reach: float) -> None:
        """Refuse a speed that the robot does not hold.

        Parameters
        ----------
        reach : float
            Mean speed [m/s] that the robot holds at most; its sign is that of the way it goes.

        Raises
        ------
        ValueError
            With the speeds that it does hold.
        """
        if not 0.0 < self.speed / reach <= 1.0:
            low, high = sorted((0.0, reach))
            raise ValueError(f"hold_speed: {self.speed:g} m/s is out of reach of a robot that goes {way(reach)}; give "
                             f"one between {low:g} and {high:g} m/s, and not 0, or set `reach` for another robot")


@dataclass(frozen=True)
class PositionGoal:
    """A position of the body to reach, and to stand at.

    Attributes
    ----------
    position : float
        In the frame of `odom` [m].
    within : float
        Largest distance [m] from it at which to stand.
    motor : tuple of float
        Least and largest motor speed [rad/s] to use.
    """

    position: float
    within: float
    motor: tuple[float, float]

    def describe(self) -> str:
        """What is to be done, for people."""
        return f"go to {self.position:g} m within {self.within:g} m, {_motor_text(self.motor)}"


Goal = SpeedGoal | PositionGoal


def check_reach(goals: Iterable[tuple[str, Goal]], reach: float) -> None:
    """Refuse goals that a robot which goes one way only cannot reach, as far as that is known before it starts.

    Parameters
    ----------
    goals : iterable of (str, Goal)
        The number of the entry, and its goal, in order.
    reach : float
        Mean speed [m/s] that the robot holds at most, as in `SpeedGoal.check_reach`.

    Raises
    ------
    ValueError
        Naming the entry, the limit and the remedy.
    """
    before: tuple[str, PositionGoal] | None = None
    for entry, goal in goals:
        try:
            if isinstance(goal, SpeedGoal):
                goal.check_reach(reach)
            else:
                if before:
                    _check_order(goal, *before, reach)
                before = entry, goal
        except ValueError as error:
            raise ValueError(f"entry {entry}: {error}") from None


def way(reach: float) -> str:
    """The way that a robot of that `reach` [m/s] goes."""
    return "backwards" if reach < 0.0 else "forwards"


def _check_order(goal: PositionGoal, entry: str, before: PositionGoal, reach: float) -> None:
    if (goal.position - before.position) * reach < -(goal.within + before.within) * abs(reach):
        raise ValueError(f"go_to: {goal.position:g} m is out of reach after entry {entry} went to {before.position:g} "
                         f"m: the robot goes {way(reach)} only; give positions in the order in which it passes them")


def _motor_text(motor: tuple[float, float]) -> str:
    return f"motor {motor[0]:g} to {motor[1]:g} rad/s"
