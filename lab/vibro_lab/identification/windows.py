"""Windows of a recording: one pass of a `Simulator` through all of them, and how it differs from the measurements.

Each window starts from a state of its own. So wrong parameters spoil the motion only until the window's end, and not
for the rest of the recording, where a mass that missed one blow would never strike in time again. Motor and plates are
not part of a window's state: they follow from the commands alone, in one course from the recording's start. Only a dc
motor feels its load, and its angle and speed are part of the state.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from vibro_lab.identification.recording import Recording
from vibro_ros import ACCELERATIONS, IMU_FORGETTING, SAMPLE_FIELDS, Scene, SimulationError, Simulator, force_at_rest

_QUANTITIES = (*SAMPLE_FIELDS, *ACCELERATIONS)


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
    """

    def __init__(self, recording: Recording, names: tuple[str, ...], spans: np.ndarray):
        self.recording, self.names, self.spans = recording, names, spans
        self.joined = spans[1:, 0] == spans[:-1, 1]
        channels = recording.channels
        self._bandwidth = max((one.bandwidth for one in channels), default=0.0)
        self._blur = 0.0
        times = np.unique(np.concatenate([channel.times for channel in channels]))
        self._times = times[self._window_of(times) >= 0]
        self._first, self._end = np.searchsorted(self._times, spans.T)
        parts = []
        for number, channel in enumerate(channels):
            window = self._window_of(channel.times)
            used = window >= 0
            if channel.bandwidth:  # a window's start is a step of the speed for the low-pass
                used &= channel.times >= spans[window, 0] + IMU_FORGETTING / channel.bandwidth
            parts.append((np.full(used.sum(), number), window[used],
                          np.searchsorted(self._times, channel.times[used]), channel.values[used]))
        of, window, rows, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.lexsort((of, window))  # stable: the measurements of a channel stay in their order
        self.channel, self.window, self._rows, self.values = (part[order] for part in (of, window, rows, values))
        self.times = self._times[self._rows]
        self._fields = np.array([_QUANTITIES.index(one.field) for one in channels])[self.channel]
        self._limits = np.array([one.limit for one in channels])[self.channel]
        self.values = np.clip(self.values, -self._limits, self._limits)
        self._of_imu = np.array([one.bandwidth > 0.0 for one in channels])[self.channel]
        self.slices = [slice(*np.searchsorted(self.window, (k, k + 1))) for k in range(len(spans))]
        self._states = [SAMPLE_FIELDS.index(name) for name in names]
        self.recolour(np.array([one.sigma for one in channels]), np.zeros(len(channels)))

    def recolour(self, sigmas: np.ndarray, correlations: np.ndarray) -> None:
        """Take noise of these standard deviations and of these correlations of neighbours, by channel; the noise of a
        sample is then ``correlation * the one before + white noise``, an AR(1) process."""
        self.sigmas = sigmas[self.channel]
        follows = np.zeros(len(self.channel), bool)  # whether the measurement before is of the same channel and window
        follows[1:] = (self.channel[1:] == self.channel[:-1]) & (self.window[1:] == self.window[:-1])
        self._correlation = np.where(follows, correlations[self.channel], 0.0)
        self._whitening = 1.0 / np.sqrt(1.0 - self._correlation**2)

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

    def simulate(self, scene: Scene, start: Mapping[str, float], states: np.ndarray,
                 biases: Mapping[str, float] | None = None) -> Pass | None:
        """Simulate all windows in one pass; None if a state is impossible or the motion cannot go on.

        Parameters
        ----------
        scene : Scene
            The scene with the parameters that are tried.
        start : mapping of str to float
            What the commands do not tell of the motor at time 0: arguments of `Simulator.set_state`.
        states : ndarray, shape (windows, states)
            State at the start of each window.
        biases : mapping of str to float
            Constant errors [m/s²] of an IMU by field.
        """
        predicted, ends = np.empty((len(_QUANTITIES), len(self._times))), np.empty_like(states)
        try:
            device = Simulator(scene, self._bandwidth)
            _put(device, start)
            commands = Commands(self.recording, device)
            for k, (begin, end) in enumerate(self.spans.tolist()):
                commands.advance_to(begin, with_those_at_it=True)
                _put(device, _possible(device, dict(zip(self.names, states[k].tolist(), strict=True))))
                done = self._first[k]
                while (instant := commands.next_instant) < end:
                    upto = int(np.searchsorted(self._times, instant))
                    self._sample(device, predicted, done, upto)
                    done = upto
                    commands.advance_to(instant, with_those_at_it=True)
                self._sample(device, predicted, done, self._end[k])
                device.advance_to(end)
                ends[k] = device.values[self._states]
        except (SimulationError, ValueError):
            return None
        for field, at_rest in zip(ACCELERATIONS, force_at_rest(scene), strict=True):
            predicted[_QUANTITIES.index(field)] += at_rest + (biases or {}).get(field, 0.0)
        simulated = np.clip(predicted[self._fields, self._rows], -self._limits, self._limits)
        residuals = self._blurred((self.values - simulated) / self.sigmas)
        before = np.concatenate([[0.0], residuals[:-1]])
        return Pass((residuals - self._correlation * before) * self._whitening, ends)

    def course(self, scene: Scene, start: Mapping[str, float]) -> np.ndarray:
        """Return the states at the windows' starts, shape (windows, states), in one motion from the scene's start."""
        states, device = np.empty((len(self.spans), len(self._states))), Simulator(scene)
        _put(device, start)
        commands = Commands(self.recording, device)
        for k, begin in enumerate(self.spans[:, 0].tolist()):
            commands.advance_to(begin)
            states[k] = device.values[self._states]
        return states

    def square_of_imu(self, found: Pass) -> float:
        """Return the sum of the squared residuals of an IMU, or of all channels if there is none."""
        own = found.residuals[self._of_imu] if self._bandwidth else found.residuals
        return float(own @ own)

    def _blurred(self, residuals: np.ndarray) -> np.ndarray:
        for part in self.slices if self._blur else ():
            for channel in np.unique(self.channel[part][self._of_imu[part]]):
                mine = part.start + np.flatnonzero(self.channel[part] == channel)
                step = float(np.ptp(self.times[mine])) / max(len(mine) - 1, 1)
                residuals[mine] = gaussian_filter1d(residuals[mine], self._blur / max(step, 1e-6), mode="constant")
        return residuals

    def _sample(self, device: Simulator, predicted: np.ndarray, first: int, end: int) -> None:
        if end > first:
            times, accelerations = self._times[first:end], np.zeros((end - first, len(ACCELERATIONS)))
            if self._bandwidth:
                samples, accelerations = device.sample_filtered(times)
            else:
                samples = device.sample(times)
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
