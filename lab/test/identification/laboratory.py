"""Recordings of a robot whose true parameters are known, made by heyoka and not by the device's own solver.

`python lab/test/identification/laboratory.py ROBOT OUT` writes the bag folder OUT, and beside it the scene of the
truth, OUT.truth.yaml, and the scene that a laboratory would begin with, OUT.scene.yaml. The first differs from the
second in the parameters of `UNKNOWN`. The noise of the sensors is drawn here; an IMU clips, quantises and adds noise as
`sensors.noise` says, after a low-pass that is computed here by sums over the steps of the speed.
"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
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
}
FIELD = {"sensors.preset": "mpu6050", "sensors.imu.rate": 1000.0, "sensors.imu.accelerometer.turn_on_bias": 0.0,
         "sensors.encoder.rate": RATE, "sensors.tracking.rate": 100.0, "sensors.tracking.noise": 1e-3}


class Recorded(NamedTuple):
    """A bag, the true scene, and the scene to begin with."""

    bag: Path
    truth: Scene
    scene: Scene


def record(folder: Path, robot: str, sensors: str = "laboratory", seed: int = 0, spread: float = 0.1,
           duration: float = 4.0, covariances: bool = True) -> Recorded:
    """Write a bag of `duration` [s] of one of `ROBOTS`.

    The sensors of a `laboratory` measure the body's place and speed (0.05 mm, 1 mm/s) and those of both masses, and the
    crank by an encoder, 500 times a second. Those of the `field` are a tracking system (1 mm, 100 Hz), an IMU of the
    preset mpu6050 (1 kHz) and the encoder. The truth's parameters are drawn with `seed` up to `spread` off.
    """
    random = np.random.default_rng([seed, list(ROBOTS).index(robot)])
    base = vibro_ros.load_scene(ROBOTS[robot].scene)
    commands = ROBOTS[robot].commands
    known = {"motor.speed": 100.0} if robot == "damped" else dict(ROBOTS[robot].known)
    scene = base.with_parameters(known | (FIELD | {"sensors.seed": float(seed)} if sensors == "field" else {}))
    drawn = {name: scene[name] * (1.0 + share * spread * random.uniform(-1.0, 1.0)) for name, share in UNKNOWN.items()}
    drawn |= {f"{side}.gap": scene[f"{side}.gap"] + GAP * spread * random.uniform(-1.0, 1.0)
              for side in ("upper", "inclined")}
    truth = scene.with_parameters(drawn | ROBOTS[robot].hidden)
    heyoka = HeyokaRobot(truth, 1e-18 if truth["effects.friction"] == "stribeck" else 1e-15)

    def motion(rate: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        times = np.arange(round(duration * rate) + 1) / rate
        run = heyoka.integrate(times, commands)
        return times, dict(zip((*COLUMNS, *DRIVEN), (*run.samples.T, *run.driven.T), strict=True))

    def noisy(true: np.ndarray, sigma: float) -> np.ndarray:
        return true + sigma * random.standard_normal(len(true))

    times, true = motion(RATE)
    tick = math.tau / truth["sensors.encoder.ticks"]
    rows = [numbers(name, [(time, given[name]) for time, given in commands if name in given])
            for name in ("motor_speed", "upper_gap", "inclined_gap")]
    rows.append(joint_states(times, {"crank": [tick * np.round(true["crank_angle"] / tick)]}, "encoder"))
    axes = {"body_position": "body_velocity", "body_height": "body_vertical_velocity"}
    axes = axes if truth["effects.normal_force"] == "hop" else {"body_position": "body_velocity"}
    if sensors == "laboratory":
        place, speed = ([noisy(true[name], sigma) for name in names] if len(axes) > 1 else
                        noisy(true[names[0]], sigma) for names, sigma in (([*axes], 5e-5), ([*axes.values()], 1e-3)))
        rows.append(odometry(times, place, speed, (5e-5**2, 1e-3**2) if covariances else (0.0, 0.0)))
        rows.append(joint_states(times, {f"{side}_mass": [noisy(true[f"{side}_position"], 5e-5),
                                                          noisy(true[f"{side}_velocity"], 1e-3)]
                                         for side in ("inclined", "upper")}))
    else:
        sigma, every = truth["sensors.tracking.noise"], round(RATE / truth["sensors.tracking.rate"])
        places = [noisy(true[name][::every], sigma) for name in axes]
        rows.append(tracking(times[::every], np.array(places) if len(axes) > 1 else places[0], sigma**2))
        rate = truth["sensors.imu.rate"]
        fine, true = motion(FINE * rate)
        errors = InertialErrors(truth, "accelerometer")
        along, up = (lowpassed(fine, true[name], of_imu(truth, "bandwidth"))[::FINE]
                     for name in ("body_velocity", "body_vertical_velocity"))
        forces = np.array([errors.read((x, 0.0, z + truth["gravity"]), k)
                           for k, (x, z) in enumerate(zip(along, up, strict=True))])
        rows.append(imu(fine[::FINE], forces[:, 0], forces[:, 2], errors.variance(0)))
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
    given = parser.parse_args()
    made = record(given.out, given.robot, given.sensors, given.seed, given.spread, given.duration,
                  not given.no_covariances)
    for name, scene in (("truth", made.truth), ("scene", made.scene)):
        text = yaml.safe_dump({"/**": {"ros__parameters": {"scene": "paper", **scene.parameters}}}, sort_keys=False)
        given.out.with_name(f"{given.out.name}.{name}.yaml").write_text(text)
    for name, value in made.truth.parameters.items():
        if made.scene[name] != value:
            print(f"{name}: {value!r} in truth, {made.scene[name]!r} in the scene")


if __name__ == "__main__":
    main()
