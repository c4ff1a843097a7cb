"""The channels of a system's z: their order, and the index of each, for Python and for kernels.

    z = [q, q', a, f, f', f'', r, r', T, h, d, 1]

`system` says what each of them is.
"""

from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np

from vibro_ros.solver.typed import Kind, part, record


class Channels(NamedTuple):
    """Numbers of coordinates and forcing terms, which give the index of each channel in z."""

    coordinates: int
    dynamic: int
    signals: int
    ramps: int
    decays: int = 0  # or 1
    signal_accelerations: int = 0  # or as many as signals
    rotors: int = 0  # or 1: the phase and the charge are the last two dynamic coordinates

    @property
    def count(self) -> int:  # type: ignore[override]
        """Length of z."""
        twice = self.coordinates + self.signals + self.ramps
        return 2 * twice + self.dynamic + self.signal_accelerations + 2 * self.rotors + self.decays + 1

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

    def signal_acceleration(self, k: int) -> int:
        """Channel of signal k's second time derivative, if the system has `signal_accelerations`."""
        return self.signal(2 * self.signals) + k

    def ramp(self, k: int) -> int:
        """Channel of ramp k."""
        return self.signal(2 * self.signals) + self.signal_accelerations + k

    def ramp_rate(self, k: int) -> int:
        """Channel of ramp k's time derivative."""
        return self.ramp(self.ramps) + k

    @property
    def phase(self) -> int:
        """Number of the coordinate that is the phase, in a system with a rotor."""
        return self.dynamic - 2

    @property
    def charge(self) -> int:
        """Number of the coordinate that is the charge, whose rate is the motor's current; with a rotor only."""
        return self.dynamic - 1

    @property
    def torque(self) -> int:
        """Channel of the torque on the phase by the loads of the signals; with a rotor only."""
        return self.ramp_rate(self.ramps)

    @property
    def held(self) -> int:
        """Channel of the voltage or current that the motor is held at until its next sample; with a rotor only."""
        return self.torque + 1

    @property
    def decay(self) -> int:
        """Channel of the decaying term."""
        return self.count - 2

    @property
    def one(self) -> int:
        """Channel of the constant 1."""
        return self.count - 1


#: `Channels` as kernels read it: `system.counts[0].coordinates`.
COUNTS = record([(name, np.int64) for name in Channels._fields])
Counts: TypeAlias = Annotated[np.ndarray, Kind(COUNTS, 1)]
Count: TypeAlias = Annotated[Any, Kind(COUNTS, 0)]


def counts_of(channels: Channels) -> np.ndarray:
    """Return `System.counts` of a system with these channels."""
    return np.array([tuple(channels)], COUNTS)


def channels_of(counts: np.ndarray) -> Channels:
    """Return the `Channels` of a system with this `System.counts`."""
    return Channels(*(int(number) for number in counts[0]))


# First channels of each kind, for kernels, which cannot call methods.


@part
def first_acceleration(counts: Count) -> int:
    """Channel of the first dynamic coordinate's acceleration."""
    return 2 * counts.coordinates


@part
def first_signal(counts: Count) -> int:
    """Channel of the first signal; those of the signals' rates, and of their accelerations, follow the signals."""
    return 2 * counts.coordinates + counts.dynamic


@part
def first_ramp(counts: Count) -> int:
    """Channel of the first ramp; those of the ramps' rates follow the ramps."""
    return 2 * counts.coordinates + counts.dynamic + 2 * counts.signals + counts.signal_accelerations
