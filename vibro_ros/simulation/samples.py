"""Results of a simulation: quantities at the requested instants, as arrays or as a table; checks of the instants."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

if TYPE_CHECKING:
    import pandas

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
        Height above the ground [m] and its rate [m/s]; zero except by the rule `hop`.
    upper_position, upper_velocity, inclined_position, inclined_velocity : float or ndarray
        Positions of the masses along their guides from the crank's centre, outwards positive [m], and rates [m/s].
        Zero for a mass that the scene does not have, as are its forces and its plate below.
    crank_angle, motor_speed : float or ndarray
        theta [rad], which grows beyond 2 pi with every turn, and its rate [rad/s].
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
    motor_voltage, motor_current : float or ndarray
        Voltage [V] and current [A] of a dc motor; zero for another motor, as is `electrical_power`.
    electrical_power : float or ndarray
        Power from the supply, V i [W].
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
    motor_voltage: Quantity
    motor_current: Quantity
    electrical_power: Quantity

    @property
    def crank_speed(self) -> Quantity:
        """theta' [rad/s]: `motor_speed`, which is the true speed, not the commanded one."""
        return self.motor_speed


FIELDS = tuple(field.name for field in fields(Samples))
"""Names of the fields of `Samples`, in their order."""
TIME, NORMAL_FORCE, CRANK_ANGLE, MOTOR_SPEED = (
    FIELDS.index(name) for name in ("time", "normal_force", "crank_angle", "motor_speed"))


@dataclass(frozen=True)
class Run(Samples[np.ndarray]):
    """Samples of a whole simulation, with its events and statistics.

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

    def __repr__(self) -> str:
        span = f" from {self.time[0]:g} s to {self.time[-1]:g} s" if len(self.time) else ""
        kinds = ", ".join(f"{count} {kind}" for kind, count in zip(*np.unique(self.events["kind"], return_counts=True),
                                                                   strict=True))
        return f"<Run: {len(self.time)} samples{span}; events: {kinds or 'none'}>"

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the samples as a table of pandas, with the index ``time`` [s] and a column for every quantity.

        The events are another table, ``pandas.DataFrame(run.events)``.

        Raises
        ------
        ModuleNotFoundError
            Without pandas; the message says how to install it.

        Examples
        --------
        >>> table = vibro_ros.simulate(vibro_ros.load_scene("damped"), duration=1.0, rate=10.0).to_pandas()
        >>> f"{table['body_position'].iloc[-1]:.6f} m"
        '-0.057446 m'
        """
        return as_table({name: getattr(self, name) for name in FIELDS})


class Trace(NamedTuple):
    """The solver's samples at n instants."""

    points: np.ndarray  # shape (n, channels): every channel
    modes: np.ndarray  # shape (n,): numbers of modes
    phases: np.ndarray  # shape (n, 3): crank turns, the angle [rad] beyond them, and its rate [rad/s]

    def part(self, first: int, end: int) -> "Trace":
        """Return a view of the instants from number `first` to before `end`."""
        return Trace(self.points[first:end], self.modes[first:end], self.phases[first:end])


def one_sample(values: np.ndarray) -> Samples[float]:
    """Return the sample at one instant, from the values of all its `FIELDS`, shape (fields,).

    The constructor of a frozen class, which sets and checks each field, would double the cost of a tick's sample.
    """
    sample: Samples[float] = object.__new__(Samples)
    vars(sample).update(zip(FIELDS, values.tolist(), strict=True))
    return sample


AXES = "xyzw"  # ends of the names of an array's columns: `position.x` is the first column of `position`


def as_table(arrays: Mapping[str, np.ndarray]) -> "pandas.DataFrame":
    """Return arrays as a table with the index `time` [s].

    An array of shape (n, 3) becomes three columns such as `position.x`, `position.y` and `position.z`, one of shape
    (n, 4) a fourth one, `.w`. ModuleNotFoundError without pandas; the message says how to install it.
    """
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"to_pandas needs pandas ({error}): pip install pandas", name="pandas") from None
    columns: dict[str, np.ndarray] = {}
    for name, values in arrays.items():
        columns |= {name: values} if values.ndim == 1 else {
            f"{name}.{axis}": column for axis, column in zip(AXES, values.T, strict=False)}
    return pandas.DataFrame(columns, index=pandas.Index(columns.pop("time"), name="time"))


# Between two samples no crank turns by more than `_MOST_FACTOR` times the angle at the faster of its two speeds, plus
# `_MOST_OFFSET` [rad].
_MOST_FACTOR, _MOST_OFFSET = 2.0, 1.0


def resets(time: np.ndarray, crank_angle: np.ndarray, crank_speed: np.ndarray) -> np.ndarray:
    """Return whether the state was replaced between neighbouring samples, as by a reset; bool, shape (n - 1,).

    The crank has then turned against its speeds at both samples, or much farther than at these speeds.
    Instants [s], angle [rad] and its rate [rad/s] have the shape (n,).
    """
    turned, elapsed = np.diff(crank_angle), np.diff(time)
    speeds = np.stack([crank_speed[:-1], crank_speed[1:]])
    backwards = (turned * speeds <= 0.0).all(axis=0)
    too_far = np.abs(turned) > _MOST_FACTOR * np.abs(speeds).max(axis=0) * elapsed + _MOST_OFFSET
    return (turned != 0.0) & (backwards | too_far)


#: Latest instant [s] that can be requested, 31 years; there, neighbouring doubles are 1e-7 s apart.
LATEST = 1e9
#: Most samples of one run: their fields take 20 GB.
MOST_SAMPLES = 1e8


def sample_times(duration: float | None, rate: float | None, times: np.ndarray | None) -> np.ndarray:
    """Return the instants to sample [s], shape (n,), from the arguments of `simulate`; ValueError if invalid."""
    if times is None:
        if duration is None or rate is None:
            raise ValueError("give duration and rate, or times")
        if not (math.isfinite(duration) and duration >= 0.0 and math.isfinite(rate) and rate > 0.0):
            raise ValueError(f"duration {duration:g} s and rate {rate:g} Hz: give a duration of at least 0 and a "
                             "rate above 0")
        if duration > LATEST or duration * rate > MOST_SAMPLES:
            raise ValueError(f"duration {duration:g} s and rate {rate:g} Hz: give a duration of at most {LATEST:g} s "
                             f"and at most {MOST_SAMPLES:g} samples")
        return np.arange(int(math.floor(duration * rate * (1.0 + 1e-12))) + 1) / rate
    return checked_times(times, 0.0)


def checked_times(times: np.ndarray, start: float) -> np.ndarray:
    """Return a copy of the instants `times` [s], shape (n,); ValueError if they are invalid or before `start`."""
    times = np.array(times, dtype=float)  # the caller's may change between parts
    ends = times[[0, -1]] if times.ndim == 1 and len(times) else times  # which limit all, if they ascend
    if times.ndim != 1 or not ((times[:-1] <= times[1:]).all() and (start <= ends).all() and (ends < math.inf).all()):
        raise ValueError("times: give a one-dimensional, ascending array of finite instants, none below "
                         f"{start:.9g} s")
    if (ends > LATEST).any():
        raise ValueError(f"times: {times[-1]:g} s is too late; give instants up to {LATEST:g} s")
    return times
