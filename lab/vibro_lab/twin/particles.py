"""The particles of the online estimator: simulators with parameters of their own, and Kalman filters beside them.

A body's position enters no equation, so each particle has a Kalman filter of the place where its simulation began. An
encoder is finer than particles could ever lie, so each has a Kalman filter of its crank's angle, too.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from vibro_ros import ACCELERATIONS, SAMPLE_FIELDS, Scene, SimulationError, Simulator, force_at_rest

STEP = 0.05
"""Duration of a step of the filter [s]."""
INDEX = {name: k for k, name in enumerate(SAMPLE_FIELDS)}
LATENCY = 0.0025
"""Mean time [s] from a command's arrival to its effect: half a tick of a robot at 200 Hz."""
LATE = 0.05
"""Standard deviation of that time [s], because a busy machine delivers a message late now and then."""
MOST = 5
"""Most measurements of a quantity that are used in a step, because each instant costs all particles some microseconds.
"""
TAIL = 4.0
"""Degrees of freedom of the Student distribution of errors."""
MODEL_ERROR = {**dict.fromkeys(ACCELERATIONS, 0.6), "crank_angle": 1e-3, "motor_speed": 0.5}
"""Standard deviations of what even the best particle lacks, besides the errors of a sensor, in the quantity's unit."""
WALK = {"body_position": 0.003, **dict.fromkeys(ACCELERATIONS, 1e-3), "crank_angle": 1e-4}
"""Random walks in a second of what the sensors' readings differ by from what the simulations say: of the place where a
simulation began, because the mean speed has errors; of an IMU's bias; and of the crank's angle."""
UNEVEN = 1e-2
"""Random walk of the angle of a dc motor [rad in a second]."""
LEAST_TURN = 1e-3
"""Smallest correction of a crank's angle [rad]; each one begins a segment of the solver, which costs time."""


class Measurement(NamedTuple):
    """One measured number.

    Attributes
    ----------
    time : float
        Instant of the measurement [s].
    field : str
        A field of `Samples`, or one of `ACCELERATIONS`: specific force [m/s²] after the IMU's low-pass.
    value, variance : float
        The measured value, and the variance of its error.
    limit : float
        Magnitude at which the sensor clips; the prediction is clipped likewise.
    """

    time: float
    field: str
    value: float
    variance: float
    limit: float = math.inf


class Innovation(NamedTuple):
    """A measured value less the predicted one, and the variance that the filter expects of this difference."""

    time: float
    field: str
    value: float
    variance: float


class Particle:
    """A simulator with parameters of its own, which began at the instant `start` [s] of the filter.

    From `settled` on [s], the IMU's low-pass has forgotten how it began.
    """

    def __init__(self, scene: Scene, bandwidth: float, start: float):
        self.device, self.scene, self.start = Simulator(scene, bandwidth), scene, start
        self.settled, self.is_alive = start, True

    def kept(self) -> "Kept":
        """Return the present state, for a replay."""
        return Kept(self.scene, self.start, self.settled, self.device.checkpoint())

    def predict(self, instants: Mapping[float, tuple[list[tuple[int, Measurement]], list[dict[str, float]]]],
                predicted: np.ndarray) -> None:
        """Advance to each instant [s], fill in what the sensors would measure there, and pass on the commands."""
        at_rest = force_at_rest(self.scene)
        for time, (measured, commands) in instants.items():
            self.device.advance_to(max(time - self.start, self.device.time))
            values, force = self.device.values, None
            for k, one in measured:
                if one.field not in ACCELERATIONS:
                    predicted[k] = values.item(INDEX[one.field])
                elif time >= self.settled:
                    force, axis = force or self.device.filtered_acceleration(), ACCELERATIONS.index(one.field)
                    predicted[k] = force[axis] + at_rest[axis]
            for given in commands:
                with suppress(ValueError):  # the robot refuses it, too
                    self.device.command(**given)


class Kept(NamedTuple):
    """A particle's state, for a replay."""

    scene: Scene
    start: float
    settled: float
    checkpoint: np.ndarray

    def restored(self, bandwidth: float) -> Particle:
        """Return a new particle in this state; `bandwidth` is that of the IMU's low-pass [Hz]."""
        particle = Particle(self.scene, bandwidth, self.start)
        particle.device.restore(self.checkpoint)
        particle.settled = self.settled
        return particle


