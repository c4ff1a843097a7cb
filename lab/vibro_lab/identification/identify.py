"""`identify`: which robot made a recording, how sure that is, and whether another effect explains it better."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from vibro_lab.identification.fit import Fit, Fitting, mean_squares, residuals_in
from vibro_lab.identification.inference import (
    HALF_WIDTH,
    REJECTED,
    Noise,
    covariance_of,
    intervals,
    p_value,
    rank_in_words,
    suspicion,
    whiteness,
)
from vibro_lab.identification.nuisances import CAMERA
from vibro_lab.identification.recording import AT_MOST, IMU, LATEST, Recording, read_recording
from vibro_lab.identification.settings import FitSettings
from vibro_lab.identification.shooting import Point
from vibro_lab.identification.unknowns import Unknowns
from vibro_lab.identification.windows import Colours
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
    "drag": Effect({}, {"ground.drag": lambda scene: scene["ground.drag"]}),
    "viscous": Effect({}, {"ground.viscous_friction": lambda scene: scene["ground.viscous_friction"]}),
    "reaction": Effect({"effects.reaction": True}, {}),
    "lag": Effect({"effects.motor": "lag"}, {"motor.time_constant": lambda scene: scene["motor.time_constant"]}),
}
"""Effects that can be tried in addition, by name."""
_LITTLE = {"stribeck": ("ground.static_friction", 1e-4), "slope": ("ground.slope", 1e-5), "drag": ("ground.drag", 1e-4),
           "viscous": ("ground.viscous_friction", 1e-4)}  # of effects that begin at nothing: parameter, and a little


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
    noises : tuple of Noise
        What is left of each channel, and how it was judged.
    sensors : dict of str to (float, float, float)
        Errors of the sensors that were found, such as ``odom.offset`` [s], by how much its stamps are late: value and
        95 % interval by the covariance.
    outliers : dict of str to ndarray, shape (n, 2)
        Instants [s] and values of the measurements that were taken as outliers, by channel.
    suspicion : str
        What would explain that the model does not fit; empty if it does.
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
    noises: tuple[Noise, ...]
    sensors: dict[str, tuple[float, float, float]]
    outliers: dict[str, np.ndarray]
    suspicion: str
    passes: int
    said: tuple[str, ...]
    recording: Recording
    residuals: dict[str, np.ndarray]
    simulated: dict[str, np.ndarray]
    profiles: dict[str, np.ndarray]

    @property
    def verdict(self) -> str:
        """Whether the model fits, in a sentence."""
        better = [alternative for alternative in self.alternatives if alternative.p_value < REJECTED]
        if explaining := [alternative for alternative in better if alternative.mean_square < GOOD]:
            best = explaining[0]
            return (f"the effect {best.effect} fits better, p = {best.p_value:.1g}: the recording is of another robot "
                    f"than the scene can be; go on from the scene with {best.effect}")
        if better:
            return (f"the model does not fit, p = {self.p_value:.1g}, and no effect that was tried explains the "
                    f"recording: with {better[0].effect} the mean square is {better[0].mean_square:.3g}; begin nearer, "
                    "or try others")
        if self.p_value < REJECTED:
            return (f"the model does not fit, p = {self.p_value:.1g}: values and intervals are of the nearest robot "
                    f"that the scene can be, not of the one recorded. {self._evidence}; {self.suspicion}")
        if (lost := float((~self.windows["used"]).mean())) > DOUBTFUL:
            return (f"the model fits the windows that count, p = {self.p_value:.2g}, but {100.0 * lost:.0f} % of them "
                    "are left out, and what they would say is not known: measure masses and body, or begin nearer")
        return f"the model fits, p = {self.p_value:.2g}"

    @property
    def _evidence(self) -> str:
        """Which residuals speak against the model, in a sentence without its end."""
        worst = min(self.noises, key=lambda noise: (noise.p_value, -noise.excess))
        size = math.sqrt(worst.mean_square)
        return (f"The residuals of {worst.sensor}.{worst.field} are {size:.3g} times the noise, and neighbours go "
                f"together by {worst.correlation:.2f}")

    def of_sensors(self) -> list[str]:
        """Return lines on clocks, cameras and noise that differ from what the recording states."""
        lines = []
        for name, (value, low, high) in self.sensors.items():
            sensor, _, kind = name.partition(".")
            half = 0.5 * (high - low)
            lines.append({
                "offset": f"{sensor}: stamps are late by {1e3 * value:.4f} ms ± {1e3 * half:.2g} ms",
                "drift": f"{sensor}: its clock is fast by {1e6 * value:.1f} ppm ± {1e6 * half:.2g} ppm",
                "scale": f"{sensor}: its metre is {1.0 + value:.6f} m ± {half:.2g} m",
                "tilt": f"{sensor}: its axis is tilted by {value:.5f} rad ± {half:.2g} rad"}.get(
                    kind, f"{sensor}: {kind} is off by {value:.4g} m/s² ± {half:.2g} m/s²"))
        lines += [f"{sensor}: stamps jitter by {1e3 * jitter:.3g} ms" for sensor, jitter in dict.fromkeys(
            (noise.sensor, noise.jitter) for noise in self.noises if noise.jitter)]
        lines += [f"{noise.sensor}: {noise.field}: states a noise of {noise.stated:.3g}, its residuals are "
                  f"{noise.size * noise.stated:.3g}" for noise in self.noises if noise.known and noise.size != 1.0]
        return lines + [f"{noise.sensor}: {noise.field}: {noise.outliers} of {noise.count + noise.outliers} "
                        "measurements are outliers, and left out" for noise in self.noises if noise.outliers]

    def words(self) -> list[str]:
        """Return the result in lines: values with intervals, what the recording does not tell, and the verdict."""
        labels = [f"{name} [{unit}]" if (unit := PARAMETERS[name].unit) else name for name in self.values]
        width = max(map(len, labels))
        lines = list(self.said)
        lines += [f"{label:{width}} = {value:.6g}   95 %: {low:.6g} to {high:.6g}   scene: {self.given[name]:.6g}"
                  for label, (name, value), (low, high) in zip(labels, self.values.items(), self.intervals.values(),
                                                               strict=True)]
        lines += [*self.of_sensors(), *self.rank]
        lines += [f"{sensor}: mean square of the residuals {square:.3f}" for sensor, square in self.chi_square.items()]
        if lost := int((~self.windows["used"]).sum()):
            lines.append(f"{lost} of {len(self.windows)} windows are left out: their motion jumps with its start")
        lines += [f"with {alternative.effect}: better by {alternative.gain:.1f}, p = {alternative.p_value:.1g}"
                  for alternative in self.alternatives]
        return [*lines, self.verdict]


def identify(bag: str | Path, scene: Scene, free: Sequence[str],
             ranges: Mapping[str, tuple[float, float]] | None = None, noise: Mapping[str, float] | None = None,
             effects: Sequence[str] = (), workers: int | None = None, offsets: Mapping[str, float] | None = None,
             camera: Sequence[str] = (), settings: FitSettings | None = None,
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
    offsets : mapping of str to float
        By how much the stamps of a sensor are late [s], where that is known; else it is found, up to 20 ms either way.
    camera : sequence of str
        What else is found of each camera, `odom` and `tracking`: `scale` and `tilt`.
    settings : FitSettings
        Settings of the fit.
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
    >>> result = vibro_lab.identify("laboratory_bag", scene, free=["ground.friction"])
    >>> low, high = result.intervals["ground.friction"]
    >>> f"{result.values['ground.friction']:.3f}, 95 %: {low:.3f} to {high:.3f}"
    '0.200, 95 %: 0.200 to 0.200'
    >>> result.verdict
    'the model fits, p = ...'
    """
    check_scene(scene)
    unknowns, wanted = Unknowns.of(scene, free, dict(ranges or {})), _checked(effects, scene, free)
    recording = _usable(read_recording(bag, scene, noise))
    workers = core_count() if workers is None else workers
    _check_sensors(recording, offsets or {}, camera)

    def fitted(unknowns: Unknowns) -> Fit:
        return Fitting(recording, unknowns, workers, say, offsets, camera, settings).fitted()

    fit = fitted(unknowns)
    alternatives = [_alternative(name, fit, fitted, say) for name in wanted]
    (noises, _), covariance = _judged(fit), covariance_of(fit)
    recording = fit.shooting.windows.recording
    said = (*recording.said, *(
        f"{channel.sensor}: {channel.field}: noise {channel.sigma:.3g} by the residuals of the fit"
        for channel in recording.channels if channel.sigma_from == AT_MOST))
    slopes = unknowns.slopes(fit.coordinates)
    free_covariance = covariance[:len(unknowns.each), :len(unknowns.each)]
    windows = fit.shooting.windows
    table = np.array([(*span, square, not left_out) for span, square, left_out in zip(
        windows.spans, fit.mean_squares, fit.shooting.left_out, strict=True)], dtype=WINDOW)
    found_intervals, profiles = intervals(fit, say)
    chance = p_value(noises)
    return Identification(
        values=fit.values, intervals=found_intervals, covariance=slopes @ free_covariance @ slopes.T,
        rank=rank_in_words(fit), chi_square=_by_sensor(noises), p_value=chance, noises=tuple(noises),
        sensors=_sensors(fit, covariance),
        outliers={name: rows for name, rows in _by_channel(fit, windows.values, windows.is_wild).items() if len(rows)},
        suspicion=suspicion(fit, _trials(fit)) if chance < REJECTED else "",
        autocorrelation={f"{channel_noise.sensor}.{channel_noise.field}": channel_noise.correlation
                         for channel_noise in noises},
        alternatives=tuple(sorted(alternatives, key=lambda alternative: (alternative.p_value, -alternative.gain))),
        scene=unknowns.scene_of(fit.coordinates), given=unknowns.scene, windows=table, passes=fit.passes, said=said,
        recording=recording, residuals=_by_channel(fit, fit.point.simulated.residuals),
        simulated=_by_channel(fit, _simulated(fit)), profiles=profiles)


