"""How well a twin follows simulated robots, and which of their faults it names: the tables of the twin's guide.

`python lab/test/twin/following.py errors|wrong|faults [ROBOT ...] [--seeds N]` prints a row for each of `ROBOTS`, for
each of `DIFFERENCES` between robot and scene, or for each fault. A robot's free parameters are drawn from what the twin
believes of them, 2 % around the scene's. `following.py settings` halves and doubles each number of the filter.
"""

import argparse
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, replace
from functools import cache, partial

import numpy as np

from vibro_lab.twin.estimator import Departure, Estimate, Estimator
from vibro_lab.twin.particles import INDEX, FilterSettings, MeasuredNumber
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.faults import Incident
from vibro_ros.model.scene import Scene
from vibro_ros.sensors.device import SensedSimulator, new_device
from vibro_ros.simulation.samples import Samples

TICK, PERIOD = 0.005, 0.05  # s
BANDWIDTH, RANGE = 740.0, 16.0 * 9.80665  # of a bmi270
FIELD = {"sensors.preset": "bmi270", "sensors.imu.rate": 400.0, "sensors.encoder.rate": 200.0,
         "sensors.tracking.rate": 100.0}
SPREAD = 0.02
FREE = ("ground.friction", "mass.body", "mass.upper", "mass.inclined", "upper.spring.stiffness",
        "inclined.spring.stiffness")
ROBOTS = {"damped at 100 rad/s": ("damped", {"effects.motor": "ramp", "motor.speed": 100.0}),
          **{f"device at {speed:g} rad/s": ("device", {"motor.speed": speed}) for speed in (60.0, 90.0, 120.0)},
          "machine at 100 rad/s": ("machine", {"motor.speed": 100.0})}
"""Scene, and what is changed in it for robot and twin alike."""
LASTS = 10.0  # s
GAPS = {"upper_gap": -0.002, "inclined_gap": 0.002}  # m
FAULTS = {
    "motor_stall": (Incident("motor_stall", LASTS), ()),
    "friction_patch": (Incident("friction_patch", LASTS, "", 0.03, -100.0, 100.0), ()),
    **{f"plate_stuck of {side}": (Incident("plate_stuck", LASTS, side), (f"{side}_gap",))
       for side in ("upper", "inclined")},
    "supply_sag": (Incident("supply_sag", LASTS, "", 12.0), ()),
    "sensor_offset of imu": (Incident("sensor_offset", LASTS, "imu", 3.0), ()),
    "sensor_offset of tracking": (Incident("sensor_offset", LASTS, "tracking", 0.05), ()),
    "sensor_freeze of encoder": (Incident("sensor_freeze", LASTS, "encoder"), ()),
    "none, but both plates move": (None, tuple(GAPS)),
}
"""A fault, and the gaps that are commanded at its beginning, because a stuck plate shows only then."""


def farther_off(scene: Scene, percent: float, seed: int) -> Scene:
    """Return a robot each of whose free parameters is `percent` off, up or down."""
    signs = np.random.default_rng(2000 + seed).choice((-1.0, 1.0), len(FREE))
    return scene.with_parameters({name: scene[name] * (1.0 + 0.01 * percent * sign)
                                  for name, sign in zip(FREE, signs.tolist(), strict=True)})


DIFFERENCES: dict[str, Callable[[Scene, int], Scene]] = {
    "none": lambda scene, seed: scene,
    "parameters 5 % farther off": lambda scene, seed: farther_off(scene, 5.0, seed),
    "parameters 8 % farther off": lambda scene, seed: farther_off(scene, 8.0, seed),
    "viscous friction of 2 N·s/m": lambda scene, seed: scene.with_parameters({"ground.viscous_friction": 2.0}),
    "viscous friction of 5 N·s/m": lambda scene, seed: scene.with_parameters({"ground.viscous_friction": 5.0}),
    "ground's restitution of 0.3": lambda scene, seed: scene.with_parameters({"ground.restitution": 0.3}),
}
"""What a robot has and the twin's scene lacks. A restitution of the ground matters only to a body that hops."""


