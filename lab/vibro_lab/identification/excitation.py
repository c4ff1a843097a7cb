"""Which script of commands makes the free parameters tellable, and how well: what to record next.

A recording at a constant speed tells little: the robot shows the same turn again and again. Candidates are scripts of
starts and stops, of speeds, of turns both ways and of moving plates, within the limits of motor and plates. The motion
under each is computed for the scene, and Fisher's information of the free parameters from it: the normal equations of
the fit (`shooting`), whose windows' states are eliminated. The inverse is the covariance that a fit of such a recording
can reach, if the robot is near the scene and the noise is white. As in the fit, a window starts where the one before
ended to 1 µm and 0.1 mm/s, so that the deviations are up to three times those of a perfectly known motion. The script
with the smallest worst standard deviation wins.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import yaml

from vibro_lab.identification.nuisances import Start
from vibro_lab.identification.recording import Channel, Recording
from vibro_lab.identification.shooting import RESOLVED, TIGHT, Jacobian, Point, Shooting
from vibro_lab.identification.unknowns import Unknowns
from vibro_lab.identification.windows import Windows, state_names
from vibro_ros import SAMPLE_FIELDS, Scene, SimulationError, check_scene, core_count, in_processes, simulate

Sensors = Mapping[str, tuple[float, float]]
"""By ``sensor.field``: measurements a second, and the standard deviation of their noise."""
Commands = tuple[tuple[float, dict[str, float]], ...]

_MASSES = {f"joint_states.{side}_{what}": noise for side in ("upper", "inclined")
           for what, noise in (("position", (500.0, 5e-5)), ("velocity", (500.0, 1e-3)))}
LABORATORY: Sensors = {"odom.body_position": (500.0, 5e-5), "odom.body_velocity": (500.0, 1e-3), **_MASSES}
"""A camera that sees body and masses, to 0.05 mm and 1 mm/s."""

WINDOW = 0.25
"""Duration of a window [s]: some turns, over which a chaotic motion does not leave the linear range."""
UNTELLABLE = 1.0
"""Relative standard deviation beyond which a parameter counts as not tellable."""
_SPEEDS: Mapping[str, tuple[float, ...]] = {  # in parts of the usual speed
    "a constant speed": (1.0,),
    "starts and stops": (1.3, 0.0),
    "starts to several speeds": (0.65, 0.0, 1.3, 0.0, 1.0, 0.0),
    "steps of speed": (0.65, 1.1, 1.3, 0.85),
    "slow and fast": (0.4, 1.3)}
_HOLDS = 0.5, 1.0  # s, from one command to the next
_USUAL_SPEED = 100.0  # rad/s, of the paper's robot
_USUAL_VOLTAGE = 0.75  # of the supply's
_STROKE = 1e-3  # m, of a plate that moves
_STEP = 1e-3  # of a parameter's coordinate
_STATE_STEP = 3e-3  # of a state's number, in its width at looseness 1
_BENT = 0.3  # largest part of a change that is not opposite to that by the opposite step
_BEFORE = 1e-4  # information on each coordinate beforehand, with which a parameter without effect has a deviation


@dataclass(frozen=True)
class Excitation:
    """A script of commands, and what a fit of its recording can reach.

    Attributes
    ----------
    name : str
        What the script does.
    commands : tuple of (float, dict)
        As `simulate` takes them.
    duration : float
        Duration of the script [s].
    deviations : dict of str to float
        Expected standard deviation of each free parameter, in its unit.
    relative : dict of str to float
        The same, in parts of the parameter's value, of 1 mm for a length or of 0.1 rad for an angle that may be 0.
    """

    name: str
    commands: Commands
    duration: float
    deviations: dict[str, float]
    relative: dict[str, float]

    @property
    def worst(self) -> tuple[int, float]:
        """Number of parameters that cannot be told, and the largest relative deviation of the others."""
        tellable = [relative for relative in self.relative.values() if relative < UNTELLABLE]
        return len(self.relative) - len(tellable), max(tellable, default=math.inf)

    @property
    def script(self) -> str:
        """The script as YAML, for ``ros2 run vibro_ros controller``."""
        ends = [time for time, _ in self.commands[1:]] + [self.duration]
        entries = [{"for": round(end - time, 6), **given}
                   for (time, given), end in zip(self.commands, ends, strict=True)]
        head = [f"{self.name}, {self.duration:g} s. Expected standard deviations of a fit:", *(
            f"  {name}: " + (f"{self.deviations[name]:.3g} ({100.0 * relative:.2g} %)" if relative < UNTELLABLE else
                             "cannot be told") for name, relative in self.relative.items())]
        return "".join(f"# {line}\n" for line in head) + yaml.safe_dump({"entries": entries}, sort_keys=False)


def excite(scene: Scene, free: Sequence[str], duration: float = 5.0, sensors: Sensors | None = None,
           ranges: Mapping[str, tuple[float, float]] | None = None,
           workers: int | None = None) -> tuple[Excitation, ...]:
    """Return scripts of commands by which free parameters can be told, the best first, among them a constant speed.

    Parameters
    ----------
    scene : Scene
        The robot as far as it is known; the sizes hold near it.
    free : sequence of str
        Names of the parameters, as `identify` takes them.
    duration : float
        Duration of each script [s].
    sensors : mapping of str to (float, float), optional
        What will be measured; by default the scene's tracking system, or else `LABORATORY`, of the parts that the scene
        has. Fields of `Samples` only: the information of an IMU is not counted.
    ranges : mapping of str to (float, float), optional
        As for `identify`.
    workers : int, optional
        Number of processes, by default the number of cores. A script takes some seconds, of a dc motor with a sampled
        controller ten times as long.

    Raises
    ------
    ValueError
        For an unknown parameter or field, or a duration that is too short; or if no candidate can be simulated.

    Examples
    --------
    >>> best, *others = excite(vibro_ros.load_scene("device"), ("ground.friction", "upper.spring.stiffness"))
    >>> print(best.script)
    """
    check_scene(scene)
    if not 4.0 * WINDOW <= duration <= 600.0:
        raise ValueError(f"duration: {duration:g} s is out of range; give {4.0 * WINDOW:g} to 600 s")
    unknowns = Unknowns.of(scene, tuple(free), ranges or {})
    if sensors is None and scene["sensors.tracking.rate"] and scene["sensors.tracking.noise"]:
        sensors = {"tracking.body_position": (scene["sensors.tracking.rate"], scene["sensors.tracking.noise"])}
    chosen = sensors or {name: given for name, given in LABORATORY.items()
                         if name.split(".")[1].split("_")[0] in ("body", *scene.guides)}
    if wrong := [name for name in chosen if name.partition(".")[2] not in SAMPLE_FIELDS]:
        raise ValueError(f"sensors: {wrong[0]} measures no field of a sample; give sensor.field, such as "
                         "tracking.body_position")
    told = in_processes(partial(_excited, unknowns, duration, chosen), candidates(scene, free, duration),
                        workers or core_count())
    excitations = [excitation for _, future in told if (excitation := future.result())]
    if not excitations:
        raise ValueError(f"scene {scene.name}: no script of {duration:g} s can be simulated to its end")
    return tuple(sorted(excitations, key=lambda excitation: excitation.worst))


def sensors_of(recording: Recording) -> Sensors:
    """Return rates and noise of a recording's channels, without those of an IMU."""
    return {f"{channel.sensor}.{channel.field}": ((len(channel.times) - 1) / (channel.times[-1] - channel.times[0]),
                                                  channel.sigma)
            for channel in recording.channels if channel.field in SAMPLE_FIELDS}


