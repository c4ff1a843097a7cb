"""Runge-Kutta 4 of fixed step as one would write it by hand for one scene; headlines compare costs with it.

It shares no code with the event loop. Contacts, blows and friction are evaluated only at the ends of steps, which makes
fixed steps inexact here. The comparison is meant to show this error, so it is not an oversight.
"""

import math
from collections.abc import Callable
from importlib.metadata import version as _version
from typing import NamedTuple

import numba
import numpy as np

from benchmark.support import unsupported
from vibro_lab.accuracy.harness import Problem
from vibro_lab.accuracy.programs import Answer, Program, Setting, UnableError, drive_speed, steps
from vibro_ros import Scene, simulate

_RULES = {"weight": 0, "unilateral": 1, "printed": 2, "hop": 1}  # hop: on the ground, where N cannot pull
#: Parameter values that are supported with rigid plates, in addition to `benchmark.support`.
_KNOWN_WHERE_RIGID = {"effects.reaction": (False,), "effects.normal_force": ("weight", "unilateral", "printed")}
_inlined = numba.njit(error_model="numpy", inline="always")
_stored = numba.njit(error_model="numpy", cache=True)


class GuideNumbers(NamedTuple):
    """One guide: its direction from the vertical, mass and weight along it, rod, drive, and plate (inf: none)."""

    sine: float
    cosine: float
    mass: float
    weight: float
    rod: float
    spring: float
    damper: float
    plate: float
    plate_spring: float
    plate_damper: float
    restitution: float
    rigid: bool
    may_pull: bool


class Machine(NamedTuple):
    """The numbers of a scene that the integration needs, without those of the two guides."""

    radius: float
    total: float
    gravity: float
    friction: float
    rule: int
    reaction: bool
    start_speed: float
    speed: float
    acceleration: float


class Flight(NamedTuple):
    """The inertia of a body that may leave the ground, once the masses along their guides are eliminated.

    M_xx x'' + M_xy y'' and M_xy x'' + M_yy y'' are the forces along and across the ground; `inverse` is
    1/(M_xx M_yy - M_xy^2). `felt` is 1 where the body's acceleration acts on the masses, else 0.
    """

    along: float
    across: float
    up: float
    inverse: float
    felt: float


@_inlined
def _motor_speed(time, machine):
    """Return the motor speed [rad/s] at `time`: a ramp from `start_speed` to `speed` at `acceleration`."""
    if machine.speed >= machine.start_speed:
        return min(machine.start_speed + machine.acceleration * time, machine.speed)
    return max(machine.start_speed - machine.acceleration * time, machine.speed)


@_inlined
def _guide_force(position, velocity, sine, cosine, omega, guide, radius):
    """Return F2 or F3, eqs. (1) to (4), and the weight, with the crank's angle from the guide; the net force on a mass
    that is pressed on a rigid plate is 0."""
    root = math.sqrt(guide.rod * guide.rod - radius * radius * sine * sine)
    slider, slope = radius * cosine + root, -radius * sine * (1.0 + radius * cosine / root)
    force = guide.spring * (position - slider) + guide.damper * (velocity - slope * omega) + guide.weight
    if position >= guide.plate:
        if guide.rigid:
            return max(force, 0.0) if velocity >= 0.0 else force
        contact = guide.plate_spring * (position - guide.plate) + guide.plate_damper * velocity
        force += contact if guide.may_pull else max(contact, 0.0)
    return force


@_inlined
def _slipping(f2, f3, friction, inclined, machine):
    """Return w'', x'' and N while the body slips and its acceleration acts back on the masses; `friction` is mu or -mu.

    m3 w'' = -F3 + m3 x'' sin(phi), M x'' = m3 w'' sin(phi) - mu N, and N = M g + m2 u'' + m3 w'' cos(phi) or M g.
    """
    sine, mass, total = inclined.sine, inclined.mass, machine.total
    cosine, normal = inclined.cosine, total * machine.gravity - f2
    if machine.rule == 0:
        cosine, normal = 0.0, total * machine.gravity
    inertia = mass * (1.0 - mass / total * sine * (sine - friction * cosine))
    w = -(f3 + friction * mass * sine / total * normal) / inertia
    normal += mass * w * cosine
    if machine.rule == 1 and normal < 0.0:
        w = -f3 / (mass * (1.0 - mass / total * sine * sine))
        return w, mass * w * sine / total, normal
    return w, (mass * w * sine - friction * normal) / total, normal


@_inlined
def _flying(f2, f3, upper, inclined, machine, flight):
    """u'', w'', x'', y'' of a body in the air, where the ground gives no force."""
    along, upwards = -f3 * inclined.sine, f2 + f3 * inclined.cosine - machine.total * machine.gravity
    ax = flight.inverse * (flight.up * along - flight.across * upwards)
    ay = flight.inverse * (flight.along * upwards - flight.across * along)
    return (-f2 / upper.mass - flight.felt * ay,
            -f3 / inclined.mass + flight.felt * (inclined.sine * ax - inclined.cosine * ay), ax, ay)


