"""`identify`: which robot made a recording, how sure that is, and whether another effect explains it better."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from vibro_lab.identification.fit import Fit, Fitting, mean_squares, residuals_in
from vibro_lab.identification.inference import REJECTED, Noise, covariance_of, intervals, p_value, rank_in_words
from vibro_lab.identification.recording import AT_MOST, IMU, Recording, read_recording
from vibro_lab.identification.shooting import TIGHT, Point
from vibro_lab.identification.unknowns import Unknowns
from vibro_ros import PARAMETERS, BagError, Scene, check_scene, core_count, quoted

WINDOW = np.dtype([("start", float), ("end", float), ("mean_square", float), ("used", bool)])
"""Start and end of a window [s], mean square of its residuals in standard deviations, and whether it counts: one whose
motion jumps with its start, as where a mass rattles to rest, tells nothing."""
DOUBTFUL = 0.1
"""Share of windows left out beyond which a fit is not called one."""
GOOD, _BAD = 1.5, 100.0
"""Mean squares: of residuals that a fit explains, at most; and of a window that is lost, which counts no more."""


@dataclass(frozen=True)
class Effect:
    """An effect that a scene may have in addition: the parameters that switch it on, and those that it frees."""

    settings: Mapping[str, object]
    free: Mapping[str, Callable[[Scene], float]]


EFFECTS: Mapping[str, Effect] = {
    "stribeck": Effect({"effects.friction": "stribeck"},
                       {"ground.static_friction": lambda scene: 1.25 * scene["ground.friction"],
                        "ground.stribeck_speed": lambda scene: scene["ground.stribeck_speed"]}),
    "slope": Effect({}, {"ground.slope": lambda scene: scene["ground.slope"]}),
    "viscous": Effect({}, {"ground.viscous_friction": lambda scene: scene["ground.viscous_friction"]}),
    "reaction": Effect({"effects.reaction": True}, {}),
    "lag": Effect({"effects.motor": "lag"}, {"motor.time_constant": lambda scene: scene["motor.time_constant"]}),
}
"""Effects that can be tried in addition, by name."""


@dataclass(frozen=True)
class Alternative:
    """The same recording fitted with one effect more.

    Attributes
    ----------
    effect : str
        A key of `EFFECTS`.
    gain : float
        Twice the logarithm of the likelihood ratio, by which it fits better.
    p_value : float
        Probability of such a gain if the effect were absent; without parameters of its own the likelihood ratio.
    values : dict of str to float
        Values of its free parameters by name.
    scene : Scene
        The scene that was found with it.
    mean_square : float
        Of its residuals in standard deviations, with the windows that are left out; about 1 if it explains them.
    """

    effect: str
    gain: float
    p_value: float
    values: dict[str, float]
    scene: Scene
    mean_square: float


@dataclass(frozen=True)
class Identification:
    """The robot that made a recording.

    Attributes
    ----------
    values : dict of str to float
        Values of the free parameters by name, in SI units.
    intervals : dict of str to (float, float)
        Their 95 % intervals by profile likelihood.
    covariance : ndarray, shape (parameters, parameters)
        Covariance of the values in the order of `values`, linearised.
    rank : tuple of str
        Sentences on what the recording cannot tell.
    chi_square : dict of str to float
        Mean square of the residuals in standard deviations, by sensor; 1 if model and noise are right.
    p_value : float
        Probability of residuals as large if the model were right; below 1e-3 the model does not fit.
    autocorrelation : dict of str to float
        Correlation of neighbouring residuals by channel, such as ``odom.body_position``.
    alternatives : tuple of Alternative
        Fits with one effect more, the best first.
    scene, given : Scene
        The scene with the values, and the scene that the fit began with.
    windows : ndarray, dtype `WINDOW`
        The windows of the fit.
    passes : int
        Number of simulations of the whole recording.
    said : tuple of str
        What was read of the recording, and where each noise comes from.
    recording : Recording
        The measurements.
    residuals : dict of str to ndarray, shape (n, 2)
        Instants [s] and residuals in standard deviations by channel, made white.
    simulated : dict of str to ndarray, shape (n, 2)
        Instants [s] and simulated values by channel.
    profiles : dict of str to ndarray, shape (n, 2)
        Values of each parameter, and how much twice the negative logarithm of the likelihood grows there, the other
        parameters fitted again.
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    covariance: np.ndarray
    rank: tuple[str, ...]
    chi_square: dict[str, float]
    p_value: float
    autocorrelation: dict[str, float]
    alternatives: tuple[Alternative, ...]
    scene: Scene
    given: Scene
    windows: np.ndarray
    passes: int
    said: tuple[str, ...]
    recording: Recording
    residuals: dict[str, np.ndarray]
    simulated: dict[str, np.ndarray]
    profiles: dict[str, np.ndarray]

    @property
    def verdict(self) -> str:
        """Whether the model fits, in a sentence."""
        better = [one for one in self.alternatives if one.p_value < REJECTED]
        if explaining := [one for one in better if one.mean_square < GOOD]:
            best = explaining[0]
            return (f"the effect {best.effect} fits better, p = {best.p_value:.1g}: the recording is of another robot "
                    f"than the scene can be; go on from the scene with {best.effect}")
        if better:
            return (f"the model does not fit, p = {self.p_value:.1g}, and no effect that was tried explains the "
                    f"recording: with {better[0].effect} the mean square is {better[0].mean_square:.3g}; begin nearer, "
                    "or try others")
        if self.p_value < REJECTED:
            return (f"the model does not fit, p = {self.p_value:.1g}: values and intervals are of the nearest robot "
                    "that the scene can be, not of the one recorded; try effects")
        if (lost := float((~self.windows["used"]).mean())) > DOUBTFUL:
            return (f"the model fits the windows that count, p = {self.p_value:.2g}, but {100.0 * lost:.0f} % of them "
                    "are left out, and what they would say is not known: measure masses and body, or begin nearer")
        return f"the model fits, p = {self.p_value:.2g}"

    def words(self) -> list[str]:
        """Return the result in lines: values with intervals, what the recording does not tell, and the verdict."""
        labels = [f"{name} [{unit}]" if (unit := PARAMETERS[name].unit) else name for name in self.values]
        width = max(map(len, labels))
        lines = list(self.said)
        lines += [f"{label:{width}} = {value:.6g}   95 %: {low:.6g} to {high:.6g}   scene: {self.given[name]:.6g}"
                  for label, (name, value), (low, high) in zip(labels, self.values.items(), self.intervals.values(),
                                                               strict=True)]
        lines += self.rank
        lines += [f"{sensor}: mean square of the residuals {square:.3f}" for sensor, square in self.chi_square.items()]
        if lost := int((~self.windows["used"]).sum()):
            lines.append(f"{lost} of {len(self.windows)} windows are left out: their motion jumps with its start")
        lines += [f"with {one.effect}: better by {one.gain:.1f}, p = {one.p_value:.1g}" for one in self.alternatives]
        return [*lines, self.verdict]