def candidates(scene: Scene, free: Sequence[str], duration: float) -> Iterator[tuple[str, Commands]]:
    """Yield names and commands of the candidate scripts; plates move in some of them if anything of a plate is free."""
    motor = scene.motor_command
    if motor == "motor_voltage":
        most = scene["motor.supply_voltage"]
        usual = _USUAL_VOLTAGE * most
    else:
        most = scene["motor.max_speed"]
        usual = abs(scene["motor.speed"]) or _USUAL_SPEED
    plates = [f"{side}_gap" for side in scene.plates] if any("gap" in name or "plate" in name for name in free) else []
    seen = []  # in a short script two holds may be the same
    for name, shares in _SPEEDS.items():
        for hold, moving in [(hold, []) for hold in _HOLDS[:len(shares)]] + [(_HOLDS[0], plates)] * bool(plates):
            count = max(len(shares), round(duration / hold))
            commands: list[tuple[float, dict[str, float]]] = []
            for k in range(count):
                given = {motor: round(min(usual * shares[k % len(shares)], most), 3)}
                given |= {gap: scene[gap.replace("_", ".")] + (_STROKE, 0.0, -_STROKE, 0.0)[k % 4] for gap in moving}
                if not commands or given != commands[-1][1]:
                    commands.append((round(duration * k / count, 3), given))
            if commands in seen:
                continue
            seen.append(commands)
            held = f", {duration / count:.2g} s each" if len(commands) > 1 else ""
            yield name + held + (", with moving plates" if moving else ""), tuple(commands)


