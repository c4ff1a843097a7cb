"""Coordinates of the fit that are no parameters of the robot: its start, clocks of its sensors, a camera's frame.

The motor's start comes from the encoder, and so does the commanded speed where no command was recorded before the first
measurement. The stamps of a sensor are late by an offset, which may drift. One clock is the common one: that of the
sensor that sees the crank, or that of the commands, if they change the speed within the recording; without either, all
stamps are taken as they are. A camera may be tilted, and its metre another. An IMU has a constant error.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from vibro_lab.identification.recording import IMU, Recording
from vibro_lab.identification.settings import FitSettings
from vibro_lab.identification.windowing import measured
from vibro_ros import Scene

CAMERA = {"scale": (1e-3, 0.02, 0.1), "tilt": (1e-2, 0.1, 0.5)}
"""What may be wrong with a camera: unit of the coordinate, standard deviation expected, and limit."""
CAMERAS = "odom", "tracking"
_FIRST = 5  # samples of an encoder that tell a speed beside the jitter of their stamps, if they are far apart
_STEADY = 0.02  # share of a speed by which it changes where the motor is still on its way to it
START, SETTING = "start", "setting"
Errors = Mapping[tuple[str, str], float]
"""By sensor and kind: `offset` [s], `drift`, `scale`, `tilt` [rad]; of an IMU by field [m/s²]."""


class Nuisance(NamedTuple):
    """One such coordinate: whose it is (a sensor, `START` or `SETTING`), what it is, the value of coordinate 1, the
    standard deviation expected of the value (infinity: any), its limit either way, and the value to begin with."""

    owner: str
    kind: str
    unit: float
    deviation: float = math.inf
    limit: float = math.inf
    first: float = 0.0


class Start(NamedTuple):
    """A start: what is put into the device, arguments of `Simulator.set_state`, and parameters of its scene."""

    state: dict[str, float]
    settings: dict[str, float]


class Nuisances:
    """The coordinates of a fit that are no parameters, in the order of `each`."""

    def __init__(self, recording: Recording, scene: Scene, free: Sequence[str], settings: FitSettings,
                 offsets: Mapping[str, float], camera: Sequence[str]):
        self.rests, start = _start(recording, scene, free, settings)
        names = dict.fromkeys(channel.sensor for channel in recording.channels)
        known, motor = measured(recording), scene.motor_command
        speeds = [given[motor] for _, given in recording.commands if motor in given]
        tells = len(set(speeds)) > 1 or any(
            given.get(motor, scene[motor.replace("_", ".")]) != scene[motor.replace("_", ".")]
            for time, given in recording.commands if time > 0.0)
        reference = known["crank_angle"].sensor if "crank_angle" in known else ""
        kinds = {"offset": (1e-3, settings.latest, settings.latest)}
        if recording.duration >= settings.drift_from:
            kinds["drift"] = 1e-4, settings.drift, 10.0 * settings.drift
        clocks = [Nuisance(sensor, kind, *numbers) for sensor in names for kind, numbers in kinds.items()
                  if not (kind == "offset" and sensor in offsets) and (reference or tells)
                  and (sensor != reference or (tells and not scene.has_rotor))]
        frames = [Nuisance(sensor, kind, *CAMERA[kind]) for sensor in names if sensor in CAMERAS for kind in camera]
        biases = [Nuisance(IMU, channel.field, channel.bias, channel.bias)
                  for channel in recording.channels if channel.bias]
        self.each = (*start, *clocks, *frames, *biases)
        self._units = np.array([nuisance.unit for nuisance in self.each])
        self._rest = {} if scene.has_rotor or scene["effects.motor"] == "ideal" else {"motor_speed": 0.0}

    @property
    def coordinates(self) -> np.ndarray:
        """The coordinates to begin with."""
        return np.array([nuisance.first / nuisance.unit for nuisance in self.each])

    @property
    def weights(self) -> np.ndarray:
        """Weights of the squares of coordinates in the prior."""
        return np.array([(nuisance.unit / nuisance.deviation)**2 for nuisance in self.each])

    def limits(self, before: int) -> list[tuple[np.ndarray, float, float]]:
        """Return limits for `Shooting.limits`, with so many coordinates before these."""
        return [(row, -nuisance.limit / nuisance.unit, nuisance.limit / nuisance.unit)
                for row, nuisance in zip(np.eye(before + len(self.each))[before:], self.each, strict=True)
                if nuisance.limit < math.inf]

    def errors(self, coordinates: np.ndarray) -> dict[tuple[str, str], float]:
        """Return the errors of the sensors."""
        values = (coordinates * self._units).tolist()
        return {(nuisance.owner, nuisance.kind): value for nuisance, value in zip(self.each, values, strict=True)
                if nuisance.owner not in (START, SETTING)}

    def start(self, coordinates: np.ndarray) -> Start:
        """Return the start; a motor that rests stays at rest."""
        start = Start({}, {})
        for nuisance, value in zip(self.each, (coordinates * self._units).tolist(), strict=True):
            if nuisance.owner == SETTING:
                start.settings[nuisance.kind] = value
            elif nuisance.owner == START:
                start.state[nuisance.kind] = value
        if self._rest and "motor_speed" not in start.state:  # it rests, or goes on at the speed commanded
            start.state.update(self._rest if self.rests else {"motor_speed": start.settings["motor.speed"]})
        return start


def _start(recording: Recording, scene: Scene, free: Sequence[str],
           settings: FitSettings) -> tuple[bool, list[Nuisance]]:
    """Return whether the crank rests at time 0, and the coordinates of the start."""
    given = dict(recording.commands[:1]).get(0.0, {}) if recording.commands else {}
    angle, speed = crank_at(recording, 0.0, scene["motor.speed"], settings)
    start = []
    commanded = scene.motor_command in given or "motor.speed" in free or scene.motor_command != "motor_speed"
    later = _settled_speed(recording, "motor_speed", settings)
    if not scene.has_rotor:
        start.append(Nuisance(START, "crank_angle", 0.1, first=angle))
    if not commanded and later is not None:
        start.append(Nuisance(SETTING, "motor.speed", 10.0, limit=scene["motor.max_speed"], first=later))
        changes = abs(speed - later) > _STEADY * abs(speed)
    else:
        changes = True
    if changes and speed and not scene.has_rotor and scene["effects.motor"] != "ideal":
        start.append(Nuisance(START, "motor_speed", 10.0, first=speed))
    plates = measured(recording)
    for side in scene.plates:
        channel = plates.get(f"{side}_plate_position")
        if channel is not None and f"{side}_gap" not in given and f"{side}.gap" not in free:
            until = _until(recording, f"{side}_gap")
            values = channel.values[channel.times < until]
            if len(values):
                gap = float(np.median(values[len(values) // 2:])) - scene[f"crank.{side}_rod"]
                start.append(Nuisance(SETTING, f"{side}.gap", 1e-3, first=gap))
                first = float(np.median(values[:max(1, len(values) // 50)]))
                if abs(first - values[-1]) > 5.0 * channel.sigma:
                    start.append(Nuisance(START, f"{side}_plate_position", 1e-3, first=first))
    return speed == 0.0, start


def _until(recording: Recording, command: str) -> float:
    """Return the instant [s] of the first such command after the start; infinity if there is none."""
    return min((time for time, given in recording.commands if command in given and time > 0.0), default=math.inf)


def _settled_speed(recording: Recording, command: str, settings: FitSettings) -> float | None:
    """Return the crank's speed [rad/s] in the second half of the time before the first command; None if unmeasured."""
    crank = measured(recording).get("crank_angle")
    if crank is None:
        return None
    times = crank.times[crank.times < _until(recording, command)]
    if len(times) < 3:
        return None
    half = slice(len(times) // 2 - 1, len(times))
    return float(np.polyfit(times[half] - times[half][0], crank.values[:len(times)][half], 1)[0])


def crank_at(recording: Recording, begin: float, speed: float, settings: FitSettings) -> tuple[float, float]:
    """Return angle and speed of the crank at `begin` [s], as far as the recording tells them from there on, speed 0
    if it rests; `speed` is what counts otherwise."""
    crank = measured(recording).get("crank_angle")
    if crank is None or not (from_then := crank.times >= begin).any():
        return 0.0, speed
    times, values = crank.times[from_then], crank.values[from_then]
    first, angle = times <= times[min(_FIRST, len(times)) - 1], float(values[0])
    first |= times <= times[0] + settings.first
    if first.sum() > 2:  # a parabola, because the motor may gain speed from the first instant on
        parabola, covariance = np.polyfit(times[first] - begin, values[first], 2,
                                          w=np.full(first.sum(), 1.0 / crank.sigma), cov="unscaled")
        speed, angle = parabola[1:].tolist()
        left = (values[first] - np.polyval(parabola, times[first] - begin)) / crank.sigma
        excess = float(left @ left) / max(first.sum() - 3, 1)  # stamps that jitter make more noise of a fast crank
        if abs(speed) < settings.settled * math.sqrt(covariance[1, 1] * max(excess, 1.0)):
            speed = 0.0
    return angle, speed