@_inlined
def _landed(dx, fall, friction, flight):
    """Return x' after a shock with friction that ends a fall of y' = `fall` < 0: the body slips on, rests, or slips
    back.
    """
    forwards = (flight.across + friction * flight.up) / (flight.along + friction * flight.across)
    backwards = (flight.across - friction * flight.up) / (flight.along - friction * flight.across)
    if dx >= 0.0 and dx + forwards * fall > 0.0:
        return dx + forwards * fall
    if dx <= 0.0 and dx + backwards * fall < 0.0:
        return dx + backwards * fall
    if abs(flight.across) <= friction * flight.up:
        return 0.0
    slope, opposite_slope = (forwards, backwards) if dx > 0.0 else (backwards, forwards)
    return opposite_slope * (dx / slope + fall)


@_inlined
def _accelerations(theta, omega, u, du, w, dw, dx, airborne, upper, inclined, machine, flight):
    """u'', w'', x'', y'' of eqs. (1) to (7), F_in and mu N of a body at rest, and N of the body as it moves."""
    sine, cosine = math.sin(theta), math.cos(theta)
    f2 = _guide_force(u, du, sine, cosine, omega, upper, machine.radius)
    f3 = _guide_force(w, dw, sine * inclined.cosine - cosine * inclined.sine,
                      cosine * inclined.cosine + sine * inclined.sine, omega, inclined, machine.radius)
    if flight is not None:
        if airborne:
            au, aw, ax, ay = _flying(f2, f3, upper, inclined, machine, flight)
            return au, aw, ax, ay, 0.0, -1.0, 0.0
    normal = machine.total * machine.gravity
    if machine.rule != 0:
        normal -= f2 + f3 * inclined.cosine
    inertial, bound = -f3 * inclined.sine, machine.friction * normal
    if machine.rule == 1:
        bound = max(bound, 0.0)
    if dx > 0.0 or (dx == 0.0 and inertial > bound):
        sign = 1.0
    elif dx < 0.0 or -inertial > bound:
        sign = -1.0
    else:
        return -f2 / upper.mass, -f3 / inclined.mass, 0.0, 0.0, inertial, bound, normal
    if machine.reaction:
        aw, ax, normal = _slipping(f2, f3, sign * machine.friction, inclined, machine)
        return -f2 / upper.mass, aw, ax, 0.0, inertial, bound, normal
    ax = (inertial - sign * bound) / machine.total
    return -f2 / upper.mass, -f3 / inclined.mass, ax, 0.0, inertial, bound, normal


@_inlined
def _blow(position, velocity, acceleration, h, guide):
    """Return position and velocity of a mass after a rigid plate has stopped the step that led beyond the plate.

    A mass that arrives no faster than its acceleration over two steps would make it comes to rest.
    """
    if not (guide.rigid and position >= guide.plate and velocity > 0.0):
        return position, velocity
    resting = velocity <= 2.0 * h * abs(acceleration)
    return guide.plate, 0.0 if resting else -guide.restitution * velocity


@_stored
def _integrate(start, upper, inclined, machine, flight, h, per_sample, samples):
    """Fixed steps from t = 0; the body stops where x' changes sign while |F_in| <= mu N.

    `flight` is None for a body that cannot leave the ground: numba then compiles a kernel without y. Else the body
    leaves the ground after a step at whose end N < 0, and lands after one at whose end y <= 0.
    """
    u, du, w, dw = start
    theta = x = dx = y = dy = 0.0
    airborne = False
    half = 0.5 * h
    done = 0
    share = inclined.mass * inclined.sine / machine.total
    samples[0] = u, du, w, dw, x, dx, y, dy
    for n in range(1, len(samples)):
        for _ in range(per_sample):
            t = done * h
            o1, o2, o4 = (_motor_speed(t, machine), _motor_speed(t + half, machine), _motor_speed(t + h, machine))
            au1, aw1, ax1, ay1, _, _, _ = _accelerations(theta, o1, u, du, w, dw, dx, airborne,
                                                         upper, inclined, machine, flight)
            du2, dw2, dx2 = du + half * au1, dw + half * aw1, dx + half * ax1
            au2, aw2, ax2, ay2, _, _, _ = _accelerations(theta + half * o1, o2, u + half * du, du2, w + half * dw, dw2,
                                                         dx2, airborne, upper, inclined, machine, flight)
            du3, dw3, dx3 = du + half * au2, dw + half * aw2, dx + half * ax2
            au3, aw3, ax3, ay3, _, _, _ = _accelerations(theta + half * o2, o2, u + half * du2, du3, w + half * dw2,
                                                         dw3, dx3, airborne, upper, inclined, machine, flight)
            du4, dw4, dx4 = du + h * au3, dw + h * aw3, dx + h * ax3
            au4, aw4, ax4, ay4, inertial, bound, normal = _accelerations(
                theta + h * o2, o4, u + h * du3, du4, w + h * dw3, dw4, dx4, airborne, upper, inclined, machine, flight)
            theta += h / 6.0 * (o1 + 4.0 * o2 + o4)
            u += h / 6.0 * (du + 2.0 * (du2 + du3) + du4)
            w += h / 6.0 * (dw + 2.0 * (dw2 + dw3) + dw4)
            x += h / 6.0 * (dx + 2.0 * (dx2 + dx3) + dx4)
            du += h / 6.0 * (au1 + 2.0 * (au2 + au3) + au4)
            dw += h / 6.0 * (aw1 + 2.0 * (aw2 + aw3) + aw4)
            previous_speed = dx
            dx += h / 6.0 * (ax1 + 2.0 * (ax2 + ax3) + ax4)
            if previous_speed * dx < 0.0 and abs(inertial) <= bound:
                dx = 0.0
            u, du = _blow(u, du, au4, h, upper)
            incoming = dw
            w, dw = _blow(w, dw, aw4, h, inclined)
            if dw < 0.0 < incoming:
                dx += share * (dw - incoming)
            if flight is not None:
                if airborne:
                    y += h * (dy + h / 6.0 * (ay1 + ay2 + ay3))
                    dy += h / 6.0 * (ay1 + 2.0 * (ay2 + ay3) + ay4)
                    if y <= 0.0:
                        speed = _landed(dx, dy, machine.friction, flight)
                        du += flight.felt * dy
                        dw += flight.felt * (inclined.sine * (speed - dx) + inclined.cosine * dy)
                        dx, y, dy, airborne = speed, 0.0, 0.0, False
                elif normal < 0.0:
                    airborne = True
            done += 1
        samples[n] = u, du, w, dw, x, dx, y, dy