def _excited(unknowns: Unknowns, duration: float, sensors: Sensors, script: tuple[str, Commands]) -> Excitation | None:
    """Return the excitation by a script; None if its motion cannot be simulated."""
    name, commands = script
    count = math.floor(duration / WINDOW)
    edges = duration * np.arange(count + 1) / count
    channels = []
    for channel, (rate, sigma) in sensors.items():
        sensor, _, field = channel.partition(".")
        times = np.arange(math.ceil(duration * rate)) / rate
        channels.append(Channel(sensor, field, times, np.zeros(len(times)), sigma, "given"))
    states = state_names(unknowns.scene)
    windows = Windows(Recording(0.0, duration, tuple(channels), commands, ()), states,
                      np.column_stack([edges[:-1], edges[1:]]))
    shooting = Shooting(windows, lambda coordinates, starts: windows.simulate(
        unknowns.scene_of(coordinates), Start({}, {}), starts))
    try:
        run = simulate(unknowns.scene, times=edges[:-1], commands=commands)
    except (SimulationError, ValueError):
        return None
    values = {parameter: unknowns.scene[parameter] for parameter in unknowns.names}
    coordinates = unknowns.coordinates(values)
    point = shooting.point(coordinates, np.column_stack([getattr(run, state) for state in states]))
    if point is None:
        return None
    jacobian = _secants(shooting, point)
    information = shooting.equations(point, jacobian, 0.0, TIGHT).information()
    covariance = np.linalg.inv(information + _BEFORE * np.eye(len(coordinates)))
    slopes = unknowns.slopes(coordinates)
    deviations = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    units = [max(abs(values[unknown.name]), unknown.unit) for unknown in unknowns.each]
    return Excitation(name, commands, duration, dict(zip(unknowns.names, deviations.tolist(), strict=True)),
                      dict(zip(unknowns.names, (deviations / units).tolist(), strict=True)))


def _secants(shooting: Shooting, point: Point) -> Jacobian:
    """Return derivatives by differences about as large as what is to be told, without measurements that are not linear.

    In a chaotic motion, and where a small change brings a blow more, an infinitesimal difference would promise
    information that no fit can use. There the change by a step forwards is not the opposite of that by a step
    backwards. Such measurements are left out, and a window that ends so is not joined to the next.
    """
    windows, parameters = shooting.windows, len(point.parameters)
    linear, joined = np.ones(len(windows.channel), dtype=bool), np.ones(len(windows.spans), dtype=bool)
    residuals, ends = [], []
    for row in np.diag(np.concatenate([np.full(parameters, _STEP), _STATE_STEP * shooting.widths])):
        forward, backward = (
            shooting.point(point.parameters + sign * row[:parameters], point.states + sign * row[parameters:])
            for sign in (1.0, -1.0))
        up, down = (forward.simulated, backward.simulated) if forward and backward else (
            point.simulated, point.simulated)  # a limit: nothing is told
        change, end = up.residuals - down.residuals, up.ends - down.ends
        linear &= (np.abs(up.residuals + down.residuals - 2.0 * point.simulated.residuals)
                   <= _BENT * np.abs(change) + 0.5)
        joined &= (np.abs(up.ends + down.ends - 2.0 * point.simulated.ends)
                   <= _BENT * np.abs(end) + RESOLVED * shooting.widths).all(axis=1)
        residuals.append(change / (2.0 * row.sum()))
        ends.append(end / (2.0 * row.sum()))
    windows.joined = windows.joined & joined[:-1]
    by_all, ends_by_all = np.stack(residuals, axis=1) * linear[:, None], np.stack(ends, axis=2)
    return Jacobian(by_all[:, :parameters], by_all[:, parameters:], ends_by_all[:, :, :parameters],
                    ends_by_all[:, :, parameters:])
