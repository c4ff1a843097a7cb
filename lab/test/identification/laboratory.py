"""Recordings of a robot whose true parameters are known, made by heyoka and not by the device's own solver.

`python lab/test/identification/laboratory.py ROBOT OUT` writes the bag folder OUT, and beside it the scene of the
truth, OUT.truth.yaml, and the scene that a laboratory would begin with, OUT.scene.yaml. The first differs from the
second in the parameters of `UNKNOWN`. The noise of the sensors is drawn here, and so is what is wrong with them, see
`Faults`; an IMU clips, quantises and adds noise as `sensors.noise` says, after a low-pass that is computed here by sums
over the steps of the speed.
"""

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[2]))
from laboratory_messages import imu, joint_states, numbers, odometry, tracking, written  # noqa: E402

import vibro_ros  # noqa: E402
from benchmark.heyoka_robot import COLUMNS, DRIVEN, HeyokaRobot  # noqa: E402
from vibro_ros.model.scene import Scene  # noqa: E402
from vibro_ros.sensors.noise import InertialErrors, of_imu  # noqa: E402

Commands = Sequence[tuple[float, Mapping[str, float]]]
RATE = 500.0  # Hz, of a laboratory's sensors and of an encoder
WILD = 0.02, 2.0  # m, m/s: a marker's reflection is up to so far off
FINE = 100  # samples of the speed for each sample of an IMU; 20 would be wrong by half the noise

UNKNOWN = {
    "ground.friction": 1.0, "upper.spring.stiffness": 1.0, "inclined.spring.stiffness": 1.0,
    "upper.spring.damping": 1.0, "inclined.spring.damping": 1.0, "upper.plate.stiffness": 1.0,
    "inclined.plate.stiffness": 1.0, "upper.plate.damping": 1.0, "inclined.plate.damping": 1.0,
    "mass.body": 0.5, "guide.angle": 0.3}
"""How much each unknown parameter differs from the scene, in parts of `spread`; both gaps differ by `GAP` times it."""
GAP = 0.002  # m

RAMP = {"effects.motor": "ramp", "motor.speed": 0.0, "motor.acceleration": 400.0}
STARTS: Commands = ((0.0, {"motor_speed": 100.0}), (1.0, {"motor_speed": 0.0}), (1.5, {"motor_speed": 70.0}),
                    (2.3, {"motor_speed": 120.0}), (3.2, {"motor_speed": 0.0}), (3.6, {"motor_speed": 90.0}))
MOVING_GAPS: Commands = ((0.0, {"motor_speed": 100.0}), (0.8, {"upper_gap": 0.001}), (1.4, {"motor_speed": 60.0}),
                         (2.0, {"inclined_gap": -0.001, "motor_speed": 110.0}), (2.8, {"upper_gap": -0.0005}),
                         (3.3, {"motor_speed": 40.0}))


class Robot(NamedTuple):
    """Shipped scene, what is changed in it for the truth and the first guess alike, what only the truth has, and the
    commands."""

    scene: str
    known: Mapping[str, object]
    hidden: Mapping[str, object]
    commands: Commands


ROBOTS: Mapping[str, Robot] = {  # a robot's draws depend on its place: add others at the end
    "damped": Robot("damped", {}, {}, ((0.0, {"motor_speed": 100.0}),)),
    "device": Robot("device", {}, {}, MOVING_GAPS),
    "lossless": Robot("unilateral", RAMP, {}, STARTS),
    "moving": Robot("device", {"motor.speed": 60.0, "start.state": "given", "start.body_velocity": -0.2,
                               "start.crank_angle": 1.0, "start.upper_position": 0.06,
                               "start.upper_velocity": -0.5, "start.inclined_position": 0.06,
                               "start.inclined_velocity": 0.3}, {}, MOVING_GAPS),
    "starts": Robot("damped", RAMP, {}, STARTS),
    "stribeck": Robot("device", {"effects.normal_force": "unilateral"},
                      {"effects.friction": "stribeck", "ground.static_friction": 0.3, "ground.stribeck_speed": 0.05},
                      MOVING_GAPS),
    "chaotic": Robot("device", {}, {}, ((0.0, {"motor_speed": 85.0}),)),
    "viscous": Robot("damped", {}, {"ground.viscous_friction": 1.0}, ((0.0, {"motor_speed": 100.0}),)),
    "dragged": Robot("damped", {}, {"ground.drag": 0.5}, ((0.0, {"motor_speed": 100.0}),)),
}
FIELD = {"sensors.preset": "mpu6050", "sensors.imu.rate": 1000.0, "sensors.imu.accelerometer.turn_on_bias": 0.0,
         "sensors.encoder.rate": RATE, "sensors.tracking.rate": 100.0, "sensors.tracking.noise": 1e-3}