def identify(bag: str | Path, scene: Scene, free: Sequence[str],
             ranges: Mapping[str, tuple[float, float]] | None = None, noise: Mapping[str, float] | None = None,
             effects: Sequence[str] = (), workers: int | None = None,
             say: Callable[[str], None] = lambda words: None) -> Identification:
    """Find the parameters of the robot that made a recording.

    Parameters
    ----------
    bag : str or Path
        A recording: a bag of the robot's topics.
    scene : Scene
        The scene to begin with; parameters that are not free keep its values.
    free : sequence of str
        Names of the parameters that are found.
    ranges : mapping of str to (float, float)
        Ranges in which some of them are searched, in SI units.
    noise : mapping of str to float
        Standard deviations of noise, by sensor or by channel, see `read_recording`; infinity leaves one out.
    effects : sequence of str
        Effects to be tried in addition, keys of `EFFECTS`.
    workers : int
        Number of processes, by default the number of cores.
    say : callable
        Told what is being done, a sentence at a time.

    Returns
    -------
    Identification

    Raises
    ------
    BagError
        When the bag cannot be read, or measures nothing of this robot.
    ValueError
        For an unknown parameter, range or effect, or a robot that cannot move as the recording begins.

    Examples
    --------
    >>> scene = vibro_ros.load_scene("damped").with_parameters({"ground.friction": 0.22})
    >>> found = vibro_lab.identify("laboratory_bag", scene, free=["ground.friction"])
    >>> low, high = found.intervals["ground.friction"]
    >>> f"{found.values['ground.friction']:.3f}, 95 %: {low:.3f} to {high:.3f}"
    '0.200, 95 %: 0.200 to 0.200'
    >>> found.verdict
    'the model fits, p = ...'
    """
    check_scene(scene)
    unknowns, wanted = Unknowns.of(scene, free, dict(ranges or {})), _checked(effects, scene, free)
    recording = _usable(read_recording(bag, scene, noise))
    workers = core_count() if workers is None else workers
    fit = Fitting(recording, unknowns, workers, say).fitted()
    alternatives = [_alternative(name, recording, fit, workers, say) for name in wanted]
    (noises, simulated), covariance = _noises(fit), covariance_of(fit)
    recording = fit.shooting.windows.recording
    said = (*recording.said, *(f"{one.sensor}: {one.field}: noise {one.sigma:.3g} by the residuals of the fit"
                               for one in recording.channels if one.sigma_from == AT_MOST))
    slopes = unknowns.slopes(fit.coordinates)
    own = covariance[:len(unknowns.each), :len(unknowns.each)]
    windows = fit.shooting.windows
    table = np.array([(*span, square, not left_out) for span, square, left_out in zip(
        windows.spans, fit.mean_squares, fit.shooting.left_out, strict=True)], dtype=WINDOW)
    found, profiles = intervals(fit, say)
    return Identification(
        values=fit.values, intervals=found, covariance=slopes @ own @ slopes.T, rank=rank_in_words(fit),
        chi_square=_by_sensor(noises), p_value=p_value(noises),
        autocorrelation={f"{one.sensor}.{one.field}": one.correlation for one in noises},
        alternatives=tuple(sorted(alternatives, key=lambda one: (one.p_value, -one.gain))),
        scene=unknowns.scene_of(fit.coordinates), given=unknowns.scene, windows=table, passes=fit.passes, said=said,
        recording=recording, residuals=_by_channel(fit, fit.at.found.residuals),
        simulated=_by_channel(fit, simulated), profiles=profiles)


