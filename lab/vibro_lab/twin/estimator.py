"""A particle filter that estimates a robot's state and parameters online, and names the fault that it has.

Each particle is a `Simulator` with parameters of its own, which simulates the robot exactly, blow by blow. In steps of
`STEP` all particles advance under the commands and are weighted by the likelihood of what the sensors measured
meanwhile. When few of them carry the weight, unlikely ones are replaced by varied copies of likely ones (J. Liu,
M. West, "Combined parameter and state estimation in simulation-based filtering", 2001).

Three things differ from the plain filter:

- A body's position enters no equation, so each particle has a Kalman filter of the place where its simulation began. An
  encoder is finer than particles could ever lie, so each has a Kalman filter of its crank's angle, too.
- Errors have heavy tails, and a step's likelihoods are tempered until they leave enough particles in use, because no
  particle is the robot: a likelihood taken literally would leave a single one.
- When the measurements of some quantity are much farther off than usual, each fault that the scene can have is
  simulated from earlier states of a few particles, beginning at several instants. The fault with the largest ratio of
  likelihoods is named if it is large enough (A. Willsky, H. Jones, "A generalized likelihood ratio approach", 1976).
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from vibro_lab.twin.particles import (
    INDEX,
    LATENCY,
    MODEL_ERROR,
    STEP,
    Innovation,
    Kept,
    Measurement,
    Offsets,
    Particle,
    run,
    thinned,
)
from vibro_ros import ACCELERATIONS, IMU_FORGETTING, SAMPLE_FIELDS, STATE_UNITS, Incident, Scene, motor_coordinates

MOST_WAITING = 10_000
"""Most measurements that wait for their step."""
ROUNDING = 1e-9  # s
FOREVER, FAR = 86_400.0, 1e6
"""Longest duration of a fault [s], and farthest end of a stretch of the ground [m], that a device takes."""
_OF_DC_MOTOR = ("motor_current", "controller_integral")
LONGEST_GAP = 5.0
"""Time [s] that is not filtered if the filter is farther behind; it starts again."""
IN_USE, RESAMPLED = 0.4, 0.9
"""Share of effective particles that tempering leaves, and share below which they are resampled."""
SHRINKAGE, PULL = 0.95, 0.05
"""Factor that draws the logarithms of a copy's parameters to the mean; and share by which the mean is drawn to what was
believed at the start. Noise as large as that belief replaces what the first factor takes, so that the filter goes on
learning. Copies that shared parameters would soon all share wrong ones."""
SCATTER = {"body_velocity": 1.5e-4, "upper_position": 1.5e-6, "upper_velocity": 1.5e-4,
           "inclined_position": 1.5e-6, "inclined_velocity": 1.5e-4}
"""Standard deviations of the noise in the state of each copy [m, m/s]; a tenth of that of the particles is added. A
chaotic robot would make of larger numbers an error that no measurement takes back."""
REPLAYED_PHASE, SLOW, OFF, FIRST_SPEED = 0.03, 5.0, 0.1, 0.5
"""Least deviation of a crank's angle in replays, which do not correct it [rad]; differences of speed [rad/s] and of
angle [rad] from which the encoder's are adopted at a start; and time [s] over which its speed is then measured again.
"""
FLOOR = {"body_position": 1e-4, "body_velocity": 3e-4, "body_height": 1e-4, "body_vertical_velocity": 3e-4}
"""Standard deviations [m, m/s] below which no estimate is published, whatever the particles agree on."""
BACK, LONGEST_BACK, REPLAYED, CHECK_PERIOD = (4, 10), 20, 4, 0.2
"""Numbers of steps before now at which a fault may have begun, and largest number of them since a gap was commanded,
which shows whether its plate is stuck; particles whose states are kept for that; and least time [s] between two
comparisons of faults, each of which costs some tenths of a second."""
UNUSUAL, MEMORY, MOST_USUAL = 4.0, 3.0, 25.0
"""Mean normalised square of innovations that is unusual when four times the usual one is added; time [s] over which the
usual one is found, and the largest square that counts for it."""
NAMED, MARGIN = 15.0, 5.0
"""Log ratio of likelihoods from which a fault is named, and by which it must exceed every other fault, if it explains
what was measured; `_Replay.discount` says what else. A filter that has lost a chaotic robot finds many a fault more
likely than what it has."""
FREEZE = "sensor_freeze"
"""The fault of a sensor that gives what it gave last."""
OF_MOTOR = ("motor_stall", "supply_sag")
"""Faults that an encoder shows at once, whatever the masses do."""
SENSORS: Mapping[str, tuple[str, ...]] = {"encoder": ("crank_angle",), "tracking": ("body_position", "body_height"),
                                          "imu": ACCELERATIONS}
"""Quantities of the sensors whose freezing is tried as a fault."""
REPEATED = 5
"""Least number of equal values by which a sensor may have frozen."""
SETTLING = 1.0
"""Time [s] after a start in which nothing counts as unusual."""
UNEXPLAINED, GIVEN_UP = 0.6, 3.0
"""Time [s] after which a departure without a name is reported, and after which the filter starts again."""
FRICTIONS, SUPPLIES = (0.1, 0.4, 2.5), (0.2, 0.35, 0.5, 0.75)
"""Factors of the friction coefficient and of the supply's voltage that are tried as faults."""


