"""The fit of a scene to a recording: from short arcs to one motion, with the noise that the recording shows."""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vibro_lab.identification.noise import clipped, refined_sizes, sizes_of, wild
from vibro_lab.identification.nuisances import Nuisances, Start, crank_at
from vibro_lab.identification.recording import AT_MOST, Channel, Recording
from vibro_lab.identification.settings import FitSettings
from vibro_lab.identification.shooting import RESOLVED, Jacobian, Point, Shooting, width_of
from vibro_lab.identification.unknowns import Unknowns
from vibro_lab.identification.windowing import (
    REACHES,
    Stretch,
    arcs,
    chain,
    local_states,
    longer_reach,
    measured,
    measured_spans,
    positions_of,
    roughness,
    unmeasured,
)
from vibro_lab.identification.windows import Colours, Windows, state_names
from vibro_ros import Scene, SimulationError, ToleranceWarning, in_processes, simulate


@dataclass
class Fit:
    """A fit.

    Attributes
    ----------
    unknowns : Unknowns
        The free parameters.
    shooting : Shooting
        The chain of windows.
    point : Point
        The best point; its parameters are the coordinates of `unknowns`, then those of `nuisances`.
    jacobian : Jacobian
        The derivatives there.
    passes : int
        Passes through the recording, of all stages.
    white, colours : Colours
        The noise that was found, and the one by which the residuals are weighed: with correlations of neighbours.
    errors : dict of (str, str) to float
        Errors of the sensors that were found, as `nuisances.Errors`.
    jitters : dict of str to float
        Standard deviation [s] of the stamps of sensors that jitter.
    """

    unknowns: Unknowns
    nuisances: Nuisances
    shooting: Shooting
    point: Point
    jacobian: Jacobian
    passes: int
    white: Colours
    colours: Colours
    errors: dict[tuple[str, str], float]
    jitters: dict[str, float]

    @property
    def coordinates(self) -> np.ndarray:
        """Coordinates of the free parameters."""
        return self.point.parameters[:len(self.unknowns.each)]

    @property
    def values(self) -> dict[str, float]:
        """Values of the free parameters by name."""
        return self.unknowns.values(self.coordinates)

    @property
    def start(self) -> Start:
        """The recording's start."""
        return self.nuisances.start(self.point.parameters[len(self.unknowns.each):])

    @property
    def misfit(self) -> float:
        """Twice the negative logarithm of the likelihood, but for a constant."""
        return self.shooting.misfit(self.point, 0.0, self.shooting.tight)

    @property
    def mean_squares(self) -> np.ndarray:
        """Mean of the squared residuals of each window."""
        return mean_squares(self.shooting, self.point)

    def information(self) -> np.ndarray:
        """Return Fisher's information of all parameters, the states unknown."""
        return self.shooting.equations(self.point, self.jacobian, 0.0, self.shooting.tight).information()


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

    def __init__(self, recording: Recording, unknowns: Unknowns, workers: int, say: Callable[[str], None],
                 offsets: Mapping[str, float] | None = None, camera: Sequence[str] = (),
                 settings: FitSettings | None = None):
        self.settings = settings or FitSettings()
        self._offsets = {sensor: 0.0 for sensor in dict.fromkeys(channel.sensor for channel in recording.channels)}
        self.recording = replace(recording, channels=tuple(
            replace(channel, sigma=min(channel.sigma, self.settings.presumed * width_of(channel.field)))
            if channel.sigma_from == AT_MOST else channel for channel in recording.channels))
        self._retime(offsets or {})
        self.unknowns, self._workers, self._say = unknowns, workers, say
        self._names, self._passes = state_names(unknowns.scene), 0
        self.nuisances = Nuisances(self.recording, unknowns.scene, unknowns.names, self.settings, offsets or {}, camera)
        self._jitters: dict[str, float] = {}
        self.stretches = self._course()

    def fitted(self) -> Fit:
        """Fit from the scene's own parameters: arcs, half turns, then the chain."""
        settings = self.settings
        parameters = np.append(self.unknowns.coordinates(self.unknowns.scene.parameters), self.nuisances.coordinates)
        half_turns: tuple[np.ndarray, np.ndarray] | None = None
        if not self._unseen:
            turned, lasting = np.array([(np.ptp(angle), times[-1] - times[0])
                                        for times, angle, *_ in self.stretches]).sum(axis=0).tolist()
            speed = max(settings.slowest, turned / lasting)
            spacing = max(float(np.median(np.diff(channel.times))) for channel in self._of_state())
            length, fewest = settings.arc * math.tau / speed, settings.samples * spacing
            coarse = length < fewest
            spans = arcs(self.stretches, max(length, fewest), settings.most_windows)
            if len(spans):
                parameters = self._scanned(spans[::max(1, len(spans) // settings.scouted)], parameters)
            if len(spans) and not coarse:
                parameters = self._loosely(spans, parameters, "short arcs", settings.arc_loosenesses)[1].parameters
            turns = max(settings.half, fewest * speed / math.tau)
            spans = chain(self.stretches, turns)
            far_apart = longer_reach(self.recording, self._names) > 1.0
            if not far_apart:
                spans = spans[np.unique(np.linspace(0, len(spans) - 1, settings.most_windows).astype(int))]
            spans, point = self._loosely(spans, parameters, "half turns",
                                      settings.coarse_loosenesses if coarse else settings.half_loosenesses, far_apart)
            parameters = point.parameters
            if far_apart:  # measurements alone do not tell the states of longer windows
                half_turns = spans, point.states
        return self.followed(parameters, half_turns)

    def followed(self, parameters: np.ndarray, half_turns: tuple[np.ndarray, np.ndarray] | None = None) -> Fit:
        """Fit the chain of windows from coordinates of parameters that are near, or less near if masses are unseen.

        `half_turns` has windows, and the states at their starts, where measurements do not tell these.
        """
        settings, count = self.settings, len(self.unknowns.each)
        parameters = self._retimed(parameters)
        shooting = self._shooting(half_turns[0] if half_turns else chain(self.stretches, settings.chain))
        candidates = [*(half_turns[1:] if half_turns else ()), *self._candidates(shooting, parameters)]
        point = self._begun(shooting, parameters, candidates)
        shooting.prior, shooting.is_coarse = self._prior(parameters), half_turns is not None
        if self._unseen:
            point = self._begun_unseen(shooting, point)
        if shooting.is_coarse:  # half turns have fitted these windows at the first looseness
            point = self._with_noise_of_residuals(shooting, point)
        for looseness in settings.chain_loosenesses[1:] if shooting.is_coarse else settings.chain_loosenesses[
                -1:] if self._unseen else settings.chain_loosenesses:
            point = self._tightened(shooting, point, looseness, looseness)
            point = self._with_noise_of_residuals(shooting, point)
        shooting.prior = self._prior(parameters, np.zeros(count))
        point = point if shooting.is_coarse else self._repaired(shooting, point, 0.0)
        jumped = shooting.left_out & self._unseen  # such a window holds up the last, tight steps
        for later in reversed(range(settings.rounds_of_noise)):
            numbers = np.bincount(shooting.windows.window, ~shooting.windows.is_wild)
            most = np.maximum(settings.lost, 1.0 + settings.settled * np.sqrt(2.0 / np.maximum(numbers, 1)))
            shooting.left_out = (mean_squares(shooting, point) > most) | jumped
            if shooting.left_out.mean() > settings.most_lost:  # then it is the model that does not fit
                shooting.left_out[:] = False
            white, colours = shooting.windows.colours, self._recoloured(shooting, point)
            point = shooting.point(point.parameters, point.states) or point
            self._say("all windows as one motion")
            is_last = not (shooting.is_coarse and later) or not white.differs_from(self.recording)
            point = shooting.minimise(point, 0.0, shooting.tight, settings.steps,
                                      settings.enough if is_last else settings.enough_of_chain)
            if not white.differs_from(self.recording):
                break
            point = self._with_noise_of_residuals(shooting, point)  # of a motion that is nearer
        else:
            white, colours = shooting.windows.colours, self._recoloured(shooting, point)
            unstated = [channel.sigma_from in ("neighbours", AT_MOST) and self._jitters.get(channel.sensor, 0.0) > 0.0
                        for channel in self.recording.channels]
            white = white._replace(sigmas=np.where(unstated, colours.sigmas, white.sigmas))
            point = shooting.point(point.parameters, point.states) or point
        errors = self.nuisances.errors(point.parameters[count:])
        for sensor, offset in self._offsets.items():
            errors[sensor, "offset"] = errors.get((sensor, "offset"), 0.0) + offset
        jacobian = shooting.jacobian(point)
        if shooting.is_coarse:
            shooting.left_out |= shooting.jumps(point, jacobian)
        return Fit(self.unknowns, self.nuisances, shooting, point, jacobian, self._passes + shooting.passes, white,
                   colours, errors, self._jitters)

    def _of_state(self) -> list[Channel]:
        """Return the channels that tell positions of the body and the masses, the least noisy of each."""
        known = measured(self.recording)
        return [known[name] for name in self._names if name in known and name == positions_of(name)[0]] or [
            *self.recording.channels]

    def _retime(self, offsets: Mapping[str, float]) -> None:
        """Take so much [s] more off the stamps of sensors."""
        self.recording = replace(self.recording, channels=tuple(
            replace(channel, times=channel.times - offsets.get(channel.sensor, 0.0))
            for channel in self.recording.channels))
        for sensor, offset in offsets.items():
            self._offsets[sensor] = self._offsets.get(sensor, 0.0) + offset

    def _retimed(self, parameters: np.ndarray) -> np.ndarray:
        """Take large offsets off the stamps, and return the coordinates without them."""
        parameters, count, offsets = parameters.copy(), len(self.unknowns.each), dict[str, float]()
        for number, nuisance in enumerate(self.nuisances.each, count):
            offset = parameters[number] * nuisance.unit
            if nuisance.kind == "offset" and abs(offset) > self.settings.retimed:
                offsets[nuisance.owner], parameters[number] = offset, 0.0
        if not offsets:
            return parameters
        self._retime(offsets)
        self.stretches = self._course()
        return parameters

    def _scanned(self, spans: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Return the coordinates with the offset of each sensor that fits short windows best, where it does so clearly:
        a sensor that is late by a third of a turn is not led back by small steps."""
        settings, count = self.settings, len(self.unknowns.each)
        masses = {channel.sensor for channel in self.recording.channels
                  if channel.field.startswith(("upper", "inclined"))}
        clocks = [(nuisance.owner not in masses, number, nuisance)
                  for number, nuisance in enumerate(self.nuisances.each)]
        for _, number, nuisance in sorted(clocks):  # the body moves as the masses do, so theirs is the first clock
            if nuisance.kind != "offset" or all(channel.bandwidth for channel in self.recording.channels
                                                if channel.sensor == nuisance.owner):
                continue
            misfits = {offset: self._misfit_if_late(nuisance.owner, offset, spans, parameters)
                       for offset in np.linspace(-1.0, 1.0, settings.scanned) * settings.latest}
            best = min(misfits, key=misfits.__getitem__)
            if misfits[best] < settings.clearly * min(misfits[offset] for offset in misfits if abs(offset) < 1e-9):
                parameters = parameters.copy()
                parameters[count + number] = best / nuisance.unit
                parameters = self._retimed(parameters)
                self._say(f"the stamps of {nuisance.owner} are late by about {1e3 * best:.0f} ms")
        return parameters

    def _misfit_if_late(self, sensor: str, offset: float, spans: np.ndarray, parameters: np.ndarray) -> float:
        """Return the mean loss of a sensor's measurements in the middle one of windows that start as they tell, if they
        are so late [s]: in some of them an outlier or a blow spoils the start."""
        self._retime({sensor: offset})
        shooting = self._shooting(spans)
        starts = shooting.windows.spans[:, 0]
        course = shooting.windows.course(*self._begin(parameters))
        point = shooting.point(parameters, local_states(self.recording, self._names, starts, REACHES[0], course))
        mine = np.array([channel.sensor == sensor for channel in self.recording.channels])[shooting.windows.channel]
        self._retime({sensor: -offset})
        self._passes += shooting.passes
        if point is None:
            return math.inf
        window, losses = shooting.windows.window[mine], shooting.losses(point, 1.0)[0][mine]
        count = np.bincount(window)
        return float(np.median(np.bincount(window, losses)[count > 0] / count[count > 0]))

    def _begun_unseen(self, shooting: Shooting, point: Point) -> Point:
        """Return the point that fits the chain loosely, of masses that no sensor measures: again and again from the
        motion of the scene that was found, because windows in which a mass has lost its blows find none by themselves.
        """
        settings = self.settings
        point = self._scouted(shooting, point)
        for _ in range(settings.rounds):
            shooting.prior = self._prior(point.parameters, np.full(len(self.unknowns.each), settings.unseen_weight))
            for looseness in settings.unseen_loosenesses:
                point = self._tightened(shooting, point, looseness, settings.tied * looseness)
            if float((mean_squares(shooting, point) > settings.lost).mean()) <= settings.few_lost:
                break
            states = self._candidates(shooting, point.parameters)[-1]
            point = shooting.point(point.parameters, states) or point
        return point

    def _scouted(self, shooting: Shooting, point: Point) -> Point:
        """Return the best of many points whose scene moves from its own start: with parameters drawn around the best so
        far, less and less far. A mass that strikes once a turn instead of twice is not led to the other motion by small
        steps."""
        settings = self.settings
        unknowns, count, random = self.unknowns, len(self.unknowns.each), np.random.default_rng(0)
        spread = np.array([settings.far_off if unknown.unit else settings.far_off_in_shares
                           for unknown in unknowns.each])
        low, high = np.array([ends for _, *ends in unknowns.limits(count)]).T
        shooting.windows.blur(settings.blur)

        def scored(parameters: np.ndarray) -> tuple[float, Point | None]:
            try:
                course = shooting.windows.course(*self._begin(parameters))
            except (SimulationError, ValueError):
                return math.inf, None
            trial = shooting.point(parameters, course)
            return math.inf if trial is None else shooting.windows.square_of_imu(trial.simulated), trial

        best, passes = scored(point.parameters)[0], shooting.passes
        for share in settings.scouts:
            draws = []
            for normal in random.standard_normal((settings.drawn, count)):
                coordinates_of_each = unknowns.directions @ point.parameters[:count] + share * spread * normal
                draws.append(np.append(np.linalg.solve(unknowns.directions, np.clip(coordinates_of_each, low, high)),
                                       point.parameters[count:]))
            for _, future in in_processes(scored, draws, self._workers):
                square, trial = future.result()
                if square < settings.better * best:  # else the recording does not tell, and rounding would choose
                    best, point = square, trial
        shooting.passes = passes + settings.drawn * len(settings.scouts)  # whoever has made them
        return point

    def _tightened(self, shooting: Shooting, point: Point, looseness: float, width: float) -> Point:
        """Return the point with all windows, at a looseness of the measurements and one of the defects."""
        settings = self.settings
        self._say(f"{len(point.states)} windows of {settings.chain:g} turns, looseness {looseness:g}")
        shooting.left_out[:] = False
        is_blurred = self._unseen and looseness >= settings.least_blurred
        shooting.windows.blur(settings.blur * looseness if is_blurred else 0.0)
        point = shooting.point(point.parameters, point.states) or point
        point = self._repaired(shooting, point, looseness)
        return shooting.minimise(point, looseness, width, settings.steps, settings.enough_of_chain)

    def _with_noise_of_residuals(self, shooting: Shooting, point: Point) -> Point:
        """Return the point weighed by the noise that its residuals show: its size, where neighbouring values told only
        a bound or where what the recording states is clearly another; the jitter of stamps; and outliers."""
        windows = shooting.windows
        windows.recolour()
        plain = shooting.point(point.parameters, point.states) or point
        noises = residuals_in(shooting, plain)
        self.recording = windows.recording = replace(self.recording, channels=tuple(
            replace(channel, sigma=noise.sigma) if channel.sigma_from == AT_MOST else channel
            for channel, noise in zip(self.recording.channels, noises, strict=True)))
        windows.recolour()
        plain = shooting.point(point.parameters, point.states) or point
        windows.recolour(self._colours(shooting, plain))
        trial = shooting.point(point.parameters, point.states) or point
        if windows.colours.jitters.any():  # what is small beside the jitter may be large beside the same message's rest
            more = self._wild(shooting, trial.simulated.residuals, np.ones(len(trial.simulated.residuals)))
            if (more & ~windows.is_wild).any():
                windows.recolour(windows.colours._replace(is_wild=windows.is_wild | more))
                trial = shooting.point(point.parameters, point.states) or point
        return trial

    def _wild(self, shooting: Shooting, residuals: np.ndarray, expected: np.ndarray) -> np.ndarray:
        """Return which measurements are outliers, the whole message if one number is; never one of an IMU, whose blows
        are peaks."""
        windows, settings = shooting.windows, self.settings
        of_imu = np.array([channel.bandwidth > 0.0 for channel in windows.recording.channels])[windows.channel]
        is_wild = ~of_imu & wild(windows.channel, residuals, expected, settings.wild, settings.most_wild)
        return windows.of_message(is_wild)

    def _colours(self, shooting: Shooting, plain: Point) -> Colours:
        """Return the noise that the residuals of a point show, which are those of white noise as stated."""
        windows, settings = shooting.windows, self.settings
        channels, residuals = windows.recording.channels, plain.simulated.residuals
        sizes, jitters, bent = np.ones(len(channels)), np.zeros(len(residuals)), np.zeros(len(residuals))
        if self._is_as_stated(shooting, plain):
            return windows.colours
        follows = np.append(False, (windows.channel[1:] == windows.channel[:-1]) & (
            windows.window[1:] == windows.window[:-1])) & ~shooting.left_out[windows.window]
        rates, bends, means = self._of_jitter(shooting, plain)
        expected, shifts = np.ones(len(residuals)), np.zeros(len(residuals))
        for sensor in dict.fromkeys(channel.sensor for channel in channels):
            of = [number for number, channel in enumerate(channels)
                  if channel.sensor == sensor and not channel.bandwidth]
            mine = np.isin(windows.channel, of)
            if not mine.any():
                continue
            squares = [float(np.mean(residuals[windows.channel == number]**2)) for number in of]
            if max(squares) < 1.0 + settings.settled * math.sqrt(6.0 / mine.sum()) and min(squares) > 0.5:
                self._jitters[sensor] = 0.0
                continue  # as stated; steps of an encoder at a constant speed are no white noise
            is_exact = np.array([channels[number].resolution > 0.0 for number in of])
            sensor_sizes, jitter = sizes_of(np.searchsorted(of, windows.channel[mine]), follows[mine], residuals[mine],
                                            np.hypot(rates, bends)[mine], is_exact)
            among = np.zeros(len(channels))
            among[of] = sensor_sizes
            scaled = residuals[mine] / np.hypot(among[windows.channel[mine]], jitter * np.hypot(rates, bends)[mine])
            counts = np.bincount(windows.window[mine], minlength=len(plain.states))
            is_lost = np.bincount(windows.window[mine], np.minimum(scaled**2, settings.wild**2),
                                  len(plain.states)) > settings.unexplained * counts
            if is_lost[(counts > 0) & ~shooting.left_out].mean() > settings.most_lost:  # then it is the model
                sensor_sizes, jitter = np.ones(len(of)), 0.0
            if jitter:
                kept = mine & ~(shooting.left_out | is_lost)[windows.window] & (
                    np.abs(residuals) < settings.wild * np.hypot(1.0, jitter * np.hypot(rates, bends)))
                sensor_sizes, share = refined_sizes(
                    np.searchsorted(of, windows.channel[kept]), windows.messages(kept),
                    (residuals + jitter**2 * means)[kept], jitter * rates[kept], jitter * bends[kept], sensor_sizes,
                    is_exact)
                jitter *= share
            self._jitters[sensor] = jitter
            jitters[mine], bent[mine] = jitter * rates[mine], jitter * bends[mine]
            shifts[mine] = jitter**2 * means[mine]
            for number, size in zip(of, sensor_sizes.tolist(), strict=True):
                rows = (windows.channel == number) & ~shooting.left_out[windows.window]
                sizes[number] = size
                expected[windows.channel == number] = max(size, 1e-3)
        expected = np.sqrt(expected**2 + jitters**2 + bent**2)
        is_wild = self._wild(shooting, residuals + shifts, expected)
        for number, channel in enumerate(channels):
            rows = (windows.channel == number) & ~shooting.left_out[windows.window] & ~is_wild
            if channel.sigma_from in ("neighbours", AT_MOST):
                sizes[number] = max(sizes[number], RESOLVED * width_of(channel.field) / channel.sigma)
                continue
            excess = settings.settled * math.sqrt(3.0 / max(rows.sum(), 1))
            square = float(np.mean(residuals[rows]**2)) if rows.any() else 1.0
            if not jitters[rows].any() and sizes[number] < 1.0:  # neighbours that go together look too quiet
                sizes[number] = math.sqrt(max(sizes[number]**2, min(square, 1.0)))
            if abs(sizes[number]**2 - 1.0) < excess:
                sizes[number] = 1.0
        sigmas = np.array([channel.sigma for channel in channels])
        return Colours(sizes * sigmas, np.zeros(len(sigmas)), jitters * sigmas[windows.channel],
                       bent * sigmas[windows.channel], shifts * sigmas[windows.channel], is_wild)

    def _is_as_stated(self, shooting: Shooting, plain: Point) -> bool:
        """Return whether the residuals of all channels are as large as the recording states, without an outlier."""
        windows, settings = shooting.windows, self.settings
        for number, noise in enumerate(residuals_in(shooting, plain)):
            excess = settings.settled * math.sqrt(6.0 / max(noise.number, 1))
            largest = np.abs(plain.simulated.residuals[windows.channel == number]).max(initial=0.0)
            if not (abs(noise.mean_square - 1.0) < excess and largest < settings.wild):
                return False
        return True

    def _of_jitter(self, shooting: Shooting, point: Point) -> np.ndarray:
        """Return what the jitter of a stamp makes of each residual: by how much it grows with the lateness [1/s], what
        it deviates from that, in parts of the jitter [1/s], and by how much it is larger on the average, shape (3, n).

        The mean over normal stamps is a sum over five instants (Gauss and Hermite), so that a blow nearby counts; the
        average is why a jitter that is taken for noise alone makes a damper 0.1 % stronger.
        """
        windows, jitter = shooting.windows, max(self._jitters.values(), default=0.0) or self.settings.jitter
        delays, weights = np.polynomial.hermite_e.hermegauss(5)
        weights, changes = weights / weights.sum(), []
        for delay in (jitter * delays).tolist():
            windows.delay = delay
            trial = shooting.point(point.parameters, point.states) if delay else point
            changes.append((trial or point).simulated.residuals - point.simulated.residuals)
        windows.delay = 0.0
        mean, rates = weights @ changes, (weights * delays) @ changes / jitter
        rest = weights @ np.square(changes) - mean**2 - (jitter * rates)**2
        return np.array([rates, np.sqrt(np.maximum(rest, 0.0)) / jitter, mean / jitter**2])

    def _repaired(self, shooting: Shooting, point: Point, looseness: float) -> Point:
        candidates = self._candidates(shooting, point.parameters)
        for _ in range(self.settings.repairs):  # each may mend the window after one that was mended
            point, earlier_point = shooting.repaired(point, looseness, candidates), point
            if point is earlier_point:
                break
            candidates = []
        return point

    def _drawn(self, shooting: Shooting, point: Point, looseness: float) -> np.ndarray:
        """Return states of which each part of the robot has, in each window, what fits its own measurements best: of
        what those around the window's start tell, and of draws."""
        settings, windows, random = self.settings, shooting.windows, np.random.default_rng(0)
        near = [local_states(self.recording, self._names, windows.spans[:, 0], reach, point.states)
                for reach in REACHES]
        spread = settings.drawn_widths * shooting.widths
        draws = [point.states + spread * random.standard_normal(point.states.shape) for _ in range(settings.draws)]
        part_of = np.array([name.partition("_")[0] for name in self._names])
        seen = np.array([channel.field.partition("_")[0] for channel in windows.recording.channels])[windows.channel]
        best, states = dict[str, np.ndarray](), point.states.copy()
        for tried in (point.states, *near, *draws):
            if (trial := shooting.point(point.parameters, tried)) is None:
                continue
            losses = shooting.losses(trial, looseness)[0]
            for part in np.unique(part_of):
                loss = np.bincount(windows.window, np.where(seen == part, losses, 0.0), len(states))
                better = loss < 0.9 * best.get(part, np.full(len(states), np.inf))
                best[part] = np.where(better, loss, best.get(part, loss))
                rows = np.ix_(better, part_of == part)
                states[rows] = tried[rows]
        return states

    def _loosely(self, spans: np.ndarray, parameters: np.ndarray, what: str, loosenesses: tuple[float, ...],
                 far_apart: bool = False) -> tuple[np.ndarray, Point]:
        """Return the windows that have measurements, and the point that fits them loosely, from states that samples
        tell, or that are tried where these are `far_apart`."""
        shooting, settings = self._shooting(spans), self.settings
        shooting.prior = self._prior(parameters)
        candidates = self._candidates(shooting, parameters)
        point = self._begun(shooting, parameters, candidates)
        for looseness in loosenesses:
            self._say(f"{len(spans)} {what}, looseness {looseness:g}")
            point = shooting.repaired(point, looseness, candidates)
            if far_apart and looseness == loosenesses[0]:
                point = shooting.repaired(point, looseness, [self._drawn(shooting, point, looseness)])
            point = shooting.minimise(point, looseness, looseness, settings.steps, settings.enough_of_parts)
        self._passes += shooting.passes
        return shooting.windows.spans, point

    def _shooting(self, spans: np.ndarray) -> Shooting:
        times = np.unique(np.concatenate([channel.times for channel in self.recording.channels]))
        inside = np.diff(np.searchsorted(times, spans), axis=1)[:, 0] > 0  # no window is without a measurement
        windows, count = Windows(self.recording, self._names, spans[inside]), len(self.unknowns.each)

        def simulated(parameters: np.ndarray, states: np.ndarray):
            try:
                scene, start = self._begin(parameters)
            except ValueError:  # a combination that no robot has
                return None
            return windows.simulate(scene, start, states, self.nuisances.errors(parameters[count:]))

        shooting = Shooting(windows, simulated, self._workers)
        shooting.limits = [*self.unknowns.limits(count + len(self.nuisances.each)), *self.nuisances.limits(count)]
        return shooting

    def _begin(self, parameters: np.ndarray) -> tuple[Scene, Start]:
        """Return the scene and the start of coordinates (ValueError: if there is no such robot)."""
        count = len(self.unknowns.each)
        start = self.nuisances.start(parameters[count:])
        return self.unknowns.scene_of(parameters[:count], start.settings), start

    def _begun(self, shooting: Shooting, parameters: np.ndarray, candidates: list[np.ndarray]) -> Point:
        for states in candidates:
            if (point := shooting.point(parameters, states)) is not None:
                return point
        raise ValueError(f"{self.unknowns.scene.name}: its robot cannot move as the recording begins; begin with "
                         "other values of the free parameters (--set), or give ranges")

    def _candidates(self, shooting: Shooting, parameters: np.ndarray) -> list[np.ndarray]:
        """Return states at the windows' starts by the measurements around them, then those of the scene's own motion
        from its start."""
        starts = shooting.windows.spans[:, 0]
        course = shooting.windows.course(*self._begin(parameters))
        near = [local_states(self.recording, self._names, starts, reach, course) for reach in REACHES]
        if all(np.array_equal(states, course) for states in near):
            return [course]
        first = near[0].copy()
        first[0] = course[0]
        return [*near, first]

    def _course(self) -> list[Stretch]:
        """Return the stretches of the recording that have measurements."""
        known, channels = measured(self.recording), {}
        for name in self._names:
            position, speed = positions_of(name)
            if name == speed and name != "motor_speed":
                channels[speed] = known.get(speed) or known.get(position)
        spans, crank = measured_spans(self.recording), known.get("crank_angle")

        def lasting(time: float) -> float:
            """Return how long was measured until `time`."""
            return float((np.clip(time, *spans.T) - spans[:, 0]).sum())

        rate = min((len(channel.times) / max(lasting(channel.times[-1]), self.settings.first)
                    for channel in channels.values() if channel), default=self.settings.rate)
        parts = [begin + np.arange(0.0, end - begin, 1.0 / rate) for begin, end in spans.tolist()]
        scene = self.unknowns.scene.with_parameters(self.nuisances.start(self.nuisances.coordinates).settings)
        with warnings.catch_warnings(action="ignore", category=ToleranceWarning):
            run = simulate(scene, times=np.concatenate(parts), commands=self.recording.commands)
        stretches, first = list[Stretch](), 0
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
            rests = self.nuisances.rests if not stretches else crank_at(
                self.recording, times[0], float(run.motor_speed[part.start]), self.settings)[1] == 0.0
            stretches.append(Stretch(times, angle, roughness(times, speeds), rests))
        return stretches

    @property
    def _unseen(self) -> bool:
        return bool(unmeasured(self.recording, self._names))

    def _prior(self, parameters: np.ndarray, weights: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return a prior around coordinates, with `weights` of the unknowns, by default those of the first stages; that
        of a sensor's errors is around 0."""
        if weights is None:
            weights = np.array([self.settings.stiff_weight if name.endswith("plate.stiffness") else self.settings.weight
                                for name in self.unknowns.names])
        expected, nuisance_weights = parameters.copy(), self.nuisances.weights
        expected[len(weights):] = np.where(nuisance_weights > 0.0, 0.0, parameters[len(weights):])
        return expected, np.concatenate([weights, nuisance_weights])

    def _recoloured(self, shooting: Shooting, point: Point) -> Colours:
        """Take correlations and standard deviations of the noise from the residuals, where they differ clearly.

        Noise that the recording states is never taken as less, nor a negative correlation, as an encoder's steps have
        at a constant speed: intervals become wider by what is found here, and not narrower.
        """
        colours, sigmas, correlations = shooting.windows.colours, [], []
        for sigma, correlation, number, mean_square in residuals_in(shooting, point):
            excess = self.settings.settled * math.sqrt(2.0 / max(number, 1))
            sigmas.append(sigma * math.sqrt(mean_square) if mean_square > 1.0 + excess else sigma)
            clear = self.settings.settled / math.sqrt(max(number, 1))
            correlations.append(correlation if correlation > clear else 0.0)
        colours = colours._replace(sigmas=np.array(sigmas), correlations=np.array(correlations))
        shooting.windows.recolour(colours)
        return colours


def mean_squares(shooting: Shooting, point: Point) -> np.ndarray:
    """Return the mean of the squared residuals of each window; 0 for a window without measurements."""
    windows, count = shooting.windows, len(point.states)
    squares = np.bincount(windows.window, point.simulated.residuals**2, count)
    return squares / np.maximum(np.bincount(windows.window, ~windows.is_wild, count), 1)


class Residual(NamedTuple):
    """Noise of a channel after the fit: standard deviation of the noise in the channel's unit, correlation of
    neighbouring residuals, their number, and their mean square in standard deviations."""

    sigma: float
    correlation: float
    number: int
    mean_square: float


def residuals_in(shooting: Shooting, point: Point) -> list[Residual]:
    """Return the noise of each channel at a point that was computed with white noise as the recording states it.

    Noise that was estimated from neighbouring values, with the motion in them, is estimated again from neighbouring
    residuals. These do not show a model that fits badly, because its residuals change slowly; the mean square does.
    """
    windows, noises = shooting.windows, []
    for number, channel in enumerate(windows.recording.channels):
        mine = (windows.channel == number) & ~shooting.left_out[windows.window] & ~windows.is_wild
        sigma = float(windows.colours.sigmas[number])
        residuals, window = point.simulated.residuals[mine], windows.window[mine]
        together = window[1:] == window[:-1]
        square = float(residuals @ residuals)
        correlation = float((residuals[1:] * residuals[:-1])[together].sum()) / square if square else 0.0
        scale = 1.0
        if channel.sigma_from in ("neighbours", AT_MOST) and together.any():
            scale = max(clipped(np.abs(np.diff(residuals)[together]) / math.sqrt(2.0)),
                        RESOLVED * width_of(channel.field) / sigma)  # less than this, no fit resolves
        noises.append(Residual(scale * sigma, min(max(correlation, -0.99), 0.99), len(residuals),
                               square / max(len(residuals), 1) / scale**2))
    return noises
