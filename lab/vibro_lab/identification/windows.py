"""Windows of a recording: one pass of a `Simulator` through all of them, and how it differs from the measurements.

Each window starts from a state of its own. So wrong parameters spoil the motion only until the window's end, and not
for the rest of the recording, where a mass that missed one blow would never strike in time again. Motor and plates are
not part of a window's state: they follow from the commands alone, in one course from the recording's start. Only a dc
motor feels its load, and its angle and speed are part of the state.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from vibro_lab.identification.nuisances import Errors, Start
from vibro_lab.identification.recording import AT_MOST, IMU, Recording
from vibro_lab.identification.windowing import positions_of
from vibro_ros import (
    ACCELERATIONS,
    IMU_FORGETTING,
    SAMPLE_FIELDS,
    Scene,
    SimulationError,
    Simulator,
    ToleranceWarning,
    force_at_rest,
)

_QUANTITIES = (*SAMPLE_FIELDS, *ACCELERATIONS)
#: Of each quantity the one that is its rate, and of the body's the one along the other axis; -1 for none.
_RATES = np.array([_QUANTITIES.index(positions_of(name)[1]) if name.endswith(("_position", "_height", "_angle")) and
                   positions_of(name)[1] in _QUANTITIES else -1 for name in _QUANTITIES])
_ACROSS = {"body_position": "body_height", "body_velocity": "body_vertical_velocity"}
_ACROSS |= {up: along for along, up in _ACROSS.items()}


def state_names(scene: Scene) -> tuple[str, ...]:
    """Return the names of the numbers of a window's state, which are arguments of `Simulator.set_state`."""
    parts = [("body_position", "body_velocity")] * scene.body_moves
    parts += [("body_height", "body_vertical_velocity")] * scene.body_hops
    parts += [(f"{side}_position", f"{side}_velocity") for side in ("upper", "inclined")
              if scene[f"effects.{side}_mass"]]
    parts += [("crank_angle", "motor_speed")] * scene.has_rotor
    return tuple(name for part in parts for name in part)


@dataclass(frozen=True)
class Pass:
    """Result of a pass.

    Attributes
    ----------
    residuals : ndarray, shape (measurements,)
        Measured less simulated values in standard deviations, made white. The measurements of a window are neighbours,
        and within it those of a channel.
    ends : ndarray, shape (windows, states)
        State at the end of each window.
    """

    residuals: np.ndarray
    ends: np.ndarray


class Colours(NamedTuple):
    """Noise by which residuals are weighed: by channel its standard deviation and the correlation of neighbours, shape
    (channels,); by measurement what the jitter of its stamp adds [in the channel's unit], with the sign of its rate,
    what it adds beside that near a blow and by how much it makes the value smaller on the average, and whether it is an
    outlier, shape (measurements,)."""

    sigmas: np.ndarray
    correlations: np.ndarray
    jitters: np.ndarray
    bends: np.ndarray
    shifts: np.ndarray
    is_wild: np.ndarray

    def differs_from(self, recording: Recording) -> bool:
        """Return whether the noise is another than the recording states, or was found without it."""
        stated = all(sigma == channel.sigma and channel.sigma_from != AT_MOST
                     for sigma, channel in zip(self.sigmas.tolist(), recording.channels, strict=True))
        return not stated or bool(self.jitters.any() or self.is_wild.any())


