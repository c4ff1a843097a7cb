"""A particle filter that estimates a robot's state and parameters online, and names the fault that it has.

Each particle is a `Simulator` with parameters of its own, which simulates the robot exactly, blow by blow. In steps of
`STEP` all particles advance under the commands and are weighted by the likelihood of what the sensors measured
meanwhile. When few of them carry the weight, unlikely ones are replaced by varied copies of likely ones (J. Liu,
M. West, "Combined parameter and state estimation in simulation-based filtering", 2001).

Three things differ from the plain filter, whose numbers are `FilterSettings`:

- A body's position enters no equation, so each particle has a Kalman filter of the place where its simulation began. An
  encoder is finer than particles could ever lie, so each has a Kalman filter of its crank's angle, too.
- Errors have heavy tails, and a step's likelihoods are tempered until they leave enough particles in use, because no
  particle is the robot: a likelihood taken literally would leave a single one.
- When the measurements of some quantity are much farther off than usual, faults are compared (`faults.py`).

No scene is the robot, and copies of particles soon agree on what the scene lacks. So the variance of the body's speed
is at least the one that the innovations show (`SpeedErrors`).
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from statistics import median
from typing import NamedTuple

import numpy as np

from vibro_lab.twin.faults import FilterStep, Frozen, fault_in_words, most_likely_change, possible_faults
from vibro_lab.twin.particles import (
    INDEX,
    STEP,
    FilterSettings,
    Innovation,
    MeasuredNumber,
    Offsets,
    Particle,
    run,
    thinned,
)
from vibro_ros import ACCELERATIONS, IMU_FORGETTING, SAMPLE_FIELDS, STATE_UNITS, Incident, Scene, motor_coordinates

MOST_WAITING = 10_000
"""Most measurements that wait for their step."""
ROUNDING = 1e-9  # s
LONGEST_GAP = 5.0
"""Time [s] that is not filtered if the filter is farther behind; it starts again."""
TEMPERATURES = (1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01, 0.0)
"""Powers of the likelihoods that are tried, until one leaves enough particles in use."""
GAUSSIAN = 1.4826
"""Standard deviation of a normal error in parts of the median of its magnitude."""
SLOWEST = 10.0
"""Least speed of the crank [rad/s] with which an error of the acceleration is one of the speed."""
KNOWN_PLACE = 1e-2
"""Standard deviation of the place [m] from which on its drift says something of the speed."""
PLACES, SPEEDS = ("body_position", "body_height"), ("body_velocity", "body_vertical_velocity")
_OF_DC_MOTOR = ("motor_current", "controller_integral")
DEFAULT = FilterSettings()


class Estimate(NamedTuple):
    """Means and variances of all `SAMPLE_FIELDS` at `time` [s], shape (fields,) each.

    `parameters` has the mean and the standard deviation of each free parameter.
    """

    time: float
    mean: np.ndarray
    variance: np.ndarray
    parameters: Mapping[str, tuple[float, float]]


class Departure(NamedTuple):
    """The robot has left the model since about `since` [s]; noticed at `time` [s].

    `fault` is None if no fault explains what was measured; `evidence` is the log ratio of likelihoods for the fault, or
    the mean square of the normalised innovations. `words` names the fault, or the quantity that is farthest off.
    """

    time: float
    since: float
    fault: Incident | None
    evidence: float
    words: str


class SpeedErrors:
    """Errors of the body's two speeds that the innovations show, averaged over `memory` [s].

    An error of the acceleration that oscillates with the crank is an error of the speed, divided by the crank's speed.
    The median of its magnitude counts, because a blow that comes a tenth of a millisecond early is an error of a
    hundred m/s² that hardly changes the speed. An error of the mean speed lets the offset between measured and
    simulated place drift; a drift that the offset's own variance explains is no error.
    """

    def __init__(self, memory: float):
        self._memory, self._acceleration, self._earlier_offset = memory, dict[str, float](), math.nan

    def update(self, innovations: Sequence[Innovation], offset: float, offset_variance: float) -> None:
        """Take the innovations of a step, and the offset of the place [m] after it with its variance [m²]."""
        share = STEP / self._memory
        for axis in ACCELERATIONS:
            errors = [abs(innovation.value) for innovation in innovations if innovation.field == axis]
            if errors:
                average = self._acceleration.get(axis, median(errors))
                self._acceleration[axis] = average + share * (median(errors) - average)
        if not math.isnan(self._earlier_offset):
            self._earlier_offset += share * (offset - self._earlier_offset)
        elif offset_variance < KNOWN_PLACE**2:
            self._earlier_offset = offset

    def variances(self, crank_speed: float, offset: float, offset_variance: float) -> tuple[float, float]:
        """Return the variances of the speeds along and across the ground [m²/s²]."""
        along, across = ((GAUSSIAN * self._acceleration.get(axis, 0.0) / max(abs(crank_speed), SLOWEST))**2
                         for axis in ACCELERATIONS)
        drift = offset - self._earlier_offset
        if math.isfinite(drift):
            along += max(0.0, drift**2 - offset_variance) / self._memory**2
        return along, across


class InnovationSquares:
    """Mean squares of the normalised innovations by quantity: the usual ones, and those of the latest step."""

    def __init__(self, settings: FilterSettings):
        self._settings, self._usual, self.latest = settings, dict[str, float](), dict[str, float]()

    def ratios(self, innovations: Sequence[Innovation]) -> dict[str, float]:
        """Take the innovations of a step, and return how unusual those of each quantity are; above 1 they are."""
        squares: dict[str, list[float]] = {}
        for innovation in innovations:
            squares.setdefault(innovation.field, []).append(innovation.value**2 / innovation.variance)
        ratios = dict[str, float]()
        for field, of_field in squares.items():
            square, usual = float(np.mean(of_field)), self._usual.get(field, 1.0)
            recent = 0.5 * (square + self.latest.get(field, 0.0))
            share = STEP / self._settings.memory
            self._usual[field] = usual + share * (min(square, self._settings.most_usual) - usual)
            self.latest[field] = square
            ratios[field] = recent / (self._settings.unusual + 4.0 * usual)
        return ratios


class Estimator:
    """Estimates the state and the free parameters of a robot.

    `scene` is the robot as it is believed to be; commands and instants are counted from its start. The parameters
    `free`, numbers above 0 (else ValueError), are believed to have the relative standard deviation `spread`.
    `bandwidth` is that of the IMU's low-pass [Hz]; 0 without an IMU. Measurements up to `time` [s] have been used;
    `innovations` are those of the last step, and `departure` is how the robot differs from the model now, or None.
    `late` counts measurements that came after their step, or were too many, and `restarts` how often the filter has
    started again.
    """

    def __init__(self, scene: Scene, free: Sequence[str] = (), spread: float = 0.02, particles: int = 40,
                 seed: int = 0, bandwidth: float = 0.0, settings: FilterSettings = DEFAULT):
        for name in free:
            value = scene.parameters.get(name)
            if not isinstance(value, float) or value <= 0.0 or name.startswith(("sensors.", "solver.", "start.")):
                raise ValueError(f"{name}: is no parameter above 0 of this scene's machine; leave it out")
        self._scene, self._free, self._spread, self._count = scene, tuple(free), spread, particles
        self._believed = np.log([scene[name] for name in free])
        self._bandwidth, self._random = bandwidth, np.random.default_rng(seed)
        self._faults = possible_faults(scene)
        self._settings = settings
        parts = (*["body"] * scene.body_moves, *scene.guides)
        scatter = {f"{part}_velocity": settings.speed_scatter for part in parts}
        scatter |= {f"{side}_position": settings.place_scatter for side in scene.guides}  # a body's enters no equation
        self._least_scatter = np.array([scatter.get(name, 0.0) for name in SAMPLE_FIELDS])
        self._scattered = tuple(name for name in SAMPLE_FIELDS if name in scatter)
        self.late, self.restarts = 0, -1
        self._measured: list[MeasuredNumber] = []
        self._commands: list[tuple[float, dict[str, float]]] = []
        self._given: dict[str, float] = {}  # the last command of each kind
        self._weights = np.full(particles, 1.0 / particles)
        self._log_parameters = np.zeros((particles, len(self._free)))
        self._anchor: MeasuredNumber | None = None  # the encoder's first angle, while the command is not known
        self.start_again(0.0)

    def start_again(self, time: float) -> None:
        """Begin at `time` [s] from the scene's start, with parameters as believed or found, and the last commands."""
        self.time, self._resampled, self._compared, self._began = time, time, time, time
        self.restarts += 1
        self.innovations: list[Innovation] = []
        self.departure: Departure | None = None
        self._active: Incident | None = None
        self._frozen: Mapping[str, Frozen] = {}  # quantities that a sensor no longer measures
        self._squares = InnovationSquares(self._settings)
        self._unusual_since, self._last_unusual = math.inf, -math.inf
        self._history: deque[FilterStep] = deque(maxlen=self._settings.most_kept)
        self._temper = 1.0  # the power of the last step's likelihoods
        self._speed_errors = SpeedErrors(self._settings.growth_memory)
        believed, deviation = np.log([self._scene[name] for name in self._free]), self._spread
        if self.restarts:
            believed, deviation = self._weights @ self._log_parameters, self._spread
        self._log_parameters = believed + deviation * self._random.standard_normal((self._count, len(self._free)))
        self._particles = []
        for k, logs in enumerate(self._log_parameters):
            try:
                scene = self._with(logs)
            except ValueError:  # beyond a limit
                self._log_parameters[k], scene = np.log([self._scene[name] for name in self._free]), self._scene
            self._particles.append(Particle(scene, self._bandwidth, time))
            self._particles[-1].device.command(**self._given)
        self._weights = np.full(self._count, 1.0 / self._count)
        self._offsets = Offsets(self._count, self._settings)
        self._has_turned, self._adopts, self._anchor = False, True, None
        self._estimate = self._estimated()

    def _with(self, logs: np.ndarray) -> Scene:
        return self._scene.with_parameters(dict(zip(self._free, np.exp(logs).tolist(), strict=True)))

    def measure(self, measurement: MeasuredNumber) -> None:
        """Take a measurement, which is used when its step comes; one that comes too late is counted."""
        if measurement.time <= self.time or len(self._measured) == MOST_WAITING:
            self.late += 1
        else:
            self._measured.append(measurement)

    def command(self, time: float, **given: float) -> None:
        """Take commands, arguments of `Simulator.command` that the scene permits, which arrived at `time` [s]."""
        self._commands.append((max(time + self._settings.latency, self.time), given))
        self._commands.sort(key=lambda command: command[0])

    def advance_to(self, time: float) -> None:
        """Use what was measured up to `time` [s], in whole steps."""
        while self.advance_by_step(time):
            pass

    def advance_by_step(self, time: float) -> bool:
        """Take one step if it ends by `time` [s]; return whether it did."""
        if time - self.time > LONGEST_GAP:
            self.start_again(STEP * math.floor(time / STEP))
            return True
        end = STEP * (round(self.time / STEP) + 1)
        if end > time + ROUNDING:
            return False
        self._advance(end)
        return True

    def estimate(self) -> Estimate:
        """Return the estimate at `time`."""
        return self._estimate

    def _estimated(self) -> Estimate:
        """Return the estimate of the particles, before likely ones are varied for the next step."""
        values = self._values()
        values[:, INDEX["body_position"]] += self._offsets.mean["body_position"]
        mean = self._weights @ values
        variance = self._weights @ (values - mean)**2
        variance[INDEX["body_position"]] += self._weights @ self._offsets.variance["body_position"]
        shown_variances = self._speed_errors.variances(float(mean[INDEX["motor_speed"]]), *self._place_offset())
        for place, speed, least_variance in zip(PLACES, SPEEDS, shown_variances, strict=True):
            variance[INDEX[place]] += self._settings.least_place_deviation**2
            variance[INDEX[speed]] = max(variance[INDEX[speed]], least_variance)
            variance[INDEX[speed]] += self._settings.least_speed_deviation**2
        numbers = np.exp(self._log_parameters)
        average = self._weights @ numbers
        deviation = np.sqrt(self._weights @ (numbers - average)**2)
        return Estimate(self.time, mean, variance, dict(zip(self._free, zip(
            average.tolist(), deviation.tolist(), strict=True), strict=True)))

    def _place_offset(self) -> tuple[float, float]:
        """Return the mean offset between measured and simulated place [m], and its variance [m²]."""
        return (float(self._weights @ self._offsets.mean["body_position"]),
                float(self._weights @ self._offsets.variance["body_position"]))

    def _values(self) -> np.ndarray:
        return np.array([particle.device.values for particle in self._particles])

    def _advance(self, end: float) -> None:
        """Take one step, to `end` [s]."""
        measured = self._without_frozen(thinned(
            (measurement for measurement in self._measured if self.time < measurement.time <= end),
            self._settings.most_measured))
        self._measured = [measurement for measurement in self._measured if measurement.time > end]
        commands = [command for command in self._commands if command[0] <= end]
        self._commands = self._commands[len(commands):]
        self._adopt_speed(measured)
        chosen = self._random.choice(self._count, self._settings.replayed, p=self._weights)
        self._history.append(FilterStep(end, measured, commands, [self._particles[k].kept() for k in chosen],
                                        self._offsets.of_particles(chosen), self._log_parameters[chosen]))
        earlier_speeds = self._values()[:, INDEX["motor_speed"]]
        predicted = run(self._particles, measured, commands, end)
        for _, given in commands:
            self._given |= given
        alive = np.array([particle.is_alive for particle in self._particles])
        if not alive.any():
            self.start_again(end)
            return
        survivor = self._particles[int(alive.argmax())]  # dead ones lose their weight now, and are replaced below
        self._particles = [particle if particle.is_alive else survivor for particle in self._particles]
        self.time = end
        self._offsets.grow(self._values()[:, INDEX["motor_speed"]] - earlier_speeds, self._scene.has_rotor)
        gains, turns, self.innovations = self._offsets.weigh(measured, predicted, self._weights)
        self._weights, self._temper = self._reweighed(np.where(alive, gains, -np.inf))
        self._speed_errors.update(self.innovations, *self._place_offset())
        self._estimate = self._estimated()
        for particle, turn in zip(self._particles, np.where(alive, turns, 0.0).tolist(), strict=True):
            if turn:
                particle.device.set_state(crank_angle=particle.device.values.item(INDEX["crank_angle"]) + turn)
        self._check_innovations()
        in_use = 1.0 / (self._weights**2).sum()
        is_due = self.time - self._resampled > 1.5 * STEP and in_use < self._settings.resampled * self._count
        if is_due or not alive.all():
            self._resample()

    def _without_frozen(self, measured: list[MeasuredNumber]) -> list[MeasuredNumber]:
        """Return the measurements without those of a frozen sensor; if it gives other values, the fault is over."""
        frozen = self._frozen
        used = [measurement for measurement in measured
                if measurement.field not in frozen or measurement.value != frozen[measurement.field].value]
        if any(measurement.field in frozen for measurement in used):
            self._active, self.departure, self._frozen = None, None, {}
            self._restart_checks()
        return used

    def _restart_checks(self) -> None:
        """Forget what was unusual, because a fault has been named or is over."""
        self._history.clear()
        self._squares.latest.clear()
        self._unusual_since, self._began = math.inf, self.time
        self._has_turned = False  # the fault may have begun within a step

    def _adopt_speed(self, measured: Sequence[MeasuredNumber]) -> None:
        """Set the cranks to the encoder's speed and angle where they differ when the filter begins.

        The filter may have missed commands. The speed over a step is coarse by a tick of the encoder, so it is
        corrected once, `FilterSettings.first_speed` later.
        """
        angles = [measurement for measurement in measured if measurement.field == "crank_angle"]
        if len(angles) < 2 or angles[0].time == angles[-1].time:
            return
        is_first, self._has_turned = not self._has_turned, True
        first, last = self._anchor or angles[0], angles[-1]
        is_correction = self._anchor is not None and last.time - first.time > self._settings.first_speed
        if not (is_first or is_correction):
            return
        speed = (last.value - first.value) / (last.time - first.time)
        angle = last.value - speed * (last.time - self.time)
        is_command_unknown = (self._adopts and "motor_speed" not in self._given
                              and self._scene.motor_command == "motor_speed")
        is_adopted = False
        for particle in self._particles:
            values = particle.device.values
            has_other_speed = abs(values.item(INDEX["motor_speed"]) - speed) > self._settings.unlike_speed
            has_other_angle = abs(values.item(INDEX["crank_angle"]) - angle) > self._settings.unlike_angle
            if is_command_unknown and (has_other_speed or is_correction):
                particle.device.command(motor_speed=speed)
                is_adopted = True
            if is_first and (has_other_speed or has_other_angle):
                particle.device.set_state(crank_angle=angle, **({"motor_speed": speed} if has_other_speed else {}))
        if is_correction:
            self._anchor = None
        elif is_adopted:
            self._anchor = first
        self._adopts = self._anchor is not None

    def _reweighed(self, gains: np.ndarray) -> tuple[np.ndarray, float]:
        """Return weights times likelihoods with the logarithms `gains`, and the power that leaves enough in use."""
        least = min(self._settings.in_use * self._count, 1.0 / (self._weights**2).sum()) - 1e-9
        logs, gains = np.log(self._weights + 1e-300), gains - gains.max()
        dead = np.isinf(gains)
        for temper in TEMPERATURES:
            weights = np.where(dead, 0.0, np.exp(logs + temper * np.where(dead, 0.0, gains)))
            weights /= weights.sum()
            if 1.0 / (weights**2).sum() >= least:
                break
        return weights, temper

    def _resample(self) -> None:
        """Replace unlikely particles by varied copies of likely ones, all with equal weights."""
        count, self._resampled = self._count, self.time
        mean = self._weights @ self._log_parameters
        mean += self._settings.pull * (self._believed - mean)
        deviation = np.maximum(np.sqrt(self._weights @ (self._log_parameters - mean)**2), self._spread)
        values = self._values()
        scatter = self._settings.state_scatter * np.sqrt(self._weights @ (values - self._weights @ values)**2)
        scatter = min(1.0 / max(self._temper, 0.1), 10.0) * np.hypot(scatter, self._least_scatter)
        points = (np.arange(count) + self._random.random()) / count
        chosen = np.searchsorted(np.cumsum(self._weights), points).clip(max=count - 1)
        self._copy(self._particles, chosen, self._log_parameters, mean, deviation, scatter)
        self._offsets = self._offsets.of_particles(chosen)

    def _copy(self, particles: Sequence[Particle], chosen: np.ndarray, logs: np.ndarray, mean: np.ndarray,
              deviation: np.ndarray, scatter: np.ndarray) -> None:
        """Let the particles be those `chosen` of `particles`; those that are chosen again are varied.

        `mean` and `deviation` are those of the logarithms of the free parameters, `scatter` those of the state.
        """
        copies, copied, kept_share = list[Particle](), set[int](), 1.0 - self._settings.forgetting
        fresh = logs[chosen]
        for k, i in enumerate(chosen.tolist()):
            scene = particles[i].scene
            if i in copied and self._free:
                noise = math.sqrt(1.0 - kept_share**2) * deviation * self._random.standard_normal(len(mean))
                drawn = mean + kept_share * (logs[i] - mean) + noise
                try:
                    scene, fresh[k] = self._with(drawn), drawn
                except ValueError:  # beyond a limit
                    pass
            copies.append(self._varied(particles[i], scene, scatter) if i in copied else particles[i])
            copied.add(i)
        self._particles, self._log_parameters = copies, fresh
        self._weights = np.full(self._count, 1.0 / self._count)

    def _varied(self, particle: Particle, scene: Scene, scatter: np.ndarray) -> Particle:
        """Return a copy of a particle with the parameters of `scene` and noise in its state."""
        new, old = Particle(scene, self._bandwidth, self.time), particle.device
        state = vars(old.state)
        given = {name: state[name] for name in STATE_UNITS if name not in _OF_DC_MOTOR}
        for name in self._scattered:
            given[name] += scatter[INDEX[name]] * self._random.standard_normal()
        for side in scene.plates:  # no mass may lie too deep in its plate
            deepest = given[f"{side}_plate_position"] + scene.deepest_penetration(side)
            given[f"{side}_position"] = min(given[f"{side}_position"], deepest)
        for name in motor_coordinates(scene):
            given[name] = old.controller_integral if name == "controller_integral" else state[name]
        new.device.command(**{**self._given, scene.motor_command: old.commanded_motor_speed})
        if self._active and not self._frozen:
            new.device.fail(*self._active)
        new.device.set_state(**given)
        new.settled = self.time + (IMU_FORGETTING / self._bandwidth if self._bandwidth else 0.0)
        return new

    def _check_innovations(self) -> None:
        """Look whether the measurements are unusual; if so, compare faults, and note a departure from the model.

        An IMU alone lets faults be compared, but is no departure: after a blow that comes a tenth of a millisecond
        early its whole signal is wrong.
        """
        ratios = self._squares.ratios(self.innovations)
        slow = {field: ratio for field, ratio in ratios.items() if field not in ACCELERATIONS}
        if self.time - self._began < self._settings.settling or not ratios:
            return
        is_unusual, since_gap = max(ratios.values()) > 1.0, self._since_gap()
        if (since_gap or is_unusual) and self.time - self._compared >= self._settings.check_period - ROUNDING:
            self._compared = self.time
            if self._compare(is_unusual, since_gap):
                return
        farthest = max(slow, key=lambda field: slow[field], default="")
        if not farthest or slow[farthest] <= 1.0:
            if self.time - self._last_unusual >= self._settings.unexplained:
                self._unusual_since = math.inf
                if self.departure and not self.departure.fault:
                    self.departure = None
            return
        self._unusual_since, self._last_unusual = min(self._unusual_since, self.time), self.time
        lasted = self.time - self._unusual_since
        if lasted >= self._settings.given_up:
            self.start_again(self.time)
        elif lasted >= self._settings.unexplained and not self.departure:
            self.departure = Departure(self.time, self._unusual_since, None, slow[farthest], farthest)

    def _since_gap(self) -> int:
        """Return the number of steps since a plate was commanded to move; 0 if that is longer ago than is kept."""
        return next((len(self._history) - k for k, step in enumerate(self._history) for _, given in step.commands
                     if any(name.endswith("_gap") for name in given)), 0)

    def _compare(self, is_unusual: bool, since_gap: int) -> bool:
        """Compare the present system with faults, begun at several instants; return whether one is taken over.

        Plates are compared if a gap was commanded `since_gap` steps ago, all else if the measurements are unusual.
        """
        present, instants = self._active, (self._settings.recent_begin, self._settings.early_begin)
        end = Incident(present.fault, 0.0, present.of) if present and not self._frozen else None
        others = [fault for fault in self._faults if fault != present]
        plates = [fault for fault in others if fault.fault == "plate_stuck" and since_gap]
        others = [fault for fault in others if fault.fault != "plate_stuck" and is_unusual]
        others += [end] if end and is_unusual else []
        candidates = {ago: [*(plates if ago >= since_gap else []), *(others if ago in instants else [])]
                      for ago in {*instants, since_gap}}  # a stuck plate shows from its command on
        explanation = most_likely_change(list(self._history), self._bandwidth, self._settings, end, candidates)
        if explanation is None:
            return False
        fault, best = explanation
        self._active, self.departure = None, None
        if fault != end:
            self._active = fault
            self.departure = Departure(self.time, best.begin, fault, best.gain, fault_in_words(fault))
        self._frozen = best.frozen
        chosen = np.arange(self._count) % len(best.particles)
        self._copy(best.particles, chosen, best.log_parameters, best.log_parameters.mean(axis=0),
                   np.full(len(self._free), self._spread), self._least_scatter)
        self._offsets = best.offsets.of_particles(chosen)
        self._restart_checks()
        return True
