"""What a fit is worth: intervals by profile likelihood, what the recording cannot tell, and whether the model fits."""

import math
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, norm

from vibro_lab.identification.fit import Fit
from vibro_lab.identification.unknowns import plates_in
from vibro_ros import Scene

LEVEL = 0.95
"""Coverage of the intervals."""
HALF_WIDTH = float(norm.ppf(0.5 + 0.5 * LEVEL))
"""Half an interval in standard deviations, where the likelihood is normal."""
REJECTED = 1e-3
"""p-value below which a model does not fit."""
#: Standard deviation of a coordinate beyond which the recording does not tell it: a third of a positive parameter.
_UNTOLD = 0.3
_LEAST_INFORMATION, _ROUNDING = 1e-6, 1e-15  # in a direction; below them a recording tells nothing of it
_WIDEST = 10.0  # standard deviation of a coordinate beyond which an interval is the parameter's range
_ALONE = 0.9  # squared share of a parameter in what is not told, above which it is not told alone
_SHARE = 0.25  # of a combination's largest part, below which another part is not named
#: Variance of an estimate of noise from neighbours, in units of that of as many squares of white noise.
_ESTIMATED = 5.0
_DELAY = 1e-5  # s, of a clock's derivative
_EXPLAINS, _ALIKE = 0.3, 0.9  # share of the excess that explains it; and of the best one, that is as good
_LAGS = 10  # samples: a third of a turn at 500 Hz, more than a turn at 100 Hz
_JACOBIANS, _TRIES = 3, 2  # sets of derivatives, the first of the best point, and lengths, of a side of an interval
_LEAST, _MOST = 0.3, 3.0  # factors between two lengths


def covariance_of(fit: Fit) -> np.ndarray:
    """Return the covariance of all parameters' coordinates; 1e6 at most in a direction that the recording does not
    tell, so that it never counts as known."""
    spreads, parts = np.linalg.eigh(fit.information())
    return (parts / np.maximum(spreads, max(_LEAST_INFORMATION, _ROUNDING * spreads.max()))) @ parts.T


def intervals(fit: Fit, say: Callable[[str], None]) -> tuple[dict[str, tuple[float, float]], dict[str, np.ndarray]]:
    """Return the 95 % interval of each parameter: values at which the misfit of the best point with that value is
    higher by the quantile of a chi square with one degree of freedom. And the profiles by which they were found:
    values in ascending order and the growth of the misfit there, shape (n, 2)."""
    found_intervals, profiles, count = {}, {}, len(fit.point.parameters)
    covariance = covariance_of(fit)
    for k, unknown in enumerate(fit.unknowns.each):
        say(f"interval {k + 1} of {len(fit.unknowns.each)}: {unknown.name}")
        direction = np.zeros(count)
        direction[:len(fit.unknowns.each)] = fit.unknowns.directions[k]
        best = float(direction @ fit.point.parameters)
        tried = [(0.0, 0.0)]
        low, high = (unknown.value(best + sign * _reach(fit, direction, covariance, sign, tried))
                     for sign in (-1.0, 1.0))
        found_intervals[unknown.name] = (low, high)
        profiles[unknown.name] = np.array([(unknown.value(best + shift), growth) for shift, growth in sorted(tried)])
    return found_intervals, profiles


def _reach(fit: Fit, direction: np.ndarray, covariance: np.ndarray, sign: float,
           tried: list[tuple[float, float]]) -> float:
    """Return how far the direction's coordinate may go until the misfit has grown by the quantile; shifts and growths
    on the way are added to `tried`."""
    quantile = float(chi2.ppf(LEVEL, 1))
    deviation = math.sqrt(float(direction @ covariance @ direction))
    if deviation > _WIDEST:
        return math.inf
    length = math.sqrt(quantile) * deviation
    for _ in range(_TRIES):
        growth = held(fit, direction, covariance, sign * length)
        if growth < math.inf:
            tried.append((sign * length, growth))
        length *= min(max(math.sqrt(quantile / max(growth, 1e-9)), _LEAST), _MOST)
    return length


