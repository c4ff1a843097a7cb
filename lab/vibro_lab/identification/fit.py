"""The fit of a scene to a recording: from short arcs to one motion, with the noise that the recording shows."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vibro_lab.identification.noise import clipped
from vibro_lab.identification.recording import AT_MOST, Recording
from vibro_lab.identification.shooting import RESOLVED, TIGHT, Jacobian, Point, Shooting, width_of
from vibro_lab.identification.unknowns import Unknowns
from vibro_lab.identification.windowing import (
    REACHES,
    Stretch,
    arcs,
    chain,
    local_states,
    measured,
    measured_spans,
    positions_of,
    roughness,
    unmeasured,
)
from vibro_lab.identification.windows import Windows, state_names
from vibro_ros import SimulationError, in_processes, simulate

#: Stages of the fit: turns of the crank in a window, loosenesses in turn, the most sets of derivatives at each, and the
#: share of the misfit that a step wins before the next looseness is tried: the looser, the less is a minimum worth.
_ARC, _HALF, _CHAIN = 0.16, 0.5, 2.0
_ARC_LOOSENESSES, _HALF_LOOSENESSES, _CHAIN_LOOSENESSES = (1.0, 0.3, 0.1), (0.3, 0.1), (0.1, 0.01, 1e-3)
_STEPS, _ENOUGH_OF_PARTS, _ENOUGH_OF_CHAIN, _ENOUGH = 10, 0.05, 5e-3, 1e-5
#: Of masses that no sensor measures: loosenesses; that of the defects over that of the measurements, because only the
#: chain tells how such a mass moves; blur of an IMU at looseness 1 [s], and the least looseness at which it is blurred;
#: the weight of a prior, most rounds, and share of lost windows after which there is none more; standard deviations of
#: the first draws, of logarithms and of other coordinates, shares of them, draws with each, and largest share of the
#: misfit of the best that a better one has.
_UNSEEN_LOOSENESSES, _TIED, _BLUR, _LEAST_BLURRED = (0.3, 0.1, 0.03, 0.01), 0.1, 0.01, 0.03
_UNSEEN_WEIGHT, _ROUNDS, _FEW_LOST = 30.0, 6, 0.1
_FAR_OFF_IN_SHARES, _FAR_OFF, _SCOUTS, _DRAWN, _BETTER = 0.1, 0.2, (1.0, 0.5, 0.25), 60, 0.95
_PRESUMED = 0.1  # looseness as large as which a noise is presumed that neighbours do not tell: 0.1 mm, 10 mm/s
_MOST_WINDOWS = 60
_SLOWEST = 20.0  # rad/s: a slower crank makes windows no longer
_REPAIRS = 4
_MOST_LOST = 0.3  # share of lost windows beyond which they are not left out
_MISFIT = 1.5  # mean square of a window's residuals beyond which it counts as lost
#: Weights of the first stages' prior, in coordinates: a plate's stiffness shows only within a blow.
_WEIGHT, _STIFF_WEIGHT = 1.0, 100.0
_RATE = 1000.0  # Hz, of simulated speeds where none are measured
_FIRST = 0.02  # s at a recording's start from which the crank's speed there is told
_SETTLED = 3.0  # standard deviations beyond which a correlation, a noise or a speed is taken from the measurements

_ANGLE_UNIT, _SPEED_UNIT = 0.1, 10.0  # rad, rad/s: of the coordinates of the motor's start


@dataclass
class Fit:
    """A fit.

    Attributes
    ----------
    unknowns : Unknowns
        The free parameters.
    shooting : Shooting
        The chain of windows.
    at : Point
        The best point; its parameters are the coordinates of `unknowns`, then those of the motor's start, and then the
        constant errors of an IMU in their standard deviations.
    jacobian : Jacobian
        The derivatives there.
    passes : int
        Passes through the recording, of all stages.
    colours : tuple of (ndarray, ndarray)
        Standard deviations of the noise, and correlations of its neighbours, by channel.
    """

    unknowns: Unknowns
    shooting: Shooting
    at: Point
    jacobian: Jacobian
    passes: int
    colours: tuple[np.ndarray, np.ndarray]

    @property
    def coordinates(self) -> np.ndarray:
        """Coordinates of the free parameters."""
        return self.at.parameters[:len(self.unknowns.each)]

    @property
    def values(self) -> dict[str, float]:
        """Values of the free parameters by name."""
        return self.unknowns.values(self.coordinates)

    @property
    def misfit(self) -> float:
        """Twice the negative logarithm of the likelihood, but for a constant."""
        return self.shooting.misfit(self.at, 0.0, TIGHT)

    @property
    def mean_squares(self) -> np.ndarray:
        """Mean of the squared residuals of each window."""
        return mean_squares(self.shooting, self.at)

    def information(self) -> np.ndarray:
        """Return Fisher's information of all parameters, the states unknown."""
        return self.shooting.equations(self.at, self.jacobian, 0.0, TIGHT).information()