def believed(robot: str) -> Scene:
    """Return one of `ROBOTS` as the twin believes it to be."""
    scene, changes = ROBOTS[robot]
    return load_scene(scene).with_parameters({**changes, **FIELD})


def drawn(scene: Scene, seed: int) -> Scene:
    """Return a robot whose free parameters are drawn from what is believed of them."""
    random = np.random.default_rng(1000 + seed)
    return scene.with_parameters({"sensors.seed": float(seed), **{
        name: scene[name] * math.exp(SPREAD * random.standard_normal()) for name in FREE}})


def measured(robot: SensedSimulator) -> Iterator[MeasuredNumber]:
    """Yield what has come out of the robot's sensors, as the node hears it."""
    axes = 1 + robot.scene.body_hops
    for sensor, at, values in robot.take_measurements():
        if sensor == "tracking":
            for field, value in zip(("body_position", "body_height")[:axes], values[:3:2], strict=False):
                yield MeasuredNumber(at, field, value, values[3])
        elif sensor == "encoder":
            yield MeasuredNumber(at, "crank_angle", values[0], (2.0 * math.pi / 4096.0)**2 / 12.0)
        else:
            for field, value in zip(("acceleration_x", "acceleration_z")[:axes], values[:3:2], strict=False):
                yield MeasuredNumber(at, field, value, values[6], RANGE)


def follow(estimator: Estimator, robot: SensedSimulator, duration: float,
           acts: Mapping[float, Callable[[SensedSimulator, Estimator], object]] = {}, zero: float = 0.0
           ) -> Iterator[tuple[Estimate, Samples, Departure | None]]:
    """Let the estimator follow the robot; yield estimate, true state and departure after each `PERIOD`.

    `acts` are called with robot and estimator at instants [s] of the estimator, whose time 0 is the robot's `zero` [s].
    """
    begin, due = round((robot.time - zero) / TICK), {round(at / TICK): act for at, act in acts.items()}
    for tick in range(begin + 1, begin + round(duration / TICK) + 1):
        if tick in due:
            due[tick](robot, estimator)
        robot.advance_to(zero + tick * TICK)
        for measurement in measured(robot):
            estimator.measure(measurement._replace(time=measurement.time - zero))
        if tick % round(PERIOD / TICK) == 0:
            estimator.advance_to(tick * TICK + 1e-9)
            yield estimator.estimate(), robot.state, estimator.departure


def estimator_and_robot(name: str, seed: int, difference: str = "none", **changes) -> tuple[Estimator, SensedSimulator]:
    """Return an estimator, with `changes` of its arguments, and the robot that it is to follow."""
    scene = believed(name)
    return (Estimator(scene, FREE, SPREAD, **{"seed": seed, "bandwidth": BANDWIDTH, **changes}),
            new_device(DIFFERENCES[difference](drawn(scene, seed), seed)))


def print_errors(robot: str, seeds: int, difference: str = "none") -> None:
    """Print how well 10 s of the robot's speed are known, how honest the variances are, and the false alarms."""
    index, rows, of_parameters, departures, begin = INDEX["body_velocity"], [], [], Counter[str](), time.process_time()
    for seed in range(seeds):
        estimator, device = estimator_and_robot(robot, seed, difference)
        for estimate, true, departure in follow(estimator, device, LASTS):
            rows.append((estimate.mean[index] - true.body_velocity, math.sqrt(estimate.variance[index])))
            if departure:
                departures[departure.words] += 1
        of_parameters += [abs(mean - device.scene[name]) / deviation
                          for name, (mean, deviation) in estimate.parameters.items()]
    errors, deviations = np.abs(rows).T
    ratios, cost = errors / deviations, (time.process_time() - begin) / LASTS / seeds
    print(f"| {robot} | {difference} | {1e3 * np.median(errors):.1f} | {1e3 * np.quantile(errors, 0.9):.1f} | "
          f"{100.0 * np.mean(ratios < 2.5):.0f} % | {100.0 * np.mean(ratios > 0.3):.0f} % | "
          f"{100.0 * np.mean(np.array(of_parameters) < 2.5):.0f} % | {dict(departures) or 'none'} | {cost:.2f} s |",
          flush=True)