def _checked(effects: Sequence[str], scene: Scene, free: Sequence[str]) -> tuple[str, ...]:
    for name in effects:
        if name not in EFFECTS:
            raise ValueError(f"effects: {quoted(name)} is none that can be tried; give any of {', '.join(EFFECTS)}")
        settings, more = EFFECTS[name].settings, EFFECTS[name].free
        if set(more) & set(free) or (settings and all(scene[key] == value for key, value in settings.items())):
            raise ValueError(f"effects: {name} is a part of this fit already; leave it out")
    return tuple(effects)


def _check_sensors(recording: Recording, offsets: Mapping[str, float], camera: Sequence[str]) -> None:
    """Raise a ValueError for an offset of a sensor that the recording lacks, or for a camera's error that is none."""
    sensors = sorted({channel.sensor for channel in recording.channels})
    for name, offset in offsets.items():
        if name not in sensors or not (isinstance(offset, int | float) and abs(offset) < LATEST):
            raise ValueError(f"offset of {name}: {quoted(offset)}; give one of {', '.join(sensors)}, and a number of "
                             f"seconds below {LATEST:g}")
    if wrong := [name for name in camera if name not in CAMERA]:
        raise ValueError(f"camera: {quoted(wrong[0])} is none of its errors; give any of {', '.join(CAMERA)}")