class Offsets:
    """Kalman filters of the particles: of the offset of each field in `WALK`, by which a measurement differs from what
    the particle's simulation says of it besides noise.

    The arrays in `mean` and `variance`, by field, have the shape (particles,). The crank's mean stays 0, because the
    simulation is turned instead. `misfit` is the sum of what the errors of `heard` measurements cost in log
    likelihood, half a unit each on average if model and noise are right; the crank's angle is left out, because
    replays do not correct it.
    """

    def __init__(self, count: int):
        self.mean = {"body_position": np.zeros(count)}
        self.variance = {"body_position": np.full(count, 1e6), "crank_angle": np.full(count, 1e-6)}
        self.misfit, self.heard = np.zeros(count), 0

    def part(self, chosen: np.ndarray) -> "Offsets":
        """Return the filters of the particles `chosen`, by number."""
        part = Offsets(len(chosen))
        part.mean, part.variance = ({field: values[chosen] for field, values in one.items()}
                                    for one in (self.mean, self.variance))
        return part

    def grow(self, faster: np.ndarray | float, is_loaded: bool) -> None:
        """Increase the variances by what a step may add; the cranks have become `faster` by so much [rad/s].

        A change of speed begins at an instant that is known to `LATE` only. A dc motor is loaded, so that its crank
        does not turn evenly.
        """
        for field, variance in self.variance.items():
            self.variance[field] = variance + WALK[field]**2 * STEP
        self.variance["crank_angle"] += (LATE * faster)**2 + is_loaded * UNEVEN**2 * STEP

    def weigh(self, measured: Sequence[Measurement], predicted: np.ndarray, weights: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray, list[Innovation]]:
        """Update the offsets; return log likelihoods and angles [rad] to turn the cranks by, shape (particles,) each,
        and the innovations of the particles with the given `weights`.

        Parameters
        ----------
        measured : sequence of Measurement
            n measurements, by time.
        predicted : ndarray, shape (particles, n)
            What each particle predicts; NaN where it cannot.
        weights : ndarray, shape (particles,)
        """
        nothing, innovations = np.zeros(len(weights)), []
        gains, angles, noise = nothing, [], 0.0
        for one, column in zip(measured, predicted.T, strict=True):
            known = np.isfinite(column)
            shares = np.where(known, weights, 0.0)
            if not shares.sum() > 0.0:
                continue
            own = self.variance.get(one.field, nothing)
            if one.field in ACCELERATIONS and one.field not in self.variance:
                own = np.full(len(weights), one.variance)  # an IMU's variance is mostly that of its bias
            column = np.where(known, column, 0.0) + self.mean.get(one.field, nothing)
            column = np.clip(column, -one.limit, one.limit)
            error = np.where(known, one.value - column, 0.0)
            of_sensor = one.variance + MODEL_ERROR.get(one.field, 0.0)**2
            total = own + of_sensor
            surprise = error**2 / total
            misfit = 0.5 * (TAIL + 1.0) * np.log1p(surprise / TAIL)
            gains = gains - misfit - np.where(known, 0.5 * np.log(total), 0.0)
            shares = shares / shares.sum()
            mean = shares @ column
            innovations.append(Innovation(one.time, one.field, float(one.value - mean),
                                          float(shares @ ((column - mean)**2 + own) + of_sensor)))
            if one.field == "crank_angle":
                angles.append(error)
                noise = of_sensor
                continue
            self.misfit, self.heard = self.misfit + misfit, self.heard + 1
            if one.field in WALK:
                share = own / (own + of_sensor * (TAIL + surprise) / (TAIL + 1.0))  # an outlier counts for less
                share = np.where(known, share, 0.0)
                self.mean[one.field] = self.mean.get(one.field, nothing) + share * error
                self.variance[one.field] = (1.0 - share) * own
        turns = nothing
        if angles:
            error, noise, own = np.mean(angles, axis=0), noise / len(angles), self.variance["crank_angle"]
            own = np.maximum(own, np.where(error**2 > 9.0 * noise, error**2, 0.0))  # believe a surprise
            share = own / (own + noise)
            if np.abs(share * error).max() > LEAST_TURN:  # to turn a crank begins a segment, and costs
                turns, self.variance["crank_angle"] = share * error, (1.0 - share) * own
        return gains, turns, innovations


def run(particles: Sequence[Particle], measured: Sequence[Measurement],
        commands: Sequence[tuple[float, dict[str, float]]], end: float) -> np.ndarray:
    """Advance the particles to `end` [s], and return what each predicts, shape (particles, measurements).

    A particle that cannot go on is no longer alive, and predicts NaN from then on.
    """
    instants = {time: ([(k, one) for k, one in enumerate(measured) if one.time == time],
                       [given for at, given in commands if at == time])
                for time in sorted({one.time for one in measured} | {at for at, _ in commands} | {end})}
    predicted = np.full((len(particles), len(measured)), np.nan)
    for row, particle in zip(predicted, particles, strict=True):
        if particle.is_alive:
            try:
                particle.predict(instants, row)
            except (SimulationError, ValueError):
                particle.is_alive = False
    return predicted


def thinned(measured: Iterable[Measurement]) -> list[Measurement]:
    """Return at most `MOST` measurements of each quantity, evenly chosen, by time."""
    by_field: dict[str, list[Measurement]] = {}
    for one in sorted(measured):
        by_field.setdefault(one.field, []).append(one)
    kept = [one for many in by_field.values() for one in (many if len(many) <= MOST else [
        many[round(k)] for k in np.linspace(0, len(many) - 1, MOST)])]
    return sorted(kept)


