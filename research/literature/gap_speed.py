"""Impact gap and mean speed of the crank-driven robots of Korendiy and others, 2022, on a horizontal guide.

They tune the gap so that the internal body hits its plate as fast as it can; whether the robot is then at its fastest
is what is measured here.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from research.literature.capsule_equations import Capsule, Drive, integrate
from vibro_ros.accuracy.starts import SETTLING, Average, average, started
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.simulator import Simulator

#: Gaps [m] and motor speeds [rad/s] that are tried.
GAPS = tuple(round(float(gap), 4) for gap in np.arange(-0.016, 0.0581, 0.002))
MOTORS = (60.0, 80.0, 100.0, 120.0)
#: Damper of the drive [N·s/m], so that no start is remembered.
DAMPING = 2.0
#: Turns over which a run is compared with scipy's.
CHECKED_TURNS = 3
_DURATION, _SAMPLES = 10.0, 200
# Turns before a run by scipy counts, turns that count, and its tolerance, whose errors the starts' interval contains.
_SETTLING_TURNS, _COUNTED_TURNS, _COARSE = 40, 30, 1e-6


def robot_scene(gap: float, motor: float) -> Scene:
    """The seed paper's robot without its upper mass, its guide along x; it is driven towards -x, where its plate is."""
    return Scene("gap", {"guide.angle": math.pi / 2.0, "inclined.gap": gap, "motor.speed": motor,
                         "inclined.spring.damping": DAMPING, "effects.upper_mass": False,
                         "effects.normal_force": "weight", "effects.reaction": True})


@dataclass(frozen=True)
class Tried:
    """What a gap does at a motor speed: speed towards the plate and speed at which the mass hits the plate [m/s]."""

    gap: float
    motor: float
    speed: Average
    approach: Average


def tried(job: tuple[float, float, int]) -> Tried:
    """Mean speed and mean speed of approach over so many independent starts."""
    gap, motor, starts = job
    speeds, approaches = [], []
    for number in range(starts):
        device = started(robot_scene(gap, motor), np.random.default_rng(number))
        device.advance_to(SETTLING)
        device.take_events()
        begin = device.state.body_position
        device.advance_to(SETTLING + _DURATION)
        speeds.append((begin - device.state.body_position) / _DURATION)
        events = device.take_events()
        blows = events["speed"][events["kind"] == "inclined_contact"]
        approaches.append(float(np.mean(blows)) if len(blows) else 0.0)
    return Tried(gap, motor, average(np.array(speeds)), average(np.array(approaches)))


@dataclass(frozen=True)
class InUnits:
    """The robot in the variables of the capsule's literature, and the units of length [m] and of time [s]."""

    capsule: Capsule
    drive: Drive
    length: float
    time: float


def in_units(gap: float, motor: float) -> InUnits:
    """The robot at rest with its mass on its slider, which needs a gap that leaves it there."""
    scene = robot_scene(gap, motor)
    mass, stiffness, damping = (scene[name] for name in ("mass.inclined", "inclined.spring.stiffness",
                                                         "inclined.spring.damping"))
    friction, rate = scene["ground.friction"] * scene.total_mass * scene["gravity"], math.sqrt(stiffness / mass)
    radius, rod, length = scene["crank.radius"], scene["crank.inclined_rod"], friction / stiffness
    start = math.sqrt(rod**2 - radius**2)  # where the slider and the mass are at first

    def push(time: float) -> float:
        sine, cosine = math.sin(motor * time / rate), math.cos(motor * time / rate)
        root = math.sqrt(rod**2 - (radius * cosine) ** 2)
        place, speed = radius * sine + root, motor * radius * cosine * (1.0 + radius * sine / root)
        return (stiffness * (place - start) + damping * speed) / friction

    capsule = Capsule(math.nan, motor / rate, scene["inclined.plate.stiffness"] / stiffness, scene["mass.body"] / mass,
                      (rod + gap - start) / length, damping / (2.0 * mass * rate))
    return InUnits(capsule, Drive(push), length, 1.0 / rate)


def difference(gap: float, motor: float) -> float:
    """Largest difference [m] of the body's position from scipy's within some turns from rest on the slider."""
    robot = in_units(gap, motor)
    times = np.linspace(0.0, CHECKED_TURNS * robot.capsule.period, _SAMPLES + 1)
    own = -Simulator(robot_scene(gap, motor)).sample(times * robot.time).body_position
    return float(np.max(np.abs(own - robot.length * integrate(robot.capsule, times, robot.drive)[:, 2])))


def tried_one_way(job: tuple[float, float, int]) -> Tried:
    """As `tried`, by scipy alone, for wheels that turn one way only: the body never moves away from its plate."""
    gap, motor, starts = job
    robot = in_units(gap, motor)
    capsule, unit = replace(robot.capsule, grip=math.inf), robot.length / robot.time
    begin, end = _SETTLING_TURNS * capsule.period, (_SETTLING_TURNS + _COUNTED_TURNS) * capsule.period
    speeds, approaches = [], []
    for start in np.linspace(-1.0, 1.0, starts):
        blows: list[tuple[float, float]] = []
        places = integrate(capsule, np.array([begin, end]), robot.drive, float(start) / unit, _COARSE, blows)[:, 2]
        speeds.append(unit * (places[1] - places[0]) / (end - begin))
        counted = [unit * speed for time, speed in blows if time >= begin]
        approaches.append(float(np.mean(counted)) if counted else 0.0)
    return Tried(gap, motor, average(np.array(speeds)), average(np.array(approaches)))