def _usable(recording: Recording) -> Recording:
    """Return the recording (BagError: it has measurements of an IMU alone)."""
    if all(channel.sensor == IMU for channel in recording.channels):
        raise BagError("the bag: has measurements of an IMU alone, which tell no place and no angle of the crank; "
                       "record tracking, odom, encoder or joint_states with it")
    return recording


def _weighed(fit: Fit, colours: Colours) -> Point:
    """Return the best point with its residuals weighed by other noise."""
    fit.shooting.windows.recolour(colours)
    point = fit.shooting.point(fit.point.parameters, fit.point.states) or fit.point
    fit.shooting.windows.recolour(fit.colours)
    return point


def _stated(fit: Fit) -> Colours:
    """Return white noise of the size that the recording states, without jitter; outliers do not count."""
    channels = fit.shooting.windows.recording.channels
    nothing = np.zeros(len(channels))
    of_each = np.zeros_like(fit.white.jitters)
    return Colours(np.array([channel.sigma for channel in channels]), nothing, of_each, of_each, of_each,
                   fit.white.is_wild)


def _judged(fit: Fit) -> tuple[list[Noise], Colours]:
    """Return what is left of each channel, and the noise by which it is judged: the one that was found, if that is
    white, else the one that the recording states."""
    windows, shooting, stated = fit.shooting.windows, fit.shooting, _stated(fit)
    counts = ~shooting.left_out[windows.window] & ~windows.is_wild
    left = _weighed(fit, fit.white).simulated.residuals
    sigmas, parts, chances = stated.sigmas.copy(), [np.zeros_like(part) for part in fit.white[2:5]], []
    for number, channel in enumerate(windows.recording.channels):
        mine = windows.channel == number
        found_other = fit.white.sigmas[number] != channel.sigma or fit.white.jitters[mine].any()
        is_guess = channel.sigma_from == "neighbours" and not fit.white.jitters[mine].any()
        chance = whiteness(left[mine & counts]) if found_other and not is_guess else 1.0
        chances.append(chance)
        if chance >= REJECTED:
            sigmas[number] = fit.white.sigmas[number]
            for part, white_part in zip(parts, fit.white[2:5], strict=True):
                part[mine] = white_part[mine]
    jitters = parts[0]
    judged = Colours(sigmas, stated.correlations, parts[0], parts[1], parts[2], fit.white.is_wild)
    point = _weighed(fit, judged)
    windows.recolour(judged)
    residuals = residuals_in(shooting, point)
    windows.recolour(fit.colours)
    return [Noise(channel.sensor, channel.field, count, square, correlation,
                  channel.sigma_from not in ("neighbours", AT_MOST), channel.sigma, sigma / channel.sigma,
                  fit.jitters.get(channel.sensor, 0.0) if jitters[windows.channel == number].any() else 0.0,
                  int(windows.is_wild[windows.channel == number].sum()), chance)
            for number, (channel, sigma, chance, (_, correlation, count, square)) in enumerate(zip(
                windows.recording.channels, sigmas, chances, residuals, strict=True))], judged