def words_said(estimator: Estimator, device: SensedSimulator, name: str) -> str:
    """Let a fault begin, and return what the twin first says within a second."""
    fault, gaps = FAULTS[name]
    if fault:
        device.fail(*fault)
    if commands := {gap: GAPS[gap] for gap in gaps}:
        estimator.command(device.time, **commands)
        device.command(**commands)
    return next((departure.words for _, _, departure in follow(estimator, device, 1.0) if departure), "nothing")


def in_a_child(act: Callable[[], str]) -> str:
    """Return what `act` says in a child process, which goes on from here and leaves this process as it is."""
    reading, writing = os.pipe()
    if not (child := os.fork()):
        os.write(writing, act().encode())
        os._exit(0)
    os.waitpid(child, 0)
    words = os.read(reading, 1000).decode()
    os.close(reading)
    os.close(writing)
    return words


def print_faults(robot: str, seeds: int, names: list[str]) -> None:
    """Print of each fault, begun at other instants in other robots, what the twin has said within a second."""
    words_by_fault = {name: Counter[str]() for name in names}
    for seed in range(seeds):
        estimator, device = estimator_and_robot(robot, seed)
        for _ in follow(estimator, device, 2.5 + 0.137 * seed):
            pass
        for name in names:
            words_by_fault[name][in_a_child(partial(words_said, estimator, device, name))] += 1
    for name in names:
        words = ", ".join(f"{words}: {count}" for words, count in words_by_fault[name].most_common())
        print(f"| {robot} | {name} | {words} |", flush=True)


@cache
def verdicts(settings: FilterSettings) -> dict[str, str]:
    """Return what a twin with these settings says of a `damped` robot without a fault, and with each of three.

    Of 2.5 s without a fault: the false alarms, and whether 90 % of the errors of the speed are below 5 mm/s. Twelve
    particles are enough for that, and cost a third of the usual forty.
    """
    estimator, device = estimator_and_robot("damped at 100 rad/s", 1, particles=12, settings=settings)
    rows = list(follow(estimator, device, 2.5))
    errors = [abs(estimate.mean[INDEX["body_velocity"]] - true.body_velocity) for estimate, true, _ in rows]
    verdict = {"false alarms": ", ".join({departure.words for _, _, departure in rows if departure}) or "none",
               "speed": "known" if np.quantile(errors, 0.9) < 5e-3 else "lost"}
    for name in ("motor_stall", "friction_patch", "sensor_freeze of encoder"):
        verdict[name] = in_a_child(partial(words_said, estimator, device, name)).partition(" of about")[0]
    return verdict


def changed_verdicts(name: str) -> list[str]:
    """Return which verdicts change if a setting is halved or doubled."""
    usual, changes, value = verdicts(FilterSettings()), [], getattr(FilterSettings(), name)
    for factor in (0.5, 2.0):
        changed = factor * value if isinstance(value, float) else max(1, round(factor * value))
        others = verdicts(replace(FilterSettings(), **{name: changed}))
        changes += [f"{changed:g}: {case} {others[case]}" for case in usual if others[case] != usual[case]]
    return changes


def main() -> int:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("errors", "wrong", "faults", "settings"))
    parser.add_argument("robots", nargs="*", default=list(ROBOTS), metavar="ROBOT")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--faults", nargs="*", default=list(FAULTS))
    given = parser.parse_args()
    if given.what == "settings":
        for name in (field.name for field in fields(FilterSettings)):
            print(f"| {name} | {'; '.join(changed_verdicts(name)) or 'all stand'} |", flush=True)
        return 0
    for robot in given.robots:
        if given.what == "errors":
            print_errors(robot, given.seeds)
        elif given.what == "wrong":
            for difference in DIFFERENCES:
                print_errors(robot, given.seeds, difference)
        else:
            print_faults(robot, given.seeds, [name for name in given.faults
                                              if name != "supply_sag" or robot.startswith("machine")])
    return 0


if __name__ == "__main__":
    sys.exit(main())
