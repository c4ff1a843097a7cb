"""Which sample is the last, and when that is: for the device, for the robot, and for ROS."""

from vibro_ros.messages.fields import stamp_at


class RobotTime:
    """Times of a run's samples.

    Robot time is `ticks / rate` [s], never a sum of steps, so it does not drift, and nothing turns it back. The
    device's own time begins at 0 with each reset, so that what follows a reset has the bits of what follows a start.

    Parameters
    ----------
    rate : float
        Samples per second of robot time [Hz].
    start : int
        ROS time [ns] of robot time 0.

    Attributes
    ----------
    start : int
        The same; to be set before the first sample if it is not known earlier.
    ticks : int
        Number of the last sample, from 0.
    """

    def __init__(self, rate: float, start: int = 0):
        self.start = start
        self.ticks = 0
        self._rate = rate
        self._origin = 0  # the sample at which the device's time was 0

    @property
    def time(self) -> float:
        """Robot time [s] of the last sample."""
        return self.ticks / self._rate

    @property
    def due(self) -> float:
        """Robot time [s] of the next sample."""
        return (self.ticks + 1) / self._rate

    @property
    def due_of_device(self) -> float:
        """Time [s] of the next sample by the device's clock."""
        return (self.ticks + 1 - self._origin) / self._rate

    @property
    def at_start(self) -> bool:
        """Whether nothing has moved since the start or the last reset: no sample came after its first."""
        return self.ticks <= self._origin

    @property
    def stamp(self) -> int:
        """ROS time [ns] of the last sample."""
        return stamp_at(self.start, self.time)

    def stamp_of(self, time: float) -> int:
        """ROS time [ns] of a `time` [s] of the device's clock."""
        return stamp_at(stamp_at(self.start, self._origin / self._rate), time)

    def restart(self) -> None:
        """Let the device's time be 0 at the next sample."""
        self._origin = self.ticks + 1