def _simulated(fit: Fit) -> np.ndarray:
    """Return the simulated value of each measurement."""
    windows = fit.shooting.windows
    plain = _stated(fit)._replace(is_wild=np.zeros_like(fit.white.is_wild))
    residuals = _weighed(fit, plain).simulated.residuals
    return windows.values - residuals * plain.sigmas[windows.channel]


def _by_sensor(noises: Sequence[Noise]) -> dict[str, float]:
    """Return the mean square of all residuals of each sensor."""
    sensors = dict.fromkeys(noise.sensor for noise in noises)
    return {sensor: float(np.average([noise.mean_square for noise in noises if noise.sensor == sensor],
                                     weights=[noise.count for noise in noises if noise.sensor == sensor]))
            for sensor in sensors}


def _sensors(fit: Fit, covariance: np.ndarray) -> dict[str, tuple[float, float, float]]:
    """Return the errors of the sensors that were found, each with its interval."""
    count = len(fit.unknowns.each)
    return {f"{nuisance.owner}.{nuisance.kind}": (
                value := fit.errors[nuisance.owner, nuisance.kind], value - reach, value + reach)
            for number, nuisance in enumerate(fit.nuisances.each, count)
            if (nuisance.owner, nuisance.kind) in fit.errors
            for reach in (HALF_WIDTH * nuisance.unit * math.sqrt(float(covariance[number, number])),)}