def held(fit: Fit, direction: np.ndarray, covariance: np.ndarray, shift: float) -> float:
    """Return the growth of the misfit where the coordinate along `direction` is held at `shift` from that of the fit,
    and all others are fitted again; infinity where there is no motion. Windows that jump on the way do not count."""
    shooting, target = fit.shooting, float(direction @ fit.point.parameters) + shift
    along = covariance @ direction
    change = along * (shift / float(direction @ along))
    equations = shooting.equations(fit.point, fit.jacobian, 0.0, shooting.tight)
    point = shooting.point(fit.point.parameters + change, fit.point.states + equations.states_for(change))
    if point is None:
        return math.inf
    within = shooting.with_limit(direction, target, target)
    point = within.minimise(point, 0.0, shooting.tight, _JACOBIANS, 1e-6, fit.jacobian)
    growth = within.misfit(point, 0.0, shooting.tight) - within.misfit(fit.point, 0.0, shooting.tight)
    shooting.passes += within.passes
    return growth


def rank_in_words(fit: Fit) -> tuple[str, ...]:
    """Return sentences on the combinations of parameters that the recording cannot tell."""
    names, count = fit.unknowns.names, len(fit.unknowns.each)
    information = fit.information()
    spreads, parts = np.linalg.eigh(_parameters_alone(information, count))
    untold = parts[:, spreads < _UNTOLD**-2]
    alone = [name for name, row in zip(names, untold, strict=True) if row @ row > _ALONE]
    words = [f"the recording does not tell {name}" for name in alone]
    for part in untold.T if len(alone) < untold.shape[1] else ():
        named = [name for name, share in zip(names, part, strict=True)
                 if abs(share) > _SHARE * np.abs(part).max() and name not in alone]
        if len(named) > 1:
            words.append(f"the recording does not tell {' and '.join(named)} apart")
    deviations = np.sqrt(np.diag(covariance_of(fit)))
    for stiffness, damping in plates_in(names):
        alone, together = deviations[names.index(stiffness)], deviations[names.index(damping)]
        if alone > 3.0 * together:
            words.append(f"{stiffness} and .damping are told as c/√k, that is the restitution, to "
                         f"{100.0 * together:.2g} %; the stiffness alone to {100.0 * alone:.2g} %")
    return tuple(words)


def _parameters_alone(information: np.ndarray, count: int) -> np.ndarray:
    """Return the information of the first `count` parameters, the others unknown."""
    rest = information[count:, count:]
    beside = information[:count, count:]
    return information[:count, :count] - beside @ np.linalg.pinv(rest, hermitian=True) @ beside.T


@dataclass(frozen=True)
class Noise:
    """What is left of a channel when the simulated motion is taken off.

    Attributes
    ----------
    sensor, field : str
        The channel.
    count : int
        Number of measurements, without outliers.
    mean_square : float
        Of the residuals in standard deviations; 1 if the model fits and the noise is as stated, or as found.
    correlation : float
        Of neighbouring residuals; 0 for white noise.
    known : bool
        Whether the standard deviation is known, not estimated from neighbours.
    stated, size : float
        Standard deviation of the noise that the recording states, and the size of the one found in parts of it.
    jitter : float
        Standard deviation [s] of the sensor's stamps; 0 if none was found.
    outliers : int
        Number of outliers.
    whiteness : float
        Probability of residuals that go together as much, if the noise that was found were white; 1 where it is the
        stated one.
    """

    sensor: str
    field: str
    count: int
    mean_square: float
    correlation: float
    known: bool
    stated: float
    size: float
    jitter: float
    outliers: int
    whiteness: float

    @property
    def excess(self) -> float:
        """Mean square above 1 in standard deviations, with the uncertainty of an estimated noise and of correlation."""
        if self.jitter and not self.known:  # nothing states its size, and jitter hides it from neighbours
            return 0.0
        is_known = self.known and self.size == 1.0 and not self.jitter
        white = (1.0 + self.correlation**2) / (1.0 - self.correlation**2) if is_known else _ESTIMATED
        return (self.mean_square - 1.0) / math.sqrt(2.0 * white / max(self.count, 1))

    @property
    def p_value(self) -> float:
        """Probability of residuals as large and as little white if the model were right."""
        return min(float(norm.sf(self.excess)), self.whiteness)


