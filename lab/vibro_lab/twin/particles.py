"""The particles of the online estimator: simulators with parameters of their own, and Kalman filters beside them.

A body's position enters no equation, so each particle has a Kalman filter of the place where its simulation began. An
encoder is finer than particles could ever lie, so each has a Kalman filter of its crank's angle, too.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from vibro_lab.twin.settings import STEP, FilterSettings
from vibro_ros import ACCELERATIONS, SAMPLE_FIELDS, Scene, SimulationError, Simulator, force_at_rest

INDEX = {name: k for k, name in enumerate(SAMPLE_FIELDS)}


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
    """Kalman filters of the particles: of the offset of each field in `walks`, by which a measurement differs from what
    the particle's simulation says of it besides noise. Each offset is a random walk.

    The arrays in `mean` and `variance`, by field, have the shape (particles,). The crank's mean stays 0, because the
    simulation is turned instead. `misfit` is the sum of what the errors of `heard` measurements cost in log
    likelihood, half a unit each on average if model and noise are right; the crank's angle is left out, because
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
        self.misfit, self.heard = np.zeros(count), 0

    def part(self, chosen: np.ndarray) -> "Offsets":
        """Return the filters of the particles `chosen`, by number."""
        part = Offsets(len(chosen), self._settings)
        part.mean = {field: values[chosen] for field, values in self.mean.items()}
        part.variance = {field: values[chosen] for field, values in self.variance.items()}
        return part

    def error_of(self, measurement: MeasuredNumber) -> float:
        """Return the variance of what separates a measurement from the best particle: sensor and model."""
        return measurement.variance + self._model_error.get(measurement.field, 0.0)**2

    def grow(self, faster: np.ndarray | float, is_loaded: bool) -> None:
        """Increase the variances by what a step may add; the cranks have become `faster` by so much [rad/s].

        A change of speed begins at an instant that is known to `FilterSettings.lateness` only. A dc motor is loaded, so
        that its crank does not turn evenly.
        """
        for field, variance in self.variance.items():
            self.variance[field] = variance + self._walks[field]**2 * STEP
        self.variance["crank_angle"] += ((self._settings.lateness * faster)**2
                                         + is_loaded * self._settings.loaded_crank_walk**2 * STEP)

    def weigh(self, measured: Sequence[MeasuredNumber], predicted: np.ndarray, weights: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray, list[Innovation]]:
        """Update the offsets by measurements in their order, of which `predicted` has what each particle predicts, or
        NaN.

        Returns log likelihoods and angles [rad] to turn the cranks by, shape (particles,) each, and the innovations of
        the particles with the given `weights`.
        """
        nothing, innovations, tail = np.zeros(len(weights)), [], self._settings.tail
        gains, angles, noise = nothing, [], 0.0
        for measurement, column in zip(measured, predicted.T, strict=True):
            field = measurement.field
            known = np.isfinite(column)
            shares = np.where(known, weights, 0.0)
            if not shares.sum() > 0.0:
                continue
            of_offset = self.variance.get(field, nothing)
            if field in ACCELERATIONS and field not in self.variance:
                of_offset = np.full(len(weights), measurement.variance)  # an IMU's variance is mostly that of its bias
            column = np.where(known, column, 0.0) + self.mean.get(field, nothing)
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
                angles.append(error)
                noise = of_error
                continue
            self.misfit, self.heard = self.misfit + misfit, self.heard + 1
            if field in self._walks:
                doubtful = of_error * (tail + surprise) / (tail + 1.0)  # an outlier counts for less
                share = np.where(known, of_offset / (of_offset + doubtful), 0.0)
                self.mean[field] = self.mean.get(field, nothing) + share * error
                self.variance[field] = (1.0 - share) * of_offset
        turns = nothing
        if angles:
            error, noise, of_angle = np.mean(angles, axis=0), noise / len(angles), self.variance["crank_angle"]
            of_angle = np.maximum(of_angle, np.where(error**2 > 9.0 * noise, error**2, 0.0))  # believe a surprise
            share = of_angle / (of_angle + noise)
            if np.abs(share * error).max() > self._settings.least_turn:
                turns, self.variance["crank_angle"] = share * error, (1.0 - share) * of_angle
        return gains, turns, innovations


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