def _trials(fit: Fit) -> dict[str, Callable[[], tuple[Scene, float]]]:
    """Return for each effect that the fit lacks a scene with a little of it, and how much."""
    scene = fit.unknowns.scene_of(fit.coordinates, fit.start.settings)
    trials = dict[str, Callable[[], tuple[Scene, float]]]()
    for name, (parameter, little) in _LITTLE.items():
        settings = EFFECTS[name].settings
        is_part = parameter in fit.unknowns.names or (settings and all(scene[key] == value for key, value in
                                                                       settings.items()))
        if not is_part and scene["effects.friction"] != "none":
            first = scene["ground.friction"] if name == "stribeck" else scene[parameter]
            trials[name] = partial(_with_a_little, scene, settings, parameter, first, little)
    return trials


def _with_a_little(scene: Scene, settings: Mapping[str, object], parameter: str, first: float,
                   little: float) -> tuple[Scene, float]:
    return scene.with_parameters({**settings, parameter: first + little}), little


def _by_channel(fit: Fit, numbers: np.ndarray, which: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return the instants and a number for each measurement, or for those of them `which` are wanted, by channel."""
    windows = fit.shooting.windows
    wanted = np.ones(len(numbers), bool) if which is None else which
    mine = [wanted & (windows.channel == number) for number in range(len(windows.recording.channels))]
    return {f"{channel.sensor}.{channel.field}": np.column_stack([windows.times[rows], numbers[rows]])
            for channel, rows in zip(windows.recording.channels, mine, strict=True)}


def _lack_of(fit: Fit) -> float:
    """Return the mean square of the windows' residuals, in which a lost window counts as much as a bad one; in the
    noise by which the fit is judged."""
    return float(np.minimum(mean_squares(fit.shooting, _weighed(fit, _judged(fit)[1])), _BAD).mean())


def _alternative(name: str, fit: Fit, fitted: Callable[[Unknowns], Fit],
                 say: Callable[[str], None]) -> Alternative:
    """Fit with one effect more, from the values that were found without it; if that ends in no fit, from the scene's,
    because values that a wrong model has bent may lie beyond a blow from the right ones."""
    effect, fits = EFFECTS[name], []
    ranges = {unknown.name: (unknown.low, unknown.high) for unknown in fit.unknowns.each}
    for plain in (fit.unknowns.scene_of(fit.coordinates), fit.unknowns.scene):
        say(f"with the effect {name}")
        more = {parameter: value(plain) for parameter, value in effect.free.items()}
        scene = plain.with_parameters({**effect.settings, **more})
        fits.append(fitted(Unknowns.of(scene, (*fit.unknowns.names, *more), ranges)))
        if _lack_of(fits[-1]) < GOOD:
            break
    best = min(fits, key=_lack_of)
    # Both by the noise that the better model leaves, measurement by measurement: the residuals of a wrong model are no
    # noise. Only where stamps are taken alike are the measurements of a window the same ones.
    fit.shooting.windows.recolour(best.colours if len(best.colours.jitters) == len(fit.colours.jitters) else
                                  fit.colours)
    point = fit.shooting.point(fit.point.parameters, fit.point.states) or fit.point
    point = fit.shooting.minimise(point, 0.0, fit.shooting.tight, 2)
    either = fit.shooting.left_out | best.shooting.left_out
    gain = float((fit.shooting.by_window(point, 0.0, fit.shooting.tight)
                  - best.shooting.by_window(best.point, 0.0, fit.shooting.tight))[~either].sum())
    fit.shooting.windows.recolour(fit.colours)
    chance = float(chi2.sf(gain, len(more))) if more else math.exp(-0.5 * max(gain, 0.0))
    return Alternative(name, gain, min(chance, 1.0), best.values, best.unknowns.scene_of(best.coordinates),
                       _lack_of(best))
