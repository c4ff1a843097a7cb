"""The online estimator's settings and particles: simulators with parameters of their own, and Kalman filters.

A body's position enters no equation, so each particle has a Kalman filter of the place where its simulation began. An
encoder is finer than particles could ever lie, so each has a Kalman filter of its crank's angle, too.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibro_ros import ACCELERATIONS, SAMPLE_FIELDS, Scene, SimulationError, Simulator, force_at_rest

INDEX = {name: k for k, name in enumerate(SAMPLE_FIELDS)}
"""Column of each field in `Simulator.values`."""
STEP = 0.05
"""Duration of a step of the filter [s]."""


@dataclass(frozen=True)
class FilterSettings:
    """The tuned numbers of the filter, in SI units: the meaning of each, and why it has this value.

    They were chosen on the robots of `lab/test/twin/following.py`; `python lab/test/twin/following.py settings` halves
    and doubles each of them and prints which of the twin's verdicts change.
    """

    # What a command and a measurement are worth
    latency: float = 0.0025  # s; mean time from a command's arrival to its effect: half a tick of a robot at 200 Hz
    lateness: float = 0.05  # s; standard deviation of that time: a busy machine delivers a message late now and then
    most_measured: int = 5  # of a quantity in a step; each instant costs all particles some microseconds
    tail: float = 4.0  # degrees of freedom of the Student distribution of errors
    acceleration_error: float = 0.6  # m/s²; what even the best particle lacks, besides the errors of the sensor
    crank_error: float = 1e-3  # rad; the same for the angle of the crank
    motor_speed_error: float = 0.5  # rad/s

    # Random walks of what the sensors' readings differ by from what the simulations say, in a second
    place_walk: float = 0.003  # m; the mean speed of a particle has errors
    bias_walk: float = 1e-3  # m/s²; of an IMU
    crank_walk: float = 1e-4  # rad; of a motor with a commanded speed
    loaded_crank_walk: float = 1e-2  # rad; of a dc motor, whose crank does not turn evenly
    least_turn: float = 1e-3  # rad; smallest correction of a crank's angle: each one begins a segment, and costs time

    # Weights, and copies of likely particles
    in_use: float = 0.4  # share of effective particles that tempering leaves
    resampled: float = 0.9  # share of effective particles below which they are resampled
    forgetting: float = 0.05  # share by which the logarithms of a copy's parameters are drawn to their mean
    pull: float = 0.05  # share by which that mean is drawn to what was believed: copies would soon share wrong ones
    place_scatter: float = 1.5e-6  # m; noise of the masses' places in each copy: a chaotic robot makes of more
    speed_scatter: float = 1.5e-4  # m/s; an error that no measurement takes back
    state_scatter: float = 0.1  # share of the particles' own deviation that is added to that noise

    # The start
    unlike_speed: float = 5.0  # rad/s; difference from which the encoder's speed is adopted
    unlike_angle: float = 0.1  # rad; difference from which the encoder's angle is adopted
    first_speed: float = 0.5  # s; the speed is then measured again over this time: at first the encoder is coarse

    # What is published
    least_place_deviation: float = 1e-4  # m; no estimate claims to be better, whatever the particles agree on
    least_speed_deviation: float = 3e-4  # m/s
    growth_memory: float = 1.0  # s; over which the innovations are averaged that let the speed's variance grow

    # When a robot has left the model, and which fault it has
    unusual: float = 4.0  # mean normalised square of innovations that is unusual when four times the usual one is added
    memory: float = 3.0  # s; over which the usual square is found
    most_usual: float = 25.0  # largest square that counts for it
    settling: float = 1.0  # s after a start in which nothing counts as unusual
    unexplained: float = 0.6  # s after which a departure without a name is reported
    given_up: float = 3.0  # s after which the filter starts again
    recent_begin: int = 4  # steps before now at which a fault may have begun that shows at once,
    early_begin: int = 10  # and at which one that shows slowly
    most_kept: int = 20  # steps that are kept for replays: a stuck plate shows so long after its command
    replayed: int = 4  # particles whose states are kept for replays
    check_period: float = 0.2  # s; least time between two comparisons of faults, each of which costs some tenths
    replayed_phase: float = 0.03  # rad; least deviation of a crank's angle in replays, which do not correct it
    named: float = 15.0  # log ratio of likelihoods from which a fault is named: many a fault is likelier than a lost
    margin: float = 5.0  # chaotic robot without one; and by how much it must exceed every other fault
    repeated: int = 5  # least number of equal values by which a sensor may have frozen


class MeasuredNumber(NamedTuple):
    """One measured number."""

    time: float  # instant of the measurement [s]
    field: str  # a field of `Samples`, or one of `ACCELERATIONS`: specific force [m/s²] after the IMU's low-pass
    value: float  # the measured value, and the variance of its error
    variance: float
    limit: float = math.inf  # magnitude at which the sensor clips; the prediction is clipped likewise


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

    def kept(self) -> "KeptParticle":
        """Return the present state, for a replay."""
        return KeptParticle(self.scene, self.start, self.settled, self.device.checkpoint())

    def predict(self, instants: Mapping[float, tuple[list[tuple[int, MeasuredNumber]], list[dict[str, float]]]],
                predicted: np.ndarray) -> None:
        """Advance to each instant [s], fill in what the sensors would measure there, and pass on the commands."""
        at_rest = force_at_rest(self.scene)
        for time, (measured, commands) in instants.items():
            self.device.advance_to(max(time - self.start, self.device.time))
            values, force = self.device.values, None
            for k, measurement in measured:
                if measurement.field not in ACCELERATIONS:
                    predicted[k] = values.item(INDEX[measurement.field])
                elif time >= self.settled:
                    force, axis = force or self.device.filtered_acceleration(), ACCELERATIONS.index(measurement.field)
                    predicted[k] = force[axis] + at_rest[axis]
            for given in commands:
                with suppress(ValueError):  # the robot refuses it, too
                    self.device.command(**given)


class KeptParticle(NamedTuple):
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
    """Kalman filters of the particles, one for the offset of each field in `_walks`.

    An offset is the difference, besides noise, between a measurement and the particle's simulation; it is a random
    walk. The arrays in `mean` and `variance`, by field, have the shape (particles,). The crank's mean stays 0, because
    the simulation is turned instead. `misfit` is the sum of the log likelihoods that the errors of `misfit_count`
    measurements cost, half a unit each on average if model and noise are right. The crank's angle is left out, because
    replays do not correct it.
    """

    def __init__(self, count: int, settings: FilterSettings):
        self._settings = settings
        self._walks = {"body_position": settings.place_walk, **dict.fromkeys(ACCELERATIONS, settings.bias_walk),
                       "crank_angle": settings.crank_walk}
        self._model_error = {**dict.fromkeys(ACCELERATIONS, settings.acceleration_error),
                             "crank_angle": settings.crank_error, "motor_speed": settings.motor_speed_error}
        self.mean = {"body_position": np.zeros(count)}
        self.variance = {"body_position": np.full(count, 1e6), "crank_angle": np.full(count, 1e-6)}
        self.misfit, self.misfit_count = np.zeros(count), 0

    def of_particles(self, chosen: np.ndarray) -> "Offsets":
        """Return the filters of the particles `chosen`, by number."""
        offsets = Offsets(len(chosen), self._settings)
        offsets.mean = {field: values[chosen] for field, values in self.mean.items()}
        offsets.variance = {field: values[chosen] for field, values in self.variance.items()}
        return offsets

    def error_of(self, measurement: MeasuredNumber) -> float:
        """Return the variance of the difference between a measurement and the best particle: of sensor and model."""
        return measurement.variance + self._model_error.get(measurement.field, 0.0)**2

    def grow(self, faster: np.ndarray | float, is_loaded: bool) -> None:
        """Increase the variances for one step, in which the cranks' speed has grown by `faster` [rad/s].

        A change of speed begins at an instant that is known to `FilterSettings.lateness` only. A dc motor is loaded, so
        that its crank does not turn evenly.
        """
        for field, variance in self.variance.items():
            self.variance[field] = variance + self._walks[field]**2 * STEP
        self.variance["crank_angle"] += ((self._settings.lateness * faster)**2
                                         + is_loaded * self._settings.loaded_crank_walk**2 * STEP)

    def weigh(self, measured: Sequence[MeasuredNumber], predicted: np.ndarray, weights: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray, list[Innovation]]:
        """Update the offsets by measurements in their order.

        `predicted`, shape (particles, measurements), has the prediction of each particle, or NaN. Returns log
        likelihoods and angles [rad] to turn the cranks by, shape (particles,) each, and the innovations of the
        particles with the given `weights`.
        """
        zeros, innovations, tail = np.zeros(len(weights)), [], self._settings.tail
        gains, crank_errors, crank_variance = zeros, [], 0.0
        for measurement, column in zip(measured, predicted.T, strict=True):
            field = measurement.field
            known = np.isfinite(column)
            shares = np.where(known, weights, 0.0)
            if not shares.sum() > 0.0:
                continue
            of_offset = self.variance.get(field, zeros)
            if field in ACCELERATIONS and field not in self.variance:
                of_offset = np.full(len(weights), measurement.variance)  # an IMU's variance is mostly that of its bias
            column = np.where(known, column, 0.0) + self.mean.get(field, zeros)
            column = np.clip(column, -measurement.limit, measurement.limit)
            error = np.where(known, measurement.value - column, 0.0)
            of_error = self.error_of(measurement)
            total = of_offset + of_error
            surprise = error**2 / total
            misfit = 0.5 * (tail + 1.0) * np.log1p(surprise / tail)
            gains = gains - misfit - np.where(known, 0.5 * np.log(total), 0.0)
            shares = shares / shares.sum()
            mean = shares @ column
            innovations.append(Innovation(measurement.time, field, float(measurement.value - mean),
                                          float(shares @ ((column - mean)**2 + of_offset) + of_error)))
            if field == "crank_angle":
                crank_errors.append(error)
                crank_variance = of_error
                continue
            self.misfit, self.misfit_count = self.misfit + misfit, self.misfit_count + 1
            if field in self._walks:
                doubtful = of_error * (tail + surprise) / (tail + 1.0)  # an outlier counts for less
                share = np.where(known, of_offset / (of_offset + doubtful), 0.0)
                self.mean[field] = self.mean.get(field, zeros) + share * error
                self.variance[field] = (1.0 - share) * of_offset
        turns = self._crank_turns(crank_errors, crank_variance) if crank_errors else zeros
        return gains, turns, innovations

    def _crank_turns(self, errors: Sequence[np.ndarray], variance: float) -> np.ndarray:
        """Update the crank's filter by errors of its angle [rad] with a variance; returns angles to turn the cranks by.
        """
        error, noise, of_angle = np.mean(errors, axis=0), variance / len(errors), self.variance["crank_angle"]
        of_angle = np.maximum(of_angle, np.where(error**2 > 9.0 * noise, error**2, 0.0))  # believe a surprise
        share = of_angle / (of_angle + noise)
        if np.abs(share * error).max() <= self._settings.least_turn:
            return np.zeros_like(error)
        self.variance["crank_angle"] = (1.0 - share) * of_angle
        return share * error


def run(particles: Sequence[Particle], measured: Sequence[MeasuredNumber],
        commands: Sequence[tuple[float, dict[str, float]]], end: float) -> np.ndarray:
    """Advance the particles to `end` [s], and return what each predicts, shape (particles, measurements).

    A particle that cannot go on is no longer alive, and predicts NaN from then on.
    """
    instants = {time: ([(k, measurement) for k, measurement in enumerate(measured) if measurement.time == time],
                       [given for at, given in commands if at == time])
                for time in sorted({measurement.time for measurement in measured} | {at for at, _ in commands} | {end})}
    predicted = np.full((len(particles), len(measured)), np.nan)
    for row, particle in zip(predicted, particles, strict=True):
        if particle.is_alive:
            try:
                particle.predict(instants, row)
            except (SimulationError, ValueError):
                particle.is_alive = False
    return predicted


def thinned(measured: Iterable[MeasuredNumber], most: int) -> list[MeasuredNumber]:
    """Return at most `most` measurements of each quantity, evenly chosen, by time."""
    by_field: dict[str, list[MeasuredNumber]] = {}
    for measurement in sorted(measured):
        by_field.setdefault(measurement.field, []).append(measurement)
    kept = [measurement for series in by_field.values() for measurement in (series if len(series) <= most else [
        series[round(k)] for k in np.linspace(0, len(series) - 1, most)])]
    return sorted(kept)