class Windows:
    """Windows of a recording.

    Parameters
    ----------
    recording : Recording
        The recording.
    names : tuple of str
        Names of the numbers of a window's state.
    spans : ndarray, shape (windows, 2)
        Start and end of each window [s], ascending, without overlap. Where one ends at the start of the next, the two
        are joined.

    Attributes
    ----------
    joined : ndarray of bool, shape (windows - 1,)
        Whether a window and the next are joined.
    channel, window : ndarray of int, shape (measurements,)
        Channel and window of each measurement.
    times, values : ndarray, shape (measurements,)
        Instant [s] and measured value of each.
    slices : list of slice
        The measurements of each window.
    is_wild : ndarray of bool, shape (measurements,)
        Outliers, whose residual is 0.
    delay : float
        Lateness [s] of all stamps in addition.
    """

    def __init__(self, recording: Recording, names: tuple[str, ...], spans: np.ndarray):
        self.recording, self.names, self.spans = recording, names, spans
        self.joined = spans[1:, 0] == spans[:-1, 1]
        channels = recording.channels
        self._bandwidth = max((channel.bandwidth for channel in channels), default=0.0)
        self._blur, self.delay = 0.0, 0.0
        parts = []
        for number, channel in enumerate(channels):
            window = self._window_of(channel.times)
            used = window >= 0
            if channel.bandwidth:  # a window's start is a step of the speed for the low-pass
                used &= channel.times >= spans[window, 0] + IMU_FORGETTING / channel.bandwidth
            parts.append((np.full(used.sum(), number), window[used], channel.times[used], channel.values[used]))
        of, window, times, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.lexsort((of, window))  # stable: the measurements of a channel stay in their order
        self.channel, self.window, self.times, self.values = (part[order] for part in (of, window, times, values))
        sensors = [channel.sensor for channel in channels]
        self._sensors = list(dict.fromkeys(sensors))
        self._sensor = np.array([self._sensors.index(sensor) for sensor in sensors])[self.channel]
        self._message = np.unique(np.stack([self._sensor, self.times]), axis=1, return_inverse=True)[1].ravel()
        self._fields = np.array([_QUANTITIES.index(channel.field) for channel in channels])[self.channel]
        across = [_QUANTITIES.index(_ACROSS.get(channel.field, channel.field)) for channel in channels]
        self._across = np.array(across)[self.channel]
        self._sign = np.array([{"body_position": 1.0, "body_velocity": 1.0, "body_height": -1.0,
                                "body_vertical_velocity": -1.0}.get(channel.field, 0.0)
                               for channel in channels])[self.channel]
        self._limits = np.array([channel.limit for channel in channels])[self.channel]
        self.values = np.clip(self.values, -self._limits, self._limits)
        self._of_imu = np.array([channel.bandwidth > 0.0 for channel in channels])[self.channel]
        self.slices = [slice(*np.searchsorted(self.window, (k, k + 1))) for k in range(len(spans))]
        self._states = [SAMPLE_FIELDS.index(name) for name in names]
        self.recolour()

    def recolour(self, colours: Colours | None = None) -> None:
        """Take noise of these colours, by default white noise of the recording's standard deviations.

        The noise of a sample is ``correlation * the one before + white noise``, an AR(1) process. All numbers of a
        message have the same error of its stamp: their residuals g times it are whitened together, which leaves the
        part of length ``|g|`` along g divided by ``sqrt(1 + |g|²)``. An outlier does not count."""
        sigmas, nothing = np.array([channel.sigma for channel in self.recording.channels]), np.zeros(len(self.channel))
        self.colours = colours or Colours(sigmas, np.zeros(len(sigmas)), nothing, nothing, nothing, nothing > 0.0)
        sigmas, correlations, jitters, bends, self._shifts, self.is_wild = self.colours
        self.sigmas = np.hypot(sigmas[self.channel], bends)
        self._jitters = np.where(self.is_wild, 0.0, jitters / self.sigmas)
        self.spreads = self.sigmas * np.sqrt(1.0 + self._jitters**2)
        square = np.bincount(self._message, self._jitters**2)
        self._along = np.divide(1.0 - 1.0 / np.sqrt(1.0 + square), square, out=np.zeros(len(square)),
                                where=square > 0.0)
        follows = np.zeros(len(self.channel), bool)  # whether the measurement before is of the same channel and window
        follows[1:] = (self.channel[1:] == self.channel[:-1]) & (self.window[1:] == self.window[:-1])
        self._correlation = np.where(follows, correlations[self.channel], 0.0)
        self._whitening = 1.0 / np.sqrt(1.0 - self._correlation**2)

    def of_message(self, are: np.ndarray) -> np.ndarray:
        """Return of each measurement whether any of its message is one of those that `are`, shape (measurements,)."""
        return np.bincount(self._message, are)[self._message] > 0

    def messages(self, which: np.ndarray) -> np.ndarray:
        """Return the numbers of the messages of some measurements, from 0 on."""
        return np.unique(self._message[which], return_inverse=True)[1]

    def blur(self, duration: float) -> None:
        """Blur what an IMU has left unexplained by a normal distribution of this standard deviation [s], 0 for none.

        A blow is a peak of a millisecond. Where it is simulated at another instant, the difference of the two peaks
        does not depend on how far they are apart, unless both are blurred.
        """
        self._blur = duration

    def _window_of(self, times: np.ndarray) -> np.ndarray:
        """Return the number of the window of each instant; -1 for none."""
        window = np.searchsorted(self.spans[:, 0], times, side="right") - 1
        return np.where((window >= 0) & (times < self.spans[window, 1]), window, -1)

    def simulate(self, scene: Scene, start: Start, states: np.ndarray, errors: Errors | None = None) -> Pass | None:
        """Simulate all windows in one pass; None if a state is impossible or the motion cannot go on.

        Parameters
        ----------
        scene : Scene
            The scene with the parameters that are tried.
        start : Start
            What the commands do not tell of time 0; its settings are those of the scene already.
        states : ndarray, shape (windows, states)
            State at the start of each window.
        errors : mapping of (str, str) to float
            Errors of the sensors.
        """
        instants = self.times - self._lateness(errors or {}) - self.delay
        first, last = self.spans[self.window].T
        inside = np.clip(instants, first, np.nextafter(last, -np.inf))
        times, rows = np.unique(inside, return_inverse=True)
        predicted, ends = np.empty((len(_QUANTITIES), len(times))), np.empty_like(states)
        firsts, stops = np.searchsorted(times, self.spans.T)
        try:
            device = _device(scene, self._bandwidth)
            _put(device, start.state)
            commands = Commands(self.recording, device)
            for k, (begin, end) in enumerate(self.spans.tolist()):
                commands.advance_to(begin, with_those_at_it=True)
                _put(device, _possible(device, dict(zip(self.names, states[k].tolist(), strict=True))))
                done = firsts[k]
                while (instant := commands.next_instant) < end:
                    upto = int(np.searchsorted(times, instant))
                    self._sample(device, times, predicted, done, upto)
                    done = upto
                    commands.advance_to(instant, with_those_at_it=True)
                self._sample(device, times, predicted, done, stops[k])
                device.advance_to(end)
                ends[k] = device.values[self._states]
        except (SimulationError, ValueError):
            return None
        residuals = self._blurred((self.values + self._shifts - self._seen(
            scene, predicted, rows, instants - inside, errors or {})) / self.sigmas)
        residuals[self.is_wild] = 0.0
        along = np.bincount(self._message, self._jitters * residuals)
        residuals -= self._jitters * (self._along * along)[self._message]
        preceding = np.concatenate([[0.0], residuals[:-1]])
        return Pass((residuals - self._correlation * preceding) * self._whitening, ends)

    def _lateness(self, errors: Errors) -> np.ndarray:
        """Return how late the stamp of each measurement is [s]."""
        offsets, drifts = (np.array([errors.get((name, kind), 0.0) for name in self._sensors])[self._sensor]
                           for kind in ("offset", "drift"))
        return offsets + drifts * (self.times - 0.5 * self.recording.duration)

    def _seen(self, scene: Scene, predicted: np.ndarray, rows: np.ndarray, beyond: np.ndarray,
              errors: Errors) -> np.ndarray:
        """Return what the sensors make of the predicted quantities, shape (quantities, instants), in the `rows` of each
        measurement; where its instant is `beyond` its window [s], a position goes on at its speed."""
        for field, at_rest in zip(ACCELERATIONS, force_at_rest(scene), strict=True):
            predicted[_QUANTITIES.index(field)] += at_rest + errors.get((IMU, field), 0.0)
        rates = _RATES[self._fields]
        seen = predicted[self._fields, rows] + np.where(rates >= 0, predicted[rates, rows], 0.0) * beyond
        for number, name in enumerate(self._sensors):
            scale, tilt = (errors.get((name, kind), 0.0) for kind in ("scale", "tilt"))
            if scale or tilt:
                mine = self._sensor == number
                across = predicted[self._across[mine], rows[mine]] * self._sign[mine]
                seen[mine] = (1.0 + scale) * (np.cos(tilt) * seen[mine] + np.sin(tilt) * across)
        return np.clip(seen, -self._limits, self._limits)

    def course(self, scene: Scene, start: Start) -> np.ndarray:
        """Return the states at the windows' starts, shape (windows, states), in one motion from the scene's start."""
        states, device = np.empty((len(self.spans), len(self._states))), _device(scene)
        _put(device, start.state)
        commands = Commands(self.recording, device)
        for k, begin in enumerate(self.spans[:, 0].tolist()):
            commands.advance_to(begin)
            states[k] = device.values[self._states]
        return states

    def square_of_imu(self, simulated: Pass) -> float:
        """Return the sum of the squared residuals of an IMU, or of all channels if there is none."""
        residuals = simulated.residuals[self._of_imu] if self._bandwidth else simulated.residuals
        return float(residuals @ residuals)

    def _blurred(self, residuals: np.ndarray) -> np.ndarray:
        for part in self.slices if self._blur else ():
            for channel in np.unique(self.channel[part][self._of_imu[part]]):
                mine = part.start + np.flatnonzero(self.channel[part] == channel)
                step = float(np.ptp(self.times[mine])) / max(len(mine) - 1, 1)
                residuals[mine] = gaussian_filter1d(residuals[mine], self._blur / max(step, 1e-6), mode="constant")
        return residuals

    def _sample(self, device: Simulator, times: np.ndarray, predicted: np.ndarray, first: int, end: int) -> None:
        if end > first:
            accelerations = np.zeros((end - first, len(ACCELERATIONS)))
            if self._bandwidth:
                samples, accelerations = device.sample_filtered(times[first:end])
            else:
                samples = device.sample(times[first:end])
            predicted[:, first:end] = [*(getattr(samples, name) for name in SAMPLE_FIELDS), *accelerations.T]