class Estimate(NamedTuple):
    """Means and variances of all `SAMPLE_FIELDS` at `time` [s], shape (fields,) each; mean and standard deviation of
    each free parameter."""

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


class Estimator:
    """Estimates the state and the free parameters of a robot.

    Parameters
    ----------
    scene : Scene
        The robot as it is believed to be; commands and instants are counted from its start.
    free : sequence of str
        Names of the parameters that are estimated, numbers above 0.
    spread : float
        Relative standard deviation of what is believed about each of them.
    particles : int
        Number of particles.
    seed : int
        Seed of all random numbers.
    bandwidth : float
        Bandwidth of the IMU's low-pass [Hz]; 0 without an IMU.

    Attributes
    ----------
    time : float
        Instant [s] up to which measurements have been used.
    innovations : list of Innovation
        Those of the last step.
    departure : Departure or None
        How the robot differs from the model now.
    late, restarts : int
        Measurements that came after their step, or were too many; and how often the filter has started again.

    Raises
    ------
    ValueError
        For a free parameter that the filter cannot vary.
    """

    def __init__(self, scene: Scene, free: Sequence[str] = (), spread: float = 0.02, particles: int = 40,
                 seed: int = 0, bandwidth: float = 0.0):
        for name in free:
            value = scene.parameters.get(name)
            if not isinstance(value, float) or value <= 0.0 or name.startswith(("sensors.", "solver.", "start.")):
                raise ValueError(f"{name}: is no parameter above 0 of this scene's machine; leave it out")
        self._scene, self._free, self._spread, self._count = scene, tuple(free), spread, particles
        self._believed = np.log([scene[name] for name in free])
        self._bandwidth, self._random = bandwidth, np.random.default_rng(seed)
        self._faults = possible_faults(scene)
        self._least_scatter = np.array([SCATTER.get(name, 0.0) for name in SAMPLE_FIELDS])
        self.late, self.restarts = 0, -1
        self._measured: list[Measurement] = []
        self._commands: list[tuple[float, dict[str, float]]] = []
        self._given: dict[str, float] = {}  # the last command of each kind
        self._weights, self._logs = np.full(particles, 1.0 / particles), np.zeros((particles, len(self._free)))
        self._anchor: Measurement | None = None  # the encoder's first angle, while the command is not known
        self.start_again(0.0)

    def start_again(self, time: float) -> None:
        """Begin at `time` [s] from the scene's start, with parameters as believed or found, and the last commands."""
        self.time, self._resampled, self._compared, self._began = time, time, time, time
        self.restarts += 1
        self.innovations: list[Innovation] = []
        self.departure: Departure | None = None
        self._active: Incident | None = None
        self._frozen: Mapping[str, _Frozen] = {}  # quantities that a sensor no longer measures
        self._usual, self._latest = dict[str, float](), dict[str, float]()
        self._unusual_since, self._last_unusual = math.inf, -math.inf
        self._history: deque[_Step] = deque(maxlen=LONGEST_BACK)
        believed, deviation = np.log([self._scene[name] for name in self._free]), self._spread
        if self.restarts:
            believed, deviation = self._weights @ self._logs, self._spread
        self._logs = believed + deviation * self._random.standard_normal((self._count, len(self._free)))
        self._particles = []
        for k, logs in enumerate(self._logs):
            try:
                scene = self._with(logs)
            except ValueError:  # beyond a limit
                self._logs[k], scene = np.log([self._scene[name] for name in self._free]), self._scene
            self._particles.append(Particle(scene, self._bandwidth, time))
            self._particles[-1].device.command(**self._given)
        self._weights = np.full(self._count, 1.0 / self._count)
        self._offsets = Offsets(self._count)
        self._has_turned, self._adopts, self._anchor = False, True, None
        self._estimate = self._estimated()

    def _with(self, logs: np.ndarray) -> Scene:
        return self._scene.with_parameters(dict(zip(self._free, np.exp(logs).tolist(), strict=True)))

    def measure(self, measurement: Measurement) -> None:
        """Take a measurement, which is used when its step comes; one that comes too late is counted."""
        if measurement.time <= self.time or len(self._measured) == MOST_WAITING:
            self.late += 1
        else:
            self._measured.append(measurement)

    def command(self, time: float, **given: float) -> None:
        """Take commands, arguments of `Simulator.command` that the scene permits, which arrived at `time` [s]."""
        self._commands.append((max(time + LATENCY, self.time), given))
        self._commands.sort(key=lambda one: one[0])

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
        """Return what the particles say now, before likely ones are varied for the next step."""
        values = self._values()
        values[:, INDEX["body_position"]] += self._offsets.mean["body_position"]
        mean = self._weights @ values
        variance = self._weights @ (values - mean)**2
        variance[INDEX["body_position"]] += self._weights @ self._offsets.variance["body_position"]
        for name, least in FLOOR.items():
            variance[INDEX[name]] += least**2
        numbers = np.exp(self._logs)
        average = self._weights @ numbers
        deviation = np.sqrt(self._weights @ (numbers - average)**2)
        return Estimate(self.time, mean, variance, dict(zip(self._free, zip(
            average.tolist(), deviation.tolist(), strict=True), strict=True)))

    def _values(self) -> np.ndarray:
        return np.array([particle.device.values for particle in self._particles])

    def _advance(self, end: float) -> None:
        """Take one step, to `end` [s]."""
        measured = self._without_frozen(thinned(one for one in self._measured if self.time < one.time <= end))
        self._measured = [one for one in self._measured if one.time > end]
        commands = [one for one in self._commands if one[0] <= end]
        self._commands = self._commands[len(commands):]
        self._adopt_speed(measured)
        chosen = self._random.choice(self._count, REPLAYED, p=self._weights)
        self._history.append(_Step(end, measured, commands, [self._particles[k].kept() for k in chosen],
                                   self._offsets.part(chosen), self._logs[chosen]))
        before = self._values()[:, INDEX["motor_speed"]]
        predicted = run(self._particles, measured, commands, end)
        for _, given in commands:
            self._given |= given
        alive = np.array([particle.is_alive for particle in self._particles])
        if not alive.any():
            self.start_again(end)
            return
        survivor = self._particles[int(alive.argmax())]  # dead ones lose their weight now, and are replaced below
        self._particles = [one if one.is_alive else survivor for one in self._particles]
        self.time = end
        self._offsets.grow(self._values()[:, INDEX["motor_speed"]] - before, self._scene.has_rotor)
        gains, turns, self.innovations = self._offsets.weigh(measured, predicted, self._weights)
        self._reweigh(np.where(alive, gains, -np.inf))
        self._estimate = self._estimated()
        for particle, turn in zip(self._particles, np.where(alive, turns, 0.0).tolist(), strict=True):
            if turn:
                particle.device.set_state(crank_angle=particle.device.values.item(INDEX["crank_angle"]) + turn)
        self._watch()
        is_due = self.time - self._resampled > 1.5 * STEP and 1.0 / (self._weights**2).sum() < RESAMPLED * self._count
        if is_due or not alive.all():
            self._resample()

    def _without_frozen(self, measured: list[Measurement]) -> list[Measurement]:
        """Return the measurements without those of a frozen sensor; if it gives other values, the fault is over."""
        frozen = self._frozen
        used = [one for one in measured if one.field not in frozen or one.value != frozen[one.field].value]
        if any(one.field in frozen for one in used):
            self._active, self.departure, self._frozen = None, None, {}
            self._watch_anew()
        return used

    def _watch_anew(self) -> None:
        """Begin to watch anew, because a fault has been named or is over."""
        self._history.clear()
        self._latest.clear()
        self._unusual_since, self._began = math.inf, self.time
        self._has_turned = False  # the fault may have begun within a step

    def _adopt_speed(self, measured: Sequence[Measurement]) -> None:
        """Let the cranks turn as the encoder says, if they do not when the filter begins: it may have missed commands.

        The speed over a step is coarse by a tick of the encoder, so that half a second later it is corrected once.
        """
        angles = [one for one in measured if one.field == "crank_angle"]
        if len(angles) < 2 or angles[0].time == angles[-1].time:
            return
        is_first, self._has_turned = not self._has_turned, True
        first, last = self._anchor or angles[0], angles[-1]
        speed = (last.value - first.value) / (last.time - first.time)
        is_again = self._anchor is not None and last.time - first.time > FIRST_SPEED
        if not (is_first or is_again):
            return
        is_unknown = (self._adopts and "motor_speed" not in self._given
                      and self._scene.motor_command == "motor_speed")
        self._anchor = None if is_again else self._anchor
        angle = last.value - speed * (last.time - self.time)
        for particle in self._particles:
            values = particle.device.values
            is_faster = abs(values.item(INDEX["motor_speed"]) - speed) > SLOW
            if is_unknown and (is_faster or is_again):
                particle.device.command(motor_speed=speed)
                self._anchor = None if is_again else first
            if is_first and (is_faster or abs(values.item(INDEX["crank_angle"]) - angle) > OFF):
                particle.device.set_state(crank_angle=angle, **({"motor_speed": speed} if is_faster else {}))
        self._adopts = self._anchor is not None

    def _reweigh(self, gains: np.ndarray) -> None:
        """Multiply the weights by likelihoods with the logarithms `gains`, tempered so that enough stay in use."""
        least = min(IN_USE * self._count, 1.0 / (self._weights**2).sum()) - 1e-9
        logs, gains = np.log(self._weights + 1e-300), gains - gains.max()
        dead = np.isinf(gains)
        for self._temper in (1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01, 0.0):
            weights = np.where(dead, 0.0, np.exp(logs + self._temper * np.where(dead, 0.0, gains)))
            weights /= weights.sum()
            if 1.0 / (weights**2).sum() >= least:
                break
        self._weights = weights

    def _resample(self) -> None:
        """Replace unlikely particles by varied copies of likely ones, all with equal weights."""
        count, self._resampled = self._count, self.time
        mean = self._weights @ self._logs
        mean += PULL * (self._believed - mean)
        deviation = np.maximum(np.sqrt(self._weights @ (self._logs - mean)**2), self._spread)
        values = self._values()
        scatter = 0.1 * np.sqrt(self._weights @ (values - self._weights @ values)**2)
        scatter = min(1.0 / max(self._temper, 0.1), 10.0) * np.hypot(scatter, self._least_scatter)
        points = (np.arange(count) + self._random.random()) / count
        chosen = np.searchsorted(np.cumsum(self._weights), points).clip(max=count - 1)
        self._copy(self._particles, chosen, self._logs, mean, deviation, scatter)
        self._offsets = self._offsets.part(chosen)

    def _copy(self, particles: Sequence[Particle], chosen: np.ndarray, logs: np.ndarray, mean: np.ndarray,
              deviation: np.ndarray, scatter: np.ndarray) -> None:
        """Let the particles be those `chosen` of `particles`; those that are chosen again are varied.

        `mean` and `deviation` are those of the logarithms of the free parameters, `scatter` the deviations of the state
        besides `SCATTER`.
        """
        copies, seen = list[Particle](), set[int]()
        fresh = logs[chosen]
        for k, i in enumerate(chosen.tolist()):
            scene = particles[i].scene
            if i in seen and self._free:
                noise = math.sqrt(1.0 - SHRINKAGE**2) * deviation * self._random.standard_normal(len(mean))
                drawn = mean + SHRINKAGE * (logs[i] - mean) + noise
                try:
                    scene, fresh[k] = self._with(drawn), drawn
                except ValueError:  # beyond a limit
                    pass
            copies.append(self._varied(particles[i], scene, scatter) if i in seen else particles[i])
            seen.add(i)
        self._particles, self._logs = copies, fresh
        self._weights = np.full(self._count, 1.0 / self._count)

    def _varied(self, particle: Particle, scene: Scene, scatter: np.ndarray) -> Particle:
        """Return a copy of a particle with the parameters of `scene` and noise in its state."""
        new, old = Particle(scene, self._bandwidth, self.time), particle.device
        state = vars(old.state)
        given = {name: state[name] for name in STATE_UNITS if name not in _OF_DC_MOTOR}
        parts = (*["body"] * scene.body_moves, *scene.guides)
        for name in (one for one in SCATTER if one.partition("_")[0] in parts):
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

    def _watch(self) -> None:
        """Look whether the measurements are unusual; if so, compare faults, and note a departure from the model.

        An IMU alone lets faults be compared, but is no departure: after a blow that comes a tenth of a millisecond
        early its whole signal is wrong.
        """
        squares: dict[str, list[float]] = {}
        for one in self.innovations:
            squares.setdefault(one.field, []).append(one.value**2 / one.variance)
        ratios = {field: self._unusual(field, float(np.mean(many))) for field, many in squares.items()}
        slow = {field: ratio for field, ratio in ratios.items() if field not in ACCELERATIONS}
        if self.time - self._began < SETTLING or not ratios:
            return
        is_unusual, since_gap = max(ratios.values()) > 1.0, self._since_gap()
        if (since_gap or is_unusual) and self.time - self._compared >= CHECK_PERIOD - 1e-9:
            self._compared = self.time
            if self._compare(is_unusual, since_gap):
                return
        farthest = max(slow, key=lambda field: slow[field], default="")
        if not farthest or slow[farthest] <= 1.0:
            if self.time - self._last_unusual >= UNEXPLAINED:
                self._unusual_since = math.inf
                if self.departure and not self.departure.fault:
                    self.departure = None
            return
        self._unusual_since, self._last_unusual = min(self._unusual_since, self.time), self.time
        lasted = self.time - self._unusual_since
        if lasted >= GIVEN_UP:
            self.start_again(self.time)
        elif lasted >= UNEXPLAINED and not self.departure:
            self.departure = Departure(self.time, self._unusual_since, None, slow[farthest], farthest)

    def _unusual(self, field: str, square: float) -> float:
        """Return how unusual the mean `square` of a quantity's normalised innovations is; above 1 it is."""
        usual = self._usual.get(field, 1.0)
        recent, self._latest[field] = 0.5 * (square + self._latest.get(field, 0.0)), square
        self._usual[field] = usual + STEP / MEMORY * (min(square, MOST_USUAL) - usual)
        return recent / (UNUSUAL + 4.0 * usual)

    def _since_gap(self) -> int:
        """Return the number of steps since a plate was commanded to move; 0 if that is longer ago than is kept."""
        return next((len(self._history) - k for k, step in enumerate(self._history) for _, given in step.commands
                     if any(name.endswith("_gap") for name in given)), 0)

    def _compare(self, is_unusual: bool, since_gap: int) -> bool:
        """Compare the present system with faults, begun at several instants; return whether one is taken over.

        Plates are compared if a gap was commanded `since_gap` steps ago, all else if the measurements are unusual.

        The end of the present fault is preferred to others that fit nearly as well, as all do that have not begun to
        matter.
        """
        present, found = self._active, dict[Incident, _Replay]()
        end = Incident(present.fault, 0.0, present.of) if present and not self._frozen else None
        plates = [one for one in self._faults if one.fault == "plate_stuck" and one != present and since_gap]
        others = [one for one in self._faults if one.fault != "plate_stuck" and one != present and is_unusual]
        others += [end] if end and is_unusual else []
        for back in sorted({*BACK, since_gap}):
            changes = plates * (back >= since_gap) + others * (back in BACK)  # a stuck plate shows from its command on
            if not (changes and 0 < back <= len(self._history)):
                continue
            steps = list(self._history)[-back:]
            unchanged = _Replay(steps, self._bandwidth, ()).gain
            for change in changes:
                try:
                    replay = _Replay(steps, self._bandwidth, (end, change) if end and change != end else (change,))
                except ValueError:  # a fault that the device cannot have now
                    continue
                is_plain = change.fault in (*OF_MOTOR, FREEZE)
                replay.gain = (replay.gain - unchanged) / (1.0 if is_plain else replay.discount)
                if change not in found or replay.gain > found[change].gain:
                    found[change] = replay
        ranked = sorted(found, key=lambda one: found[one].gain + 2.0 * MARGIN * (one == end), reverse=True)
        if not ranked or found[ranked[0]].gain < NAMED:
            return False
        fault, best = ranked[0], found[ranked[0]]
        rivals = [found[one].gain for one in ranked if (one.fault, one.of) != (fault.fault, fault.of)]
        if fault != end and best.gain - max(rivals, default=-math.inf) < MARGIN:
            return False
        self._active = fault if fault != end else None
        self.departure = Departure(self.time, best.begin, fault, best.gain, words_of(fault)) if self._active else None
        self._frozen = best.frozen
        chosen = np.arange(self._count) % len(best.particles)
        self._copy(best.particles, chosen, best.logs, best.logs.mean(axis=0),
                   np.full(len(self._free), self._spread), self._least_scatter)
        self._offsets = best.offsets.part(chosen)
        self._watch_anew()
        return True


