"""The fit of a scene to a recording: from short arcs to one motion, with the noise that the recording shows."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibro_ros.identification.noise import clipped
from vibro_ros.identification.recording import Recording
from vibro_ros.identification.shooting import RESOLVED, TIGHT, Jacobian, Point, Shooting, width_of
from vibro_ros.identification.unknowns import Unknowns
from vibro_ros.identification.windowing import (
    REACHES,
    arcs,
    chain,
    local_states,
    measured,
    positions_of,
    roughness,
    unmeasured,
)
from vibro_ros.identification.windows import Windows, state_names
from vibro_ros.simulation.runs import simulate

#: Stages of the fit: turns of the crank in a window, loosenesses in turn, and the most steps at each.
_ARC, _HALF, _CHAIN = 0.16, 0.5, 2.0
_FIRST_LOOSENESSES, _CHAIN_LOOSENESSES = (1.0, 0.3, 0.1), (0.1, 0.01, 1e-3)
_FIRST_STEPS, _STEPS = 4, 10
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
        The best point; its parameters are the coordinates of `unknowns`, and then of the motor's start.
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
        self.recording, self.unknowns, self._workers, self._say = recording, unknowns, workers, say
        self._names, self._passes = state_names(unknowns.scene), 0
        angle, speed = self._crank_at_start()
        self._rests = speed == 0.0
        self._first_start = {} if unknowns.scene.has_rotor else {"crank_angle": angle} | (
            {} if unknowns.scene["effects.motor"] == "ideal" else {"motor_speed": speed})
        self.times, self._angle, self._rough = self._course()

    def fitted(self) -> Fit:
        """Fit from the scene's own parameters: arcs, half turns, then the chain."""
        parameters = np.append(self.unknowns.coordinates(self.unknowns.scene.parameters), self._start_coordinates())
        if not unmeasured(self.recording, self._names):
            speed = max(_SLOWEST, float(np.ptp(self._angle)) / (self.times[-1] - self.times[0]))
            spans = arcs(self.times, self._rough, _ARC * 2.0 * math.pi / speed, _MOST_WINDOWS)
            if len(spans):
                parameters = self._loosely(spans, parameters, "short arcs")
            spans = self._chain(_HALF)
            every = np.unique(np.linspace(0, len(spans) - 1, _MOST_WINDOWS).astype(int))
            parameters = self._loosely(spans[every], parameters, "half turns")
        return self.followed(parameters)

    def followed(self, parameters: np.ndarray) -> Fit:
        """Fit the chain of windows from coordinates of parameters that are near."""
        shooting = self._shooting(self._chain(_CHAIN))
        candidates = self._candidates(shooting, parameters)
        at = self._begun(shooting, parameters, candidates)
        for looseness in _CHAIN_LOOSENESSES:
            self._say(f"{len(at.states)} windows of {_CHAIN:g} turns, looseness {looseness:g}")
            shooting.left_out[:] = False
            at = self._repaired(shooting, at, looseness)
            at = shooting.minimise(at, looseness, looseness, _STEPS)
        at = self._repaired(shooting, at, 0.0)
        shooting.left_out = mean_squares(shooting, at) > _MISFIT
        if shooting.left_out.mean() > _MOST_LOST:  # then it is the model that does not fit
            shooting.left_out[:] = False
        colours = self._recoloured(shooting, at)
        at = shooting.point(at.parameters, at.states) or at
        self._say("all windows as one motion")
        at = shooting.minimise(at, 0.0, TIGHT, _STEPS, enough=1e-6)
        return Fit(self.unknowns, shooting, at, shooting.jacobian(at), self._passes + shooting.passes, colours)

    def _repaired(self, shooting: Shooting, at: Point, looseness: float) -> Point:
        candidates = self._candidates(shooting, at.parameters)
        for _ in range(_REPAIRS):  # each may mend the window after one that was mended
            at, before = shooting.repaired(at, looseness, candidates), at
            if at is before:
                break
            candidates = []
        return at

    def _loosely(self, spans: np.ndarray, parameters: np.ndarray, what: str) -> np.ndarray:
        """Return the coordinates that fit windows loosely, from a state for each that the measurements tell."""
        shooting = self._shooting(spans)
        names = self.unknowns.names
        weights = [_STIFF_WEIGHT if name.endswith("plate.stiffness") else _WEIGHT for name in names]
        shooting.prior = parameters.copy(), np.array(weights + [_WEIGHT] * (len(parameters) - len(names)))
        candidates = self._candidates(shooting, parameters)
        at = self._begun(shooting, parameters, candidates)
        for looseness in _FIRST_LOOSENESSES:
            self._say(f"{len(spans)} {what}, looseness {looseness:g}")
            at = shooting.repaired(at, looseness, candidates)
            at = shooting.minimise(at, looseness, looseness, _FIRST_STEPS, enough=1e-2)
        self._passes += shooting.passes
        return at.parameters

    def _shooting(self, spans: np.ndarray) -> Shooting:
        windows = Windows(self.recording, self._names, spans)

        def simulated(parameters: np.ndarray, states: np.ndarray):
            try:
                scene = self.unknowns.scene_of(parameters[:len(self.unknowns.each)])
            except ValueError:  # a combination that no robot has
                return None
            return windows.simulate(scene, self._start(parameters), states)

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
        if len(unmeasured(self.recording, self._names)) == len(self._names):
            return [own]
        near = [local_states(self.recording, self._names, starts, reach, own) for reach in REACHES]
        first = near[0].copy()
        first[0] = own[0]
        return [*near, first]

    def _chain(self, turns: float) -> np.ndarray:
        return chain(self.times, self._rough, self._angle, turns, self._rests)

    def _course(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return instants, the crank's angle there, and the roughness of the masses' and the body's speeds."""
        known, channels = measured(self.recording), {}
        for name in self._names:
            position, speed = positions_of(name)
            if name == speed and name != "motor_speed":
                channels[speed] = known.get(speed) or known.get(position)
        rate = min((len(one.times) / one.times[-1] for one in channels.values() if one), default=_RATE)
        times = np.arange(0.0, self.recording.duration, 1.0 / rate)
        run = simulate(self.unknowns.scene, times=times, commands=self.recording.commands)
        speeds = []
        for speed, channel in channels.items():
            if channel is None:
                speeds.append(getattr(run, speed))
            else:
                values = np.interp(times, channel.times, channel.values)
                speeds.append(values if channel.field == speed else np.gradient(values, times))
        crank = known.get("crank_angle")
        angle = np.interp(times, crank.times, crank.values) if crank else run.crank_angle
        return times, angle, roughness(times, speeds)

    def _crank_at_start(self) -> tuple[float, float]:
        """Return angle and speed of the crank at time 0, as far as the recording tells them; speed 0 if it rests."""
        scene, crank = self.unknowns.scene, measured(self.recording).get("crank_angle")
        angle, speed = 0.0, scene["motor.speed"]
        if crank is not None:
            first = crank.times <= crank.times[0] + _FIRST
            angle = float(crank.values[0])
            if first.sum() > 2:  # a parabola, because the motor may gain speed from the first instant on
                found, covariance = np.polyfit(crank.times[first], crank.values[first], 2,
                                               w=np.full(first.sum(), 1.0 / crank.sigma), cov="unscaled")
                speed, angle = found[1:].tolist()
                if abs(speed) < _SETTLED * math.sqrt(covariance[1, 1]):
                    speed = 0.0
        return angle, speed

    def _start_coordinates(self) -> np.ndarray:
        units = {"crank_angle": _ANGLE_UNIT, "motor_speed": _SPEED_UNIT}
        return np.array([value / units[name] for name, value in self._first_start.items()
                         if name == "crank_angle" or value])

    def _start(self, parameters: np.ndarray) -> Mapping[str, float]:
        """Return the motor's start of coordinates; a motor that rests stays at rest."""
        own = parameters[len(self.unknowns.each):].tolist()
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
        if channel.sigma_from == "neighbours" and together.any():
            scale = max(clipped(np.abs(np.diff(residuals)[together]) / math.sqrt(2.0)),
                        RESOLVED * width_of(channel.field) / channel.sigma)  # less than this, no fit resolves
        found.append(Residual(scale * channel.sigma, min(max(correlation, -0.99), 0.99), len(residuals),
                              square / max(len(residuals), 1) / scale**2))
    return found