def p_value(noises: list[Noise]) -> float:
    """Return the probability of a channel as bad as the worst if the model were right (Bonferroni's bound)."""
    return min(1.0, len(noises) * min(noise.p_value for noise in noises))


def whiteness(residuals: np.ndarray) -> float:
    """Return the probability of correlations as large as those of the residuals, up to `_LAGS` samples apart, if they
    were white (Box and Pierce). A residual beyond three standard deviations counts as one of three."""
    size = float(np.sqrt(np.mean(residuals**2))) if len(residuals) else 0.0
    if len(residuals) <= 2 * _LAGS or not size:
        return 1.0
    limited = np.clip(residuals / size, -3.0, 3.0)
    shares = [float(limited[lag:] @ limited[:-lag]) / float(limited @ limited) for lag in range(1, _LAGS + 1)]
    return float(chi2.sf(len(limited) * sum(share**2 for share in shares), _LAGS))


def suspicion(fit: Fit, trials: Mapping[str, Callable[[], tuple[Scene, float]]]) -> str:
    """Return in words what would explain that the model does not fit: an effect, by a score test of its parameter, or
    the clock of a sensor, by one of a shift in each third of the recording.

    `trials` returns for each effect a scene that has a little of it, and how much.
    """
    shooting, windows, point = fit.shooting, fit.shooting.windows, fit.point
    used = ~shooting.left_out[windows.window] & ~windows.is_wild
    excess = float((point.simulated.residuals[used]**2).sum()) - used.sum()
    shares: dict[str, float] = {}
    for name, trial in trials.items():
        scene, size = trial()
        with_effect = windows.simulate(scene, fit.start, point.states, fit.nuisances.errors(
            point.parameters[len(fit.unknowns.each):]))
        if with_effect is not None:
            shares[f"the effect {name}"] = _gain(fit, (with_effect.residuals - point.simulated.residuals) / size,
                                                 (with_effect.ends - point.simulated.ends) / size) / max(excess, 1.0)
    windows.delay = _DELAY
    late = shooting.point(point.parameters, point.states) or point
    windows.delay = 0.0
    rates = (late.simulated.residuals - point.simulated.residuals) / _DELAY
    third = fit.shooting.windows.recording.duration / 3.0
    sensors = np.array([channel.sensor for channel in windows.recording.channels])[windows.channel]
    for sensor in np.unique(sensors):
        parts = [_gain(fit, np.where((sensors == sensor) & (windows.times // third == k), rates, 0.0),
                       np.zeros_like(point.simulated.ends)) for k in range(3)]
        shares[f"another clock of {sensor}"] = max(parts) / max(excess, 1.0)
    shares = {name: min(share, 1.0) for name, share in shares.items()}  # a derivative that explains more is too long
    best = max(shares.values())
    if best < _EXPLAINS:
        return "no effect that can be tried and no clock would explain it"
    alike = sorted((name for name in shares if shares[name] > _ALIKE * best), key=lambda name: -shares[name])
    effects, clocks = ([name.split()[-1] for name in alike if word in name] for word in ("effect", "clock"))
    remedies = ["try effects " + ",".join(effects)] * bool(effects) + [
        "look at the clock of " + ",".join(clocks)] * bool(clocks)
    return f"{' or '.join(alike)} would explain {100.0 * best:.0f} % of it: {', or '.join(remedies)}"


def _gain(fit: Fit, residuals: np.ndarray, ends: np.ndarray) -> float:
    """Return by how much the misfit falls along one more derivative of the residuals and of the windows' ends."""
    more = replace(fit.jacobian, residuals=np.column_stack([fit.jacobian.residuals, residuals]),
                   ends=np.concatenate([fit.jacobian.ends, ends[..., None]], axis=2))
    point, shooting = replace(fit.point, parameters=np.append(fit.point.parameters, 0.0)), copy(fit.shooting)
    if shooting.prior is not None:
        shooting.prior = np.append(shooting.prior[0], 0.0), np.append(shooting.prior[1], 0.0)
    return shooting.equations(point, more, 0.0, shooting.tight).gain_of_last()