class _Step(NamedTuple):
    """A step that has been taken: its end [s], what was measured and commanded, and some particles at its beginning."""

    end: float
    measured: list[Measurement]
    commands: list[tuple[float, dict[str, float]]]
    kept: list[Kept]
    offsets: Offsets
    logs: np.ndarray


class _Frozen(NamedTuple):
    """A quantity whose sensor has given the same `value` since the instant `since` [s]."""

    value: float
    since: float


def _frozen(steps: Sequence[_Step], sensor: str) -> dict[str, _Frozen]:
    """Return what a sensor repeats at the end of `steps` (ValueError: it has not given the same values long enough)."""
    found = dict[str, _Frozen]()
    for field in SENSORS[sensor]:
        values = [(one.value, one.time) for step in reversed(steps) for one in reversed(step.measured)
                  if one.field == field]
        if values:
            value, same = next(groupby(values, itemgetter(0)))
            instants = [time for _, time in same]
            if len(instants) < REPEATED:
                raise ValueError(f"{field}: changes")
            found[field] = _Frozen(value, instants[-1])
    if not found:
        raise ValueError(f"{sensor}: measures nothing")
    return found


class _Replay:
    """The particles that were kept before the first of `steps`, run through all of them with `changes` from there on.

    What a sensor repeats from the instant on at which it has frozen is predicted exactly: `frozen`, by quantity.
    `gain` is the best of their log likelihoods. `discount` is the square of `Offsets.misfit` for a measurement, in
    parts of the expected one: errors that the noise does not explain are not independent, and differences of
    likelihoods mean less by so much. ValueError if the device cannot have a fault.
    """

    def __init__(self, steps: Sequence[_Step], bandwidth: float, changes: Iterable[Incident]):
        first = steps[0]
        self.begin, self.logs = first.end - STEP, first.logs
        self.particles, self.offsets = [one.restored(bandwidth) for one in first.kept], first.offsets.part(np.arange(
            len(first.kept)))
        self.frozen: dict[str, _Frozen] = {}
        for change in changes:
            if change.fault == FREEZE:
                self.frozen = _frozen(steps, change.of)
                self.begin = min(one.since for one in self.frozen.values())
                continue
            for particle in self.particles:
                particle.device.fail(*change)
        gains = np.zeros(len(self.particles))
        equal = np.full(len(gains), 1.0 / len(gains))
        for step in steps:
            phase = self.offsets.variance["crank_angle"]
            self.offsets.variance["crank_angle"] = np.maximum(phase, REPLAYED_PHASE**2)
            repeated = [one for one in step.measured
                        if one.field in self.frozen and one.time >= self.frozen[one.field].since]
            measured = [one for one in step.measured if one not in repeated]
            predicted = run(self.particles, measured, step.commands, step.end)
            gains += self.offsets.weigh(measured, predicted, equal)[0]
            gains -= sum(0.5 * math.log(one.variance + MODEL_ERROR.get(one.field, 0.0)**2) for one in repeated)
            self.offsets.grow(0.0, False)
        self.gain = float(np.max(gains, where=[one.is_alive for one in self.particles], initial=-np.inf))
        misfit = float(self.offsets.misfit.min()) / max(1, self.offsets.heard)
        self.discount = max(1.0, (2.0 * misfit)**2)


def possible_faults(scene: Scene) -> list[Incident]:
    """Return the faults of the device that a scene can have, and those of its sensors, each without an end."""
    found = [Incident("motor_stall", FOREVER), *(Incident("plate_stuck", FOREVER, side) for side in scene.plates)]
    if scene.has_rotor:
        found += [Incident("supply_sag", FOREVER, value=share * scene["motor.supply_voltage"]) for share in SUPPLIES]
    if scene.body_moves and scene["effects.friction"] != "none":
        found += [Incident("friction_patch", FOREVER, "", factor * scene["ground.friction"], -FAR,
                           FAR) for factor in FRICTIONS]
    return [*found, *(Incident(FREEZE, FOREVER, sensor) for sensor in SENSORS)]


def words_of(fault: Incident) -> str:
    """Return a fault in words, such as `plate_stuck of upper`."""
    about = f" of {fault.of}" * bool(fault.of) + f" of about {fault.value:.2g}" * bool(fault.value)
    return f"{fault.fault}{about}"