@dataclass(frozen=True)
class Faults:
    """What is not ideal in a laboratory: how its sensors differ from the truth, and its recording from a whole one."""

    rate: float = RATE  # measurements of the laboratory's sensors and of the encoder a second [Hz]
    positions_only: bool = False  # a camera of 0.1 mm: `tracking` and positions of the masses, no speeds
    jitter: float = 0.0  # standard deviation of every stamp [s]
    late: Mapping[str, float] = field(default_factory=dict)  # by how much the stamps of a sensor are late [s]
    fast: Mapping[str, float] = field(default_factory=dict)  # by which share the clock of a sensor is fast
    outliers: float = 0.0  # share of a camera's messages with a reflection, or with both masses swapped
    lost: float = 0.0  # share of the messages of every sensor that is not recorded
    stated: float = 1.0  # standard deviation in the covariances in parts of the true one
    begins_in_motion: float = 0.0  # s of motion and commands before the recording
    camera_scale: float = 1.0  # a metre of the camera in metres, of the body
    camera_tilt: float = 0.0  # angle [rad] by which the camera's x axis points above the ground


class Recorded(NamedTuple):
    """A bag, the true scene, and the scene to begin with."""

    bag: Path
    truth: Scene
    scene: Scene


def record(folder: Path, robot: str, sensors: str = "laboratory", seed: int = 0, spread: float = 0.1,
           duration: float = 4.0, covariances: bool = True, faults: Faults | None = None) -> Recorded:
    """Write a bag of `duration` [s] of one of `ROBOTS`.

    The sensors of a `laboratory` measure the body's place and speed (0.05 mm, 1 mm/s) and those of both masses, and the
    crank by an encoder, 500 times a second. Those of the `field` are a tracking system (1 mm, 100 Hz), an IMU of the
    preset mpu6050 (1 kHz) and the encoder. The truth's parameters are drawn with `seed` up to `spread` off.
    """
    faults = faults or Faults()
    random = np.random.default_rng([seed, list(ROBOTS).index(robot)])
    chance = np.random.default_rng([seed, list(ROBOTS).index(robot), 49])  # of faults: they change no other draw
    base = vibro_ros.load_scene(ROBOTS[robot].scene)
    begin, commands = faults.begins_in_motion, ROBOTS[robot].commands
    known = {"motor.speed": 100.0} if ROBOTS[robot].scene == "damped" and not ROBOTS[robot].known else dict(
        ROBOTS[robot].known)
    scene = base.with_parameters(known | (FIELD | {"sensors.seed": float(seed)} if sensors == "field" else {}))
    drawn = {name: scene[name] * (1.0 + share * spread * random.uniform(-1.0, 1.0)) for name, share in UNKNOWN.items()}
    drawn |= {f"{side}.gap": scene[f"{side}.gap"] + GAP * spread * random.uniform(-1.0, 1.0)
              for side in ("upper", "inclined")}
    truth = scene.with_parameters(drawn | ROBOTS[robot].hidden)
    heyoka = HeyokaRobot(truth, 1e-18 if truth["effects.friction"] == "stribeck" else 1e-15)

    def motion(rate: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        times = np.arange(round(duration * rate) + 1) / rate
        run = heyoka.integrate(begin + times, commands)
        return times, dict(zip((*COLUMNS, *DRIVEN), (*run.samples.T, *run.driven.T), strict=True))

    def noisy(true: np.ndarray, sigma: float) -> np.ndarray:
        return true + sigma * random.standard_normal(len(true))

    def sent(sensor: str, times: np.ndarray, *columns: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the stamps of the messages that are recorded, and what is in them, shape (n,) or (rows, n) each."""
        stamps = (times * (1.0 + faults.fast.get(sensor, 0.0)) + faults.late.get(sensor, 0.0)
                  + faults.jitter * chance.standard_normal(len(times)))
        kept = np.flatnonzero(chance.random(len(times)) >= faults.lost)
        for column in (stamps, *columns):
            yield column[..., kept]

    def wild(sensor: str, values: np.ndarray, reach: float) -> np.ndarray:
        """Return values, shape (..., n), of which a share is a reflection's, or another marker's."""
        is_wild = np.random.default_rng([seed, 50, *sensor.encode()]).random(values.shape[-1]) < faults.outliers
        if sensor == "joint_states":
            return np.where(is_wild, values[::-1], values)
        return np.where(is_wild, values + reach * chance.uniform(-1.0, 1.0, values.shape), values)

    times, true = motion(faults.rate)
    tick = math.tau / truth["sensors.encoder.ticks"]
    rows = [numbers(name, [(time - begin, given[name]) for time, given in commands
                           if name in given and time >= begin]) for name in ("motor_speed", "upper_gap",
                                                                              "inclined_gap")]
    stamps, angle = sent("encoder", times, tick * np.round(true["crank_angle"] / tick))
    rows.append(joint_states(stamps, {"crank": [angle]}, "encoder"))
    axes = {"body_position": "body_velocity", "body_height": "body_vertical_velocity"}
    axes = axes if truth["effects.normal_force"] == "hop" else {"body_position": "body_velocity"}
    cos, sin = math.cos(faults.camera_tilt), math.sin(faults.camera_tilt)

    def seen(names: Sequence[str]) -> list[np.ndarray]:
        """Return what a camera that is tilted and scaled makes of numbers of the body along x and z."""
        x, z = true[names[0]], true[names[1]] if len(names) > 1 else np.zeros(len(times))
        return [part * faults.camera_scale for part in (cos * x + sin * z, cos * z - sin * x)[:len(names)]]

    if sensors == "laboratory":
        position_noise, stated = 1e-4 if faults.positions_only else 5e-5, faults.stated**2 * covariances
        place, speed = (np.array([noisy(part, sigma) for part in seen(names)]) for names, sigma in (
            ([*axes], position_noise), ([*axes.values()], 1e-3)))
        place, speed = (wild("odom", values, reach) for values, reach in zip((place, speed), WILD, strict=True))
        place, speed = (values if len(axes) > 1 else values[0] for values in (place, speed))
        masses = np.array([[noisy(true[f"{side}_position"], position_noise), noisy(true[f"{side}_velocity"], 1e-3)]
                           for side in ("inclined", "upper")])
        if faults.positions_only:
            masses = masses[:, :1]
            rows.append(tracking(*sent("tracking", times, place), stated * position_noise**2))
        else:
            rows.append(odometry(*sent("odom", times, place, speed), (stated * 5e-5**2, stated * 1e-3**2)))
        stamps, masses = sent("joint_states", times, wild("joint_states", masses, 0.0))
        rows.append(joint_states(stamps, {f"{side}_mass": list(mass) for side, mass in zip(
            ("inclined", "upper"), masses, strict=True)}))
    else:
        sigma, every = truth["sensors.tracking.noise"], round(faults.rate / truth["sensors.tracking.rate"])
        places = np.array([noisy(part[::every], sigma) for part in seen([*axes])])
        places = wild("tracking", places, WILD[0])
        rows.append(tracking(*sent("tracking", times[::every], places if len(axes) > 1 else places[0]),
                             (faults.stated * sigma)**2))
        rate = truth["sensors.imu.rate"]
        fine, true = motion(FINE * rate)
        errors = InertialErrors(truth, "accelerometer")
        along, up = (lowpassed(fine, true[name], of_imu(truth, "bandwidth"))[::FINE]
                     for name in ("body_velocity", "body_vertical_velocity"))
        forces = np.array([errors.read((x, 0.0, z + truth["gravity"]), k)
                           for k, (x, z) in enumerate(zip(along, up, strict=True))])
        rows.append(imu(*sent("imu/data_raw", fine[::FINE], forces[:, 0], forces[:, 2]), errors.variance(0)))
    return Recorded(written(folder, *rows), truth, scene)


def lowpassed(times: np.ndarray, speed: np.ndarray, bandwidth: float) -> np.ndarray:
    """Return the acceleration behind Butterworth's low-pass of second order, by the differences of the speed.

    The filter has the poles r exp(±3 i pi/4), with r = 2 pi bandwidth (`solver.lowpass`); the acceleration counts as
    constant between two `times` [s], which are evenly spaced.
    """
    rate = math.tau * bandwidth
    pole = rate * np.exp(0.75j * np.pi)
    decay = np.exp(pole * (times[1] - times[0]))
    gain = (decay - 1.0) / (pole * (times[1] - times[0]))
    steps = np.diff(speed, prepend=speed[0])
    return math.sqrt(2.0) * rate * lfilter([gain], [1.0, -decay], steps.astype(complex)).imag


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("robot", choices=ROBOTS)
    parser.add_argument("out", type=Path, help="bag folder to write")
    parser.add_argument("--sensors", choices=("laboratory", "field"), default="laboratory")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--spread", type=float, default=0.1, help="how far the truth is from the scene; 0: equal")
    parser.add_argument("--duration", type=float, default=4.0, help="s")
    parser.add_argument("--no-covariances", action="store_true", help="of odometry: the reader must find the noise")
    parser.add_argument("--rate", type=float, default=RATE, help="of the sensors [Hz]")
    parser.add_argument("--positions-only", action="store_true", help="a camera of 0.1 mm that gives no speeds")
    parser.add_argument("--jitter", type=float, default=0.0, help="standard deviation of all stamps [s]")
    for name, what in (("late", "seconds by which the stamps of a sensor are late, such as odom=0.003"),
                       ("fast", "share by which the clock of a sensor is fast, such as odom=0.0001")):
        parser.add_argument(f"--{name}", action="append", default=[], metavar="SENSOR=NUMBER", help=what)
    parser.add_argument("--outliers", type=float, default=0.0, help="share of wild measurements of the cameras")
    parser.add_argument("--lost", type=float, default=0.0, help="share of messages that is not recorded")
    parser.add_argument("--stated", type=float, default=1.0, help="noise in the covariances, in parts of the true one")
    parser.add_argument("--begins-in-motion", type=float, nargs="?", const=0.7, default=0.0, metavar="SECONDS",
                        help="of motion and commands before the recording (0.7)")
    parser.add_argument("--camera-scale", type=float, default=1.0, help="a metre of the camera in metres")
    parser.add_argument("--camera-tilt", type=float, default=0.0, help="angle of the camera above the ground [rad]")
    given = parser.parse_args()
    clocks = {name: {sensor: float(number) for sensor, _, number in (word.partition("=") for word in vars(given)[name])}
              for name in ("late", "fast")}
    faults = Faults(given.rate, given.positions_only, given.jitter, clocks["late"], clocks["fast"], given.outliers,
                    given.lost, given.stated, given.begins_in_motion, given.camera_scale, given.camera_tilt)
    made = record(given.out, given.robot, given.sensors, given.seed, given.spread, given.duration,
                  not given.no_covariances, faults)
    for name, scene in (("truth", made.truth), ("scene", made.scene)):
        text = yaml.safe_dump({"/**": {"ros__parameters": {"scene": "paper", **scene.parameters}}}, sort_keys=False)
        given.out.with_name(f"{given.out.name}.{name}.yaml").write_text(text)
    for name, value in made.truth.parameters.items():
        if made.scene[name] != value:
            print(f"{name}: {value!r} in truth, {made.scene[name]!r} in the scene")


if __name__ == "__main__":
    main()