def _checked(effects: Sequence[str], scene: Scene, free: Sequence[str]) -> tuple[str, ...]:
    for name in effects:
        if name not in EFFECTS:
            raise ValueError(f"effects: {quoted(name)} is none that can be tried; give any of {', '.join(EFFECTS)}")
        settings, more = EFFECTS[name].settings, EFFECTS[name].free
        if set(more) & set(free) or (settings and all(scene[one] == value for one, value in settings.items())):
            raise ValueError(f"effects: {name} is a part of this fit already; leave it out")
    return tuple(effects)


def _usable(recording: Recording) -> Recording:
    """Return the recording (BagError: it has measurements of an IMU alone)."""
    if all(one.sensor == IMU for one in recording.channels):
        raise BagError("the bag: has measurements of an IMU alone, which tell no place and no angle of the crank; "
                       "record tracking, odom, encoder or joint_states with it")
    return recording


def _stated(fit: Fit) -> Point:
    """Return the best point, its residuals in the noise that the recording states, and white."""
    shooting = fit.shooting
    channels = shooting.windows.recording.channels
    shooting.windows.recolour(np.array([one.sigma for one in channels]), np.zeros(len(channels)))
    at = shooting.point(fit.at.parameters, fit.at.states) or fit.at
    shooting.windows.recolour(*fit.colours)
    return at