class Fitting:
    """The fitting of one scene with free parameters to a recording.

    Parameters
    ----------
    recording : Recording
        The recording.
    unknowns : Unknowns
        The free parameters, and the scene to begin with.
    workers : int
        Number of processes.
    say : callable
        Told what is being done.
    """

    def __init__(self, recording: Recording, unknowns: Unknowns, workers: int, say: Callable[[str], None]):
        self.recording = replace(recording, channels=tuple(
            replace(one, sigma=min(one.sigma, _PRESUMED * width_of(one.field))) if one.sigma_from == AT_MOST else one
            for one in recording.channels))
        self.unknowns, self._workers, self._say = unknowns, workers, say
        self._names, self._passes = state_names(unknowns.scene), 0
        angle, speed = self._crank_at(0.0, unknowns.scene["motor.speed"])
        self._first_start = {} if unknowns.scene.has_rotor else {"crank_angle": angle} | (
            {} if unknowns.scene["effects.motor"] == "ideal" else {"motor_speed": speed})
        self._biased = [one for one in recording.channels if one.bias]
        self.stretches = self._course(speed == 0.0)

    def fitted(self) -> Fit:
        """Fit from the scene's own parameters: arcs, half turns, then the chain."""
        parameters = np.append(self.unknowns.coordinates(self.unknowns.scene.parameters), self._start_coordinates())
        if not self._unseen:
            turned, lasting = np.array([(np.ptp(angle), times[-1] - times[0])
                                        for times, angle, *_ in self.stretches]).sum(axis=0).tolist()
            speed = max(_SLOWEST, turned / lasting)
            spans = arcs(self.stretches, _ARC * 2.0 * math.pi / speed, _MOST_WINDOWS)
            if len(spans):
                parameters = self._loosely(spans, parameters, "short arcs", _ARC_LOOSENESSES)
            spans = chain(self.stretches, _HALF)
            every = np.unique(np.linspace(0, len(spans) - 1, _MOST_WINDOWS).astype(int))
            parameters = self._loosely(spans[every], parameters, "half turns", _HALF_LOOSENESSES)
        return self.followed(parameters)

    def followed(self, parameters: np.ndarray) -> Fit:
        """Fit the chain of windows from coordinates of parameters that are near, or less near if masses are unseen."""
        shooting = self._shooting(chain(self.stretches, _CHAIN))
        candidates = self._candidates(shooting, parameters)
        at = self._begun(shooting, parameters, candidates)
        if self._unseen:
            at = self._begun_unseen(shooting, at)
        for looseness in _CHAIN_LOOSENESSES[-1:] if self._unseen else _CHAIN_LOOSENESSES:
            at = self._tightened(shooting, at, looseness, looseness)
            at = self._with_noise_of_residuals(shooting, at)
        shooting.prior = self._prior(parameters, np.zeros(len(self.unknowns.each)), 0.0) if self._biased else None
        at = self._repaired(shooting, at, 0.0)
        jumped = shooting.left_out & self._unseen  # such a window holds up the last, tight steps
        shooting.left_out = (mean_squares(shooting, at) > _MISFIT) | jumped
        if shooting.left_out.mean() > _MOST_LOST:  # then it is the model that does not fit
            shooting.left_out[:] = False
        colours = self._recoloured(shooting, at)
        at = shooting.point(at.parameters, at.states) or at
        self._say("all windows as one motion")
        at = shooting.minimise(at, 0.0, TIGHT, _STEPS, _ENOUGH)
        return Fit(self.unknowns, shooting, at, shooting.jacobian(at), self._passes + shooting.passes, colours)

    def _begun_unseen(self, shooting: Shooting, at: Point) -> Point:
        """Return the point that fits the chain loosely, of masses that no sensor measures: again and again from the
        motion of the scene that was found, because windows in which a mass has lost its blows find none by themselves.
        """
        at = self._scouted(shooting, at)
        for _ in range(_ROUNDS):
            shooting.prior = self._prior(at.parameters, np.full(len(self.unknowns.each), _UNSEEN_WEIGHT), 0.0)
            for looseness in _UNSEEN_LOOSENESSES:
                at = self._tightened(shooting, at, looseness, _TIED * looseness)
            if float((mean_squares(shooting, at) > _MISFIT).mean()) <= _FEW_LOST:
                break
            own = self._candidates(shooting, at.parameters)[-1]
            at = shooting.point(at.parameters, own) or at
        return at

    def _scouted(self, shooting: Shooting, at: Point) -> Point:
        """Return the best of many points whose scene moves from its own start: with parameters drawn around the best so
        far, less and less far. A mass that strikes once a turn instead of twice is not led to the other motion by small
        steps."""
        unknowns, count, random = self.unknowns, len(self.unknowns.each), np.random.default_rng(0)
        spread = np.array([_FAR_OFF if one.unit else _FAR_OFF_IN_SHARES for one in unknowns.each])
        low, high = np.array([ends for _, *ends in unknowns.limits(count)]).T
        shooting.windows.blur(_BLUR)

        def scored(parameters: np.ndarray) -> tuple[float, Point | None]:
            try:
                own = shooting.windows.course(unknowns.scene_of(parameters[:count]), self._start(parameters))
            except (SimulationError, ValueError):
                return math.inf, None
            there = shooting.point(parameters, own)
            return math.inf if there is None else shooting.windows.square_of_imu(there.found), there

        best, passes = scored(at.parameters)[0], shooting.passes
        for share in _SCOUTS:
            draws = []
            for normal in random.standard_normal((_DRAWN, count)):
                own = unknowns.directions @ at.parameters[:count] + share * spread * normal
                draws.append(np.append(np.linalg.solve(unknowns.directions, np.clip(own, low, high)),
                                       at.parameters[count:]))
            for _, future in in_processes(scored, draws, self._workers):
                square, there = future.result()
                if square < _BETTER * best:  # else the recording does not tell, and rounding would choose
                    best, at = square, there
        shooting.passes = passes + _DRAWN * len(_SCOUTS)  # whether this process has made them or another
        return at

    def _tightened(self, shooting: Shooting, at: Point, looseness: float, width: float) -> Point:
        """Return the point with all windows, at a looseness of the measurements and one of the defects."""
        self._say(f"{len(at.states)} windows of {_CHAIN:g} turns, looseness {looseness:g}")
        shooting.left_out[:] = False
        shooting.windows.blur(_BLUR * looseness if self._unseen and looseness >= _LEAST_BLURRED else 0.0)
        at = shooting.point(at.parameters, at.states) or at
        at = self._repaired(shooting, at, looseness)
        return shooting.minimise(at, looseness, width, _STEPS, _ENOUGH_OF_CHAIN)

    def _with_noise_of_residuals(self, shooting: Shooting, at: Point) -> Point:
        """Return the point with the noise that its residuals show, where neighbouring values told only a bound."""
        noises = residuals_in(shooting, at)
        self.recording = replace(self.recording, channels=tuple(
            replace(channel, sigma=noise.sigma) if channel.sigma_from == AT_MOST else channel
            for channel, noise in zip(self.recording.channels, noises, strict=True)))
        shooting.windows.recording = self.recording
        shooting.windows.recolour(np.array([one.sigma for one in self.recording.channels]), np.zeros(len(noises)))
        return shooting.point(at.parameters, at.states) or at

    def _repaired(self, shooting: Shooting, at: Point, looseness: float) -> Point:
        candidates = self._candidates(shooting, at.parameters)
        for _ in range(_REPAIRS):  # each may mend the window after one that was mended
            at, before = shooting.repaired(at, looseness, candidates), at
            if at is before:
                break
            candidates = []
        return at

    def _loosely(self, spans: np.ndarray, parameters: np.ndarray, what: str,
                 loosenesses: tuple[float, ...]) -> np.ndarray:
        """Return the coordinates that fit windows loosely, from a state for each that the measurements tell."""
        shooting = self._shooting(spans)
        shooting.prior = self._prior(parameters, np.array([
            _STIFF_WEIGHT if name.endswith("plate.stiffness") else _WEIGHT for name in self.unknowns.names]), _WEIGHT)
        candidates = self._candidates(shooting, parameters)
        at = self._begun(shooting, parameters, candidates)
        for looseness in loosenesses:
            self._say(f"{len(spans)} {what}, looseness {looseness:g}")
            at = shooting.repaired(at, looseness, candidates)
            at = shooting.minimise(at, looseness, looseness, _STEPS, _ENOUGH_OF_PARTS)
        self._passes += shooting.passes
        return at.parameters

    def _shooting(self, spans: np.ndarray) -> Shooting:
        times = np.unique(np.concatenate([one.times for one in self.recording.channels]))
        inside = np.diff(np.searchsorted(times, spans), axis=1)[:, 0] > 0  # no window is without a measurement
        windows = Windows(self.recording, self._names, spans[inside])

        def simulated(parameters: np.ndarray, states: np.ndarray):
            try:
                scene = self.unknowns.scene_of(parameters[:len(self.unknowns.each)])
            except ValueError:  # a combination that no robot has
                return None
            biases = {one.field: one.bias * own for one, own in zip(
                self._biased, parameters[len(parameters) - len(self._biased):].tolist(), strict=True)}
            return windows.simulate(scene, self._start(parameters), states, biases)

        shooting = Shooting(windows, simulated, self._workers)
        shooting.limits = self.unknowns.limits(len(self.unknowns.each) + len(self._start_coordinates()))
        return shooting

    def _begun(self, shooting: Shooting, parameters: np.ndarray, candidates: list[np.ndarray]) -> Point:
        for states in candidates:
            if (at := shooting.point(parameters, states)) is not None:
                return at
        raise ValueError(f"{self.unknowns.scene.name}: its robot cannot move as the recording begins; begin with "
                         "other values of the free parameters (--set), or give ranges")

    def _candidates(self, shooting: Shooting, parameters: np.ndarray) -> list[np.ndarray]:
        """Return states at the windows' starts by the measurements around them, then those of the scene's own motion
        from its start."""
        starts = shooting.windows.spans[:, 0]
        scene = self.unknowns.scene_of(parameters[:len(self.unknowns.each)])
        own = shooting.windows.course(scene, self._start(parameters))
        near = [local_states(self.recording, self._names, starts, reach, own) for reach in REACHES]
        if all(np.array_equal(states, own) for states in near):
            return [own]
        first = near[0].copy()
        first[0] = own[0]
        return [*near, first]

    def _course(self, rests: bool) -> list[Stretch]:
        """Return the stretches of the recording that have measurements; `rests` is whether the crank does at time 0."""
        known, channels = measured(self.recording), {}
        for name in self._names:
            position, speed = positions_of(name)
            if name == speed and name != "motor_speed":
                channels[speed] = known.get(speed) or known.get(position)
        spans, crank = measured_spans(self.recording), known.get("crank_angle")

        def lasting(time: float) -> float:
            """Return how long was measured until `time`."""
            return float((np.clip(time, *spans.T) - spans[:, 0]).sum())

        rate = min((len(one.times) / max(lasting(one.times[-1]), _FIRST) for one in channels.values() if one),
                   default=_RATE)
        parts = [begin + np.arange(0.0, end - begin, 1.0 / rate) for begin, end in spans.tolist()]
        run = simulate(self.unknowns.scene, times=np.concatenate(parts), commands=self.recording.commands)
        found, first = list[Stretch](), 0
        for times in parts:
            part = slice(first, first := first + len(times))
            speeds = []
            for speed, channel in channels.items():
                if channel is None:
                    speeds.append(getattr(run, speed)[part])
                else:
                    values = np.interp(times, channel.times, channel.values)
                    speeds.append(values if channel.field == speed else np.gradient(values, times))
            angle = np.interp(times, crank.times, crank.values) if crank else run.crank_angle[part]
            if found:
                rests = self._crank_at(times[0], float(run.motor_speed[part.start]))[1] == 0.0
            found.append(Stretch(times, angle, roughness(times, speeds), rests))
        return found

    def _crank_at(self, begin: float, speed: float) -> tuple[float, float]:
        """Return angle and speed of the crank at `begin` [s], as far as the recording tells them from there on, speed 0
        if it rests; `speed` is what counts otherwise."""
        crank = measured(self.recording).get("crank_angle")
        if crank is None or not (from_then := crank.times >= begin).any():
            return 0.0, speed
        times, values = crank.times[from_then], crank.values[from_then]
        first, angle = times <= times[0] + _FIRST, float(values[0])
        if first.sum() > 2:  # a parabola, because the motor may gain speed from the first instant on
            found, covariance = np.polyfit(times[first] - begin, values[first], 2,
                                           w=np.full(first.sum(), 1.0 / crank.sigma), cov="unscaled")
            speed, angle = found[1:].tolist()
            if abs(speed) < _SETTLED * math.sqrt(covariance[1, 1]):
                speed = 0.0
        return angle, speed

    @property
    def _unseen(self) -> bool:
        return bool(unmeasured(self.recording, self._names))

    def _prior(self, parameters: np.ndarray, weights: np.ndarray, of_motor: float) -> tuple[np.ndarray, np.ndarray]:
        """Return a prior around coordinates, with `weights` of the unknowns; of an IMU's constant errors, it is the
        data sheet's."""
        motor = np.full(len(parameters) - len(weights) - len(self._biased), of_motor)
        expected = parameters.copy()
        expected[len(parameters) - len(self._biased):] = 0.0
        return expected, np.concatenate([weights, motor, np.ones(len(self._biased))])

    def _start_coordinates(self) -> np.ndarray:
        """Return the first coordinates of what is no unknown: the motor's start, and an IMU's constant errors."""
        units = {"crank_angle": _ANGLE_UNIT, "motor_speed": _SPEED_UNIT}
        motor = [value / units[name] for name, value in self._first_start.items() if name == "crank_angle" or value]
        return np.array([*motor, *(0.0 for _ in self._biased)])

    def _start(self, parameters: np.ndarray) -> Mapping[str, float]:
        """Return the motor's start of coordinates; a motor that rests stays at rest."""
        own = parameters[len(self.unknowns.each):len(parameters) - len(self._biased)].tolist()
        found = dict(self._first_start)
        if own:
            found["crank_angle"] = own[0] * _ANGLE_UNIT
        if len(own) > 1:
            found["motor_speed"] = own[1] * _SPEED_UNIT
        return found

    def _recoloured(self, shooting: Shooting, at: Point) -> tuple[np.ndarray, np.ndarray]:
        """Take correlations and standard deviations of the noise from the residuals, where they differ clearly.

        Noise that the recording states is never taken as less, nor a negative correlation, as an encoder's steps have
        at a constant speed: intervals become wider by what is found here, and not narrower.
        """
        sigmas, correlations = [], []
        for sigma, correlation, number, mean_square in residuals_in(shooting, at):
            excess = _SETTLED * math.sqrt(2.0 / number)
            sigmas.append(sigma * math.sqrt(mean_square) if mean_square > 1.0 + excess else sigma)
            correlations.append(correlation if correlation > _SETTLED / math.sqrt(number) else 0.0)
        colours = np.array(sigmas), np.array(correlations)
        shooting.windows.recolour(*colours)
        return colours


