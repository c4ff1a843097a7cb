"""Where each channel of a system stands in its vector z; `system` tells what the channels are."""

from typing import NamedTuple

import numpy as np

from vibro_ros.solver.compilation import kernel


class Channels(NamedTuple):
    """Where each channel stands in z."""

    coordinates: int
    dynamic: int
    signals: int
    ramps: int
    decays: int = 0  # or 1

    @property
    def count(self) -> int:
        """Length of z."""
        return 2 * (self.coordinates + self.signals + self.ramps) + self.dynamic + self.decays + 1

    def position(self, i: int) -> int:
        """Channel of coordinate i."""
        return i

    def velocity(self, i: int) -> int:
        """Channel of coordinate i's time derivative."""
        return self.coordinates + i

    def acceleration(self, i: int) -> int:
        """Channel of dynamic coordinate i's second time derivative."""
        return 2 * self.coordinates + i

    def signal(self, k: int) -> int:
        """Channel of signal k."""
        return 2 * self.coordinates + self.dynamic + k

    def signal_rate(self, k: int) -> int:
        """Channel of signal k's time derivative."""
        return self.signal(self.signals) + k

    def ramp(self, k: int) -> int:
        """Channel of ramp k."""
        return self.signal(2 * self.signals) + k

    def ramp_rate(self, k: int) -> int:
        """Channel of ramp k's time derivative."""
        return self.ramp(self.ramps) + k

    @property
    def decay(self) -> int:
        """Channel of the decaying term."""
        return self.count - 2

    @property
    def one(self) -> int:
        """Channel of the constant 1."""
        return self.count - 1


#: `Channels` as kernels read it: `system.size[0].coordinates`.
SIZE = np.dtype([(name, np.int64) for name in Channels._fields], align=True)


def size_of(channels: Channels) -> np.ndarray:
    """`System.size` of a system with these channels."""
    return np.array([tuple(channels)], SIZE)


def channels_of(size: np.ndarray) -> Channels:
    """Where each channel of a system with this `System.size` stands in z."""
    return Channels(*(int(number) for number in size[0]))


# Where the channels of one kind begin, for kernels, which can call no methods.


@kernel
def first_acceleration(size):
    """Channel of the first dynamic coordinate's acceleration."""
    return 2 * size.coordinates


@kernel
def first_signal(size):
    """Channel of the first signal; those of the signals' rates follow the signals."""
    return 2 * size.coordinates + size.dynamic


@kernel
def first_ramp(size):
    """Channel of the first ramp; those of the ramps' rates follow the ramps."""
    return 2 * size.coordinates + size.dynamic + 2 * size.signals
