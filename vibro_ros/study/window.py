"""The time over which a study measures: after the motion has settled, and as far as possible in whole turns."""

import math
from dataclasses import dataclass

from vibro_ros.accuracy.starts import STARTING
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import LATEST

#: Most turns [-] of one window; doubles count them exactly, and a run of so many takes hours.
MOST_TURNS = 1e9
# Part of a turn that rounding may take from a duration that was meant to be whole turns.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Window:
    """A measuring time.

    Attributes
    ----------
    begin : float
        Its first instant [s].
    turn : float
        Time of a turn at the scene's motor speed [s]; infinite if the motor stands.
    turns : int
        Whole turns of the window; 0 if the motor stands or turns less than once.
    duration : float
        Its length [s]: of the turns, or, without one, as given.
    """

    begin: float
    turn: float
    turns: int
    duration: float

    @property
    def end(self) -> float:
        """Its last instant [s]."""
        return self.begin + self.duration


def window(scene: Scene, settling: float, duration: float) -> Window:
    """The largest whole number of turns within `duration` [s], after `settling` [s].

    The speed of the body swings within a turn, so that a part of a turn would give a mean of another kind.
    """
    turn = 2.0 * math.pi / scene["motor.speed"] if scene["motor.speed"] > 0.0 else math.inf
    turns = math.floor(min(duration / turn + _ROUNDING, MOST_TURNS))
    return Window(settling, turn, turns, turns * turn if turns else duration)


def checked_times(settling: float, duration: float, drawn_start: bool) -> None:
    """Refuse times of a measurement that make no sense.

    Parameters
    ----------
    settling, duration : float
        Time that does not count [s], and time that does [s].
    drawn_start : bool
        Whether the start is a drawn one, which takes `STARTING` seconds.

    Raises
    ------
    ValueError
        Naming the value, the limit and the remedy.
    """
    least = STARTING if drawn_start else 0.0
    if not least <= settling <= LATEST:
        reason = f" (a drawn start takes {STARTING:g} s)" if drawn_start else ""
        raise ValueError(f"settling: {settling:g} s is out of range; give a number from {least:g} to {LATEST:g} s"
                         f"{reason}")
    if not (0.0 < duration <= LATEST - settling):
        raise ValueError(f"duration: {duration:g} s is out of range; give a number above 0, at most "
                         f"{LATEST - settling:g} s")