def _noises(fit: Fit) -> tuple[list[Noise], np.ndarray]:
    """Return what is left of each channel, in the noise that the recording states, and the simulated value of each
    measurement."""
    windows, at = fit.shooting.windows, _stated(fit)
    channels = windows.recording.channels
    found = [Noise(channel.sensor, channel.field, count, square, correlation,
                   channel.sigma_from not in ("neighbours", AT_MOST))
             for channel, (_, correlation, count, square) in zip(channels, residuals_in(fit.shooting, at), strict=True)]
    sigmas = np.array([one.sigma for one in channels])[windows.channel]
    return found, windows.values - at.found.residuals * sigmas


def _by_sensor(noises: Sequence[Noise]) -> dict[str, float]:
    """Return the mean square of all residuals of each sensor."""
    sensors = dict.fromkeys(noise.sensor for noise in noises)
    return {sensor: float(np.average([one.mean_square for one in noises if one.sensor == sensor],
                                     weights=[one.count for one in noises if one.sensor == sensor]))
            for sensor in sensors}


def _by_channel(fit: Fit, numbers: np.ndarray) -> dict[str, np.ndarray]:
    """Return the instants and a number for each measurement, by channel."""
    windows = fit.shooting.windows
    mine = [windows.channel == number for number in range(len(windows.recording.channels))]
    return {f"{channel.sensor}.{channel.field}": np.column_stack([windows.times[one], numbers[one]])
            for channel, one in zip(windows.recording.channels, mine, strict=True)}


def _lack_of(fit: Fit) -> float:
    """Return the mean square of the windows' residuals, in which a lost window counts as much as a bad one; in the
    noise that the recording states, because noise that a fit has found is as large as its residuals."""
    return float(np.minimum(mean_squares(fit.shooting, _stated(fit)), _BAD).mean())


def _alternative(name: str, recording: Recording, fit: Fit, workers: int, say: Callable[[str], None]) -> Alternative:
    """Fit with one effect more, from the values that were found without it; if that ends in no fit, from the scene's,
    because values that a wrong model has bent may lie beyond a blow from the right ones."""
    effect, fits = EFFECTS[name], []
    ranges = {one.name: (one.low, one.high) for one in fit.unknowns.each}
    for plain in (fit.unknowns.scene_of(fit.coordinates), fit.unknowns.scene):
        say(f"with the effect {name}")
        more = {parameter: value(plain) for parameter, value in effect.free.items()}
        scene = plain.with_parameters({**effect.settings, **more})
        fits.append(Fitting(recording, Unknowns.of(scene, (*fit.unknowns.names, *more), ranges), workers, say).fitted())
        if _lack_of(fits[-1]) < GOOD:
            break
    found = min(fits, key=_lack_of)
    # Both by the noise that the better model leaves: the residuals of a wrong model are no noise.
    fit.shooting.windows.recolour(*found.colours)
    at = fit.shooting.point(fit.at.parameters, fit.at.states) or fit.at
    at = fit.shooting.minimise(at, 0.0, TIGHT, 2)
    either = fit.shooting.left_out | found.shooting.left_out
    gain = float((fit.shooting.by_window(at, 0.0, TIGHT)
                  - found.shooting.by_window(found.at, 0.0, TIGHT))[~either].sum())
    fit.shooting.windows.recolour(*fit.colours)
    chance = float(chi2.sf(gain, len(more))) if more else math.exp(-0.5 * max(gain, 0.0))
    return Alternative(name, gain, min(chance, 1.0), found.values, found.unknowns.scene_of(found.coordinates),
                       _lack_of(found))