def mean_squares(shooting: Shooting, at: Point) -> np.ndarray:
    """Return the mean of the squared residuals of each window; 0 for a window without measurements."""
    windows, count = shooting.windows, len(at.states)
    squares = np.bincount(windows.window, at.found.residuals**2, count)
    return squares / np.maximum(np.bincount(windows.window, minlength=count), 1)


class Residual(NamedTuple):
    """Noise of a channel after the fit: standard deviation of the noise in the channel's unit, correlation of
    neighbouring residuals, their number, and their mean square in standard deviations."""

    sigma: float
    correlation: float
    number: int
    mean_square: float


def residuals_in(shooting: Shooting, at: Point) -> list[Residual]:
    """Return the noise of each channel at a point that was computed with white noise as the recording states it.

    Noise that was estimated from neighbouring values, with the motion in them, is estimated again from neighbouring
    residuals. These do not show a model that fits badly, because its residuals change slowly; the mean square does.
    """
    windows, found = shooting.windows, []
    for number, channel in enumerate(windows.recording.channels):
        mine = (windows.channel == number) & ~shooting.left_out[windows.window]
        residuals, window = at.found.residuals[mine], windows.window[mine]
        together = window[1:] == window[:-1]
        square = float(residuals @ residuals)
        correlation = float((residuals[1:] * residuals[:-1])[together].sum()) / square if square else 0.0
        scale = 1.0
        if channel.sigma_from in ("neighbours", AT_MOST) and together.any():
            scale = max(clipped(np.abs(np.diff(residuals)[together]) / math.sqrt(2.0)),
                        RESOLVED * width_of(channel.field) / channel.sigma)  # less than this, no fit resolves
        found.append(Residual(scale * channel.sigma, min(max(correlation, -0.99), 0.99), len(residuals),
                              square / max(len(residuals), 1) / scale**2))
    return found
