"""What a simulation returns: the device's quantities at the instants asked for."""

from dataclasses import dataclass, fields
from typing import Generic, NamedTuple, TypeVar

import numpy as np

EVENT_DTYPE = np.dtype([("time", float), ("kind", "U16"), ("speed", float), ("peak_force", float),
                        ("duration", float)])

#: A float at one instant, an array at several.
Quantity = TypeVar("Quantity", float, np.ndarray)


@dataclass(frozen=True)
class Samples(Generic[Quantity]):
    """The device at one instant (floats) or at n instants (arrays, shape (n,)). SI units, REP-103 signs.

    Attributes
    ----------
    time : float or ndarray
        Instant [s].
    body_position, body_velocity : float or ndarray
        x [m] and x' [m/s].
    body_height, body_vertical_velocity : float or ndarray
        Height above the ground [m] and its rate [m/s]; zero but for the rule `hop`.
    upper_position, upper_velocity, inclined_position, inclined_velocity : float or ndarray
        Positions of the masses along their guides from the crank's centre, outwards positive [m], and rates [m/s].
        Zero for a mass that the scene does not have, as everything of it below.
    crank_angle, motor_speed : float or ndarray
        theta [rad], counted on over the turns, and its rate [rad/s].
    motor_power, motor_torque : float or ndarray
        Work rate [W] of the sliders on the springs, positive when it drives the robot, and the torque
        on the crank [N m] that does it.
    normal_force, friction_force : float or ndarray
        N [N], and F_fr [N] with the paper's sign: positive opposes forward motion. The force on the body is -F_fr.
    upper_drive_force, inclined_drive_force : float or ndarray
        Force on the mass by its drive spring and damper [N], outwards positive.
    upper_plate_force, inclined_plate_force : float or ndarray
        Contact force [N], compression positive.
    upper_plate_position, upper_plate_velocity, inclined_plate_position, inclined_plate_velocity : float or ndarray
        Plates along their guides [m] and rates [m/s].
    """

    time: Quantity
    body_position: Quantity
    body_velocity: Quantity
    body_height: Quantity
    body_vertical_velocity: Quantity
    upper_position: Quantity
    upper_velocity: Quantity
    inclined_position: Quantity
    inclined_velocity: Quantity
    crank_angle: Quantity
    motor_speed: Quantity
    motor_power: Quantity
    motor_torque: Quantity
    normal_force: Quantity
    friction_force: Quantity
    upper_drive_force: Quantity
    inclined_drive_force: Quantity
    upper_plate_force: Quantity
    inclined_plate_force: Quantity
    upper_plate_position: Quantity
    upper_plate_velocity: Quantity
    inclined_plate_position: Quantity
    inclined_plate_velocity: Quantity


FIELDS = tuple(field.name for field in fields(Samples))
"""Names of the fields of `Samples`, in their order."""
TIME, NORMAL_FORCE, CRANK_ANGLE = (FIELDS.index(name) for name in ("time", "normal_force", "crank_angle"))


@dataclass(frozen=True)
class Run(Samples[np.ndarray]):
    """Samples of a whole simulation, with what happened between them.

    Attributes
    ----------
    events : structured ndarray, shape (events,)
        By time: `time` [s]; `kind`; and for the contacts `upper_contact` and `inclined_contact`, whose time is
        their first instant, approach `speed` [m/s], `peak_force` [N] and `duration` [s].
    statistics : dict
        Events by kind, `steps` (segments of the event loop), `wall_time` [s].
    """

    events: np.ndarray
    statistics: dict


class Trace(NamedTuple):
    """What the solver samples at n instants.

    Attributes
    ----------
    points : ndarray, shape (n, channels)
        Every channel.
    modes : ndarray of int, shape (n,)
        Numbers of modes.
    phases : ndarray, shape (n, 3)
        Crank turns, the angle [rad] beyond them, and its rate [rad/s].
    """

    points: np.ndarray
    modes: np.ndarray
    phases: np.ndarray

    def part(self, first: int, end: int) -> "Trace":
        """Return a view of the instants from number `first` to before `end`."""
        return Trace(self.points[first:end], self.modes[first:end], self.phases[first:end])


def one_sample(values: np.ndarray) -> Samples[float]:
    """The sample at one instant, from the values of all its `FIELDS`, shape (fields,).

    The constructor of a frozen class sets field by field and checks each: half of what a tick's sample would cost.
    """
    sample: Samples[float] = object.__new__(Samples)
    vars(sample).update(zip(FIELDS, values.tolist(), strict=True))
    return sample
