"""Which fault a robot has: each that its scene can have is simulated from earlier states of a few particles.

The fault with the largest ratio of likelihoods is named if it is large enough (A. Willsky, H. Jones, "A generalized
likelihood ratio approach", 1976).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from vibro_lab.twin.particles import STEP, FilterSettings, KeptParticle, MeasuredNumber, Offsets, run
from vibro_ros import ACCELERATIONS, Incident, Scene

FOREVER, FAR = 86_400.0, 1e6
"""Longest duration of a fault [s], and farthest end of a stretch of the ground [m], that a device takes."""
FREEZE = "sensor_freeze"
"""The fault of a sensor that gives what it gave last."""
OF_MOTOR = ("motor_stall", "supply_sag")
"""Faults that an encoder shows at once, whatever the masses do."""
SENSORS: Mapping[str, tuple[str, ...]] = {"encoder": ("crank_angle",), "tracking": ("body_position", "body_height"),
                                          "imu": ACCELERATIONS}
"""Quantities of the sensors whose freezing is tried as a fault."""
FRICTIONS, SUPPLIES = (0.1, 0.4, 2.5), (0.2, 0.35, 0.5, 0.75)
"""Factors of the friction coefficient and of the supply's voltage that are tried as faults."""


class FilterStep(NamedTuple):
    """A step that has been taken, with some particles at its beginning."""

    end: float  # [s]
    measured: list[MeasuredNumber]
    commands: list[tuple[float, dict[str, float]]]  # instants [s] and commands
    kept: list[KeptParticle]
    offsets: Offsets  # of these particles, as are the logarithms of the free parameters, shape (particles, free)
    log_parameters: np.ndarray


class Frozen(NamedTuple):
    """A quantity whose sensor has given the same `value` since the instant `since` [s]."""

    value: float
    since: float


class Replay:
    """The particles that were kept before the first of `steps`, run through all of them with `changes` from there on.

    `frozen` has the value of each quantity whose sensor has frozen, which is then predicted exactly. `gain` is the
    largest log likelihood of a particle. `discount` is the square of the mean misfit of a measurement over the expected
    one: errors that the noise does not explain are not independent, so that differences of likelihoods mean less.
    ValueError if the device cannot have a fault.
    """

    def __init__(self, steps: Sequence[FilterStep], bandwidth: float, settings: FilterSettings,
                 changes: Iterable[Incident]):
        first = steps[0]
        self.begin, self.log_parameters = first.end - STEP, first.log_parameters
        self.particles = [kept.restored(bandwidth) for kept in first.kept]
        self.offsets = first.offsets.of_particles(np.arange(len(first.kept)))
        self.frozen: dict[str, Frozen] = {}
        for change in changes:
            if change.fault == FREEZE:
                self.frozen = _frozen(steps, change.of, settings.repeated)
                self.begin = min(frozen.since for frozen in self.frozen.values())
                continue
            for particle in self.particles:
                particle.device.fail(*change)
        gains = np.zeros(len(self.particles))
        equal = np.full(len(gains), 1.0 / len(gains))
        for step in steps:
            phase = self.offsets.variance["crank_angle"]
            self.offsets.variance["crank_angle"] = np.maximum(phase, settings.replayed_phase**2)
            repeated = [measurement for measurement in step.measured if measurement.field in self.frozen
                        and measurement.time >= self.frozen[measurement.field].since]
            measured = [measurement for measurement in step.measured if measurement not in repeated]
            predicted = run(self.particles, measured, step.commands, step.end)
            gains += self.offsets.weigh(measured, predicted, equal)[0]
            gains -= sum(0.5 * math.log(self.offsets.error_of(measurement)) for measurement in repeated)
            self.offsets.grow(0.0, False)
        self.gain = float(np.max(gains, where=[particle.is_alive for particle in self.particles], initial=-np.inf))
        misfit = float(self.offsets.misfit.min()) / max(1, self.offsets.misfit_count)
        self.discount = max(1.0, (2.0 * misfit)**2)


def most_likely_change(steps: Sequence[FilterStep], bandwidth: float, settings: FilterSettings, end: Incident | None,
                       candidates: Mapping[int, Sequence[Incident]]) -> tuple[Incident, Replay] | None:
    """Return the change of the robot that explains the last `steps`, with its replay; None if none does so clearly.

    `candidates` are the changes that may have begun, by the number of steps since then; `bandwidth` is that of the
    IMU's low-pass [Hz]. `end` is the end of the fault that the robot has, if it has one: it precedes each other fault,
    and is preferred to others that fit nearly as well, because a fault that has no effect yet fits as well.
    """
    replays = dict[Incident, Replay]()
    for steps_ago, changes in sorted(candidates.items()):
        if not changes or not 0 < steps_ago <= len(steps):
            continue
        unchanged = Replay(steps[-steps_ago:], bandwidth, settings, ()).gain
        for change in changes:
            try:
                replay = Replay(steps[-steps_ago:], bandwidth, settings,
                                (end, change) if end and change != end else (change,))
            except ValueError:  # a fault that the device cannot have now
                continue
            is_plain = change.fault in (*OF_MOTOR, FREEZE)
            replay.gain = (replay.gain - unchanged) / (1.0 if is_plain else replay.discount)
            if change not in replays or replay.gain > replays[change].gain:
                replays[change] = replay
    ranked = sorted(replays, key=lambda change: -replays[change].gain - 2.0 * settings.margin * (change == end))
    if not ranked or replays[ranked[0]].gain < settings.named:
        return None
    change, best = ranked[0], replays[ranked[0]]
    rivals = [replays[rival].gain for rival in ranked if (rival.fault, rival.of) != (change.fault, change.of)]
    if change != end and best.gain - max(rivals, default=-math.inf) < settings.margin:
        return None
    return change, best


def _frozen(steps: Sequence[FilterStep], sensor: str, repeated: int) -> dict[str, Frozen]:
    """Return what a sensor repeats at the end of `steps` (ValueError: not the same value `repeated` times)."""
    frozen = dict[str, Frozen]()
    for field in SENSORS[sensor]:
        values = [(measurement.value, measurement.time) for step in reversed(steps)
                  for measurement in reversed(step.measured) if measurement.field == field]
        if values:
            value, same = next(groupby(values, itemgetter(0)))
            instants = [time for _, time in same]
            if len(instants) < repeated:
                raise ValueError(f"{field}: changes")
            frozen[field] = Frozen(value, instants[-1])
    if not frozen:
        raise ValueError(f"{sensor}: measures nothing")
    return frozen


def possible_faults(scene: Scene) -> list[Incident]:
    """Return the faults of the device that a scene can have, and those of its sensors, each without an end."""
    faults = [Incident("motor_stall", FOREVER), *(Incident("plate_stuck", FOREVER, side) for side in scene.plates)]
    if scene.has_rotor:
        faults += [Incident("supply_sag", FOREVER, value=share * scene["motor.supply_voltage"]) for share in SUPPLIES]
    if scene.body_moves and scene["effects.friction"] != "none":
        faults += [Incident("friction_patch", FOREVER, "", factor * scene["ground.friction"], -FAR,
                            FAR) for factor in FRICTIONS]
    return [*faults, *(Incident(FREEZE, FOREVER, sensor) for sensor in SENSORS)]


def fault_in_words(fault: Incident) -> str:
    """Return a fault in words, such as `plate_stuck of upper`."""
    details = f" of {fault.of}" * bool(fault.of) + f" of about {fault.value:.2g}" * bool(fault.value)
    return f"{fault.fault}{details}"
