"""A motor that stops when nobody commands it any more, as a drive with a watchdog does."""

from collections import Counter

from vibro_ros.simulation.simulator import Simulator

WATCHED = "motor_speed"


class CommandTimeout:
    """When too much robot time has passed since the last command of the motor's speed that took effect, or the start.

    Robot time, because then a replay finds the same instant, and a pause does not count.

    Parameters
    ----------
    limit : float
        Longest time [s].

    Attributes
    ----------
    count : int
        How often the motor was stopped.
    words : str
        What is said when it is.
    """

    def __init__(self, limit: float):
        self.count = 0
        self.words = (f"command.timeout: no {WATCHED} for {limit:g} s of robot time; the motor stops. Publish {WATCHED}"
                      " more often, or start the robot with a longer command.timeout")
        self._limit = limit
        self._last, self._accepted = 0.0, 0

    def is_over(self, time: float, accepted: Counter[str], device: Simulator) -> bool:
        """Whether the motor is to stop at robot time `time` [s], where so many commands were `accepted`."""
        if accepted[WATCHED] != self._accepted:
            self._last, self._accepted = time, accepted[WATCHED]
        if time - self._last < self._limit or not device.commanded_motor_speed:
            return False
        self.count += 1
        return True