class Commands:
    """The commands of a recording, given to a device at their instants."""

    def __init__(self, recording: Recording, device: Simulator):
        self._device, self._due, self._next = device, recording.commands, 0

    @property
    def next_instant(self) -> float:
        """Instant [s] of the next command; infinity after the last."""
        return self._due[self._next][0] if self._next < len(self._due) else np.inf

    def advance_to(self, time: float, with_those_at_it: bool = False) -> None:
        """Advance the device, giving each command on the way; those at `time` itself only if they are asked for."""
        while self.next_instant < time or (with_those_at_it and self.next_instant == time):
            instant, command = self._due[self._next]
            self._device.advance_to(instant)
            self._device.command(**command)
            self._next += 1
        self._device.advance_to(time)


def _device(scene: Scene, bandwidth: float = 0.0) -> Simulator:
    """Return a device of the scene, without the warning that its tolerance is below rounding: a fit makes 1000."""
    with warnings.catch_warnings(action="ignore", category=ToleranceWarning):
        return Simulator(scene, bandwidth)


def _put(device: Simulator, state: Mapping[str, float]) -> None:
    """Put the device into a state; one without numbers, which `Simulator.set_state` refuses, changes nothing."""
    if state:
        device.set_state(**state)


def _possible(device: Simulator, state: dict[str, float]) -> dict[str, float]:
    """Return the state with the body not below the ground and no mass too deep in a plate, where noise puts them."""
    if "body_height" in state:
        state["body_height"] = max(state["body_height"], 0.0)
    for side in device.scene.plates:
        plate = float(device.values[SAMPLE_FIELDS.index(f"{side}_plate_position")])
        deepest = plate + device.scene.deepest_penetration(side)
        state[f"{side}_position"] = min(state[f"{side}_position"], deepest)
    return state