def prepare(problem: Problem, setting: Setting) -> Callable[[], Answer]:
    """A run from rest with both gaps at rest, of the step nearest to the setting's that divides the sampling period.

    Raises
    ------
    UnableError
        For a parameter value that the program does not support (`benchmark.support`), and for rigid plates together
        with the reaction on the masses or a body that hops.
    """
    scene = problem.scene
    if fault := unsupported(scene, "rk4_by_hand"):
        raise UnableError(fault)
    if any(scene[f"effects.{side}_contact"] == "restitution" for side in scene.guides):
        for name, values in _KNOWN_WHERE_RIGID.items():
            if scene[name] not in values:
                raise UnableError(f"{name}: {scene[name]!r} is not simulated by rk4_by_hand with rigid plates")
    first, times = simulate(scene, times=np.zeros(1)), problem.times
    start = first.upper_position[0], 0.0, first.inclined_position[0], 0.0
    per_sample = max(1, round(times[1] / setting.value))
    numbers = (_guide(scene, "upper", 0.0), _guide(scene, "inclined", scene["guide.angle"]),
               _machine(scene, drive_speed(scene)), _flight(scene), times[1] / per_sample, per_sample)

    def run() -> Answer:
        samples = np.empty((len(times), 8))
        _integrate(start, *numbers, samples)
        return Answer(samples)

    return run


def _guide(scene: Scene, side: str, angle: float) -> GuideNumbers:
    rod, mass, contact = scene[f"crank.{side}_rod"], scene[f"mass.{side}"], scene[f"effects.{side}_contact"]
    return GuideNumbers(
        sine=math.sin(angle), cosine=math.cos(angle), mass=mass,
        weight=mass * scene["gravity"] * math.cos(angle) if scene["effects.mass_weight"] else 0.0,
        rod=rod, spring=scene[f"{side}.spring.stiffness"], damper=scene[f"{side}.spring.damping"],
        plate=math.inf if contact == "none" else rod + scene[f"{side}.gap"],
        plate_spring=scene[f"{side}.plate.stiffness"], plate_damper=scene[f"{side}.plate.damping"],
        restitution=scene[f"{side}.plate.restitution"], rigid=contact == "restitution",
        may_pull=scene["effects.adhesion"])


def _machine(scene: Scene, speed: float | None) -> Machine:
    target = scene["motor.speed"] if speed is None else speed
    ramp = scene["effects.motor"] == "ramp"
    return Machine(
        radius=scene["crank.radius"], total=scene.total_mass, gravity=scene["gravity"],
        friction=scene["ground.friction"] if scene["effects.friction"] != "none" else 0.0,
        rule=_RULES[scene["effects.normal_force"]], reaction=scene["effects.reaction"],
        start_speed=scene["motor.speed"] if ramp else target, speed=target, acceleration=scene["motor.acceleration"])


def _flight(scene: Scene) -> Flight | None:
    if scene["effects.normal_force"] != "hop":
        return None
    felt, mass = float(scene["effects.reaction"]), scene["mass.inclined"]
    sine, cosine = math.sin(scene["guide.angle"]), math.cos(scene["guide.angle"])
    along, across = scene.total_mass - felt * mass * sine * sine, felt * mass * sine * cosine
    up = scene.total_mass - felt * (scene["mass.upper"] + mass * cosine * cosine)
    return Flight(along, across, up, 1.0 / (along * up - across * across), felt)


def version() -> str:
    """Return the version of numba, which compiles the program."""
    return f"rk4_by_hand under numba {_version('numba')}"


#: The program; it computes nothing between its steps, and has no events.
PROGRAM = Program("rk4_by_hand", steps(1e-4, 1e-5, 1e-6, 1e-7), prepare, version, is_dense=False)
