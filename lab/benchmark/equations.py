"""The equations of README.md, compiled by numba, for programs that integrate given equations.

A mode says which plates push and what the ground does. `slope` is smooth within a mode, `guards` are positive within a
mode, and `crossed` changes mode and speeds at an event. `Callbacks` has the equations for programs that call them from
Python.
"""

import math
import timeit
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numba
import numpy as np

from benchmark.problems import COLUMNS, ReferenceProblem

BACKWARD, FREE, FORWARD, STICK, AIR = -1, 0, 1, 2, 3
_RULES = {"weight": 0, "unilateral": 1, "hop": 2}
_jit = numba.njit(error_model="numpy", cache=True)
_inlined = numba.njit(error_model="numpy", inline="always")


class ProblemNumbers(NamedTuple):
    """Numbers of a problem: those of each guide, then those of the whole."""

    m2: float
    k2: float
    c2: float
    k4: float
    c4: float
    plate2: float
    L2: float
    m3: float
    k3: float
    c3: float
    k1: float
    c1: float
    plate3: float
    L3: float
    sine: float
    cosine: float
    total: float
    radius: float
    omega: float
    g: float
    mu: float
    rule: int
    adhesion: bool
    reaction: float
    heavy: float
    restitution: float
    slow: float


def machine(problem: ReferenceProblem, slow: float = 0.0) -> ProblemNumbers:
    """Return the numbers of a problem. An absent mass gets numbers with which it exerts no force.

    A landing at a speed of at most `slow` [m/s] does not bounce, so that a sequence of infinitely many landings ends.
    """
    values = problem.parameters
    absent = {name: 0.0 for mass, names in (("m2", ("k2", "k4")), ("m3", ("k3", "k1")))
              if not values[mass] for name in (*names, "c2" if mass == "m2" else "c3")}
    return ProblemNumbers(
        **{name: values[name] for name in ("m2", "k2", "c2", "k4", "c4", "L2", "m3", "k3", "c3", "k1", "c1", "L3",
                                           "omega", "g", "mu", "adhesion")} | absent,
        radius=values["l"],
        plate2=values["L2"] + values["gap2"] if values["m2"] and values["k4"] else math.inf,
        plate3=values["L3"] + values["gap3"] if values["m3"] and values["k1"] else math.inf,
        sine=math.sin(values["phi"]), cosine=math.cos(values["phi"]), total=values["m1"] + values["m2"] + values["m3"],
        rule=_RULES[values["normal"]], reaction=float(values["reaction"]), heavy=values["g"] * values["weight"],
        restitution=values["restitution"], slow=slow)


def start(problem: ReferenceProblem) -> np.ndarray:
    """The state at t = 0, shape (8,)."""
    return np.array([problem.start[column] for column in COLUMNS])


@_inlined
def _push(position, speed, plate, k, c):
    """Return the penetration into the plate [m], and the plate's force [N] if the plate pushes."""
    depth = position - plate
    return depth, k * depth + c * speed if depth > -math.inf else -1.0


@_inlined
def _drive(t, q, v, sine, cosine, rod, k, c, p):
    """Force of the drive spring and damper on the mass, with the sign of F2 and F3 [N]."""
    ct, st = math.cos(p.omega * t), math.sin(p.omega * t)
    ca, sa = ct * cosine + st * sine, st * cosine - ct * sine
    root = math.sqrt(rod * rod - p.radius * p.radius * sa * sa)
    return k * (q - p.radius * ca - root) + c * (v + p.radius * sa * (1.0 + p.radius * ca / root) * p.omega)


@_jit
def forces(t, y, upper, inclined, p):
    """F2 + m2 g and F3 + m3 g cos(phi), without what the body's acceleration adds [N]."""
    f2 = _drive(t, y[0], y[1], 0.0, 1.0, p.L2, p.k2, p.c2, p) + p.m2 * p.heavy
    f3 = _drive(t, y[2], y[3], p.sine, p.cosine, p.L3, p.k3, p.c3, p) + p.m3 * p.heavy * p.cosine
    if upper:
        f2 += _push(y[0], y[1], p.plate2, p.k4, p.c4)[1]
    if inclined:
        f3 += _push(y[2], y[3], p.plate3, p.k1, p.c1)[1]
    return f2, f3


@_jit
def accelerations(f2, f3, slide, ground, p):
    """Return u'', w'', x'', y'' and N. The friction force of a body that slides on the ground is mu N `slide`."""
    ax = ay = 0.0
    inward, pressed = -f3 * p.sine, p.total * p.g
    if p.rule != 0 or ground == AIR:
        pressed -= f2 + f3 * p.cosine
    up = p.cosine if p.rule != 0 else 0.0
    reacting_mass = p.reaction * p.m3
    if ground == AIR:
        along, across = p.total - reacting_mass * p.sine * p.sine, reacting_mass * p.sine * p.cosine
        high = p.total - p.reaction * p.m2 - reacting_mass * p.cosine * p.cosine
        scale = 1.0 / (along * high - across * across)
        ax, ay = scale * (high * inward + across * pressed), -scale * (along * pressed + across * inward)
    elif ground != STICK:
        rub = p.mu * slide
        ax = (inward - rub * pressed) / (p.total - reacting_mass * p.sine * (p.sine - rub * up))
    normal = 0.0 if ground == AIR else pressed + reacting_mass * p.sine * up * ax
    au = -f2 / p.m2 - p.reaction * ay if p.m2 > 0.0 else 0.0
    aw = -f3 / p.m3 + p.reaction * (p.sine * ax - p.cosine * ay) if p.m3 > 0.0 else 0.0
    return au, aw, ax, ay, normal


@_jit
def slope(t, y, upper, inclined, ground, slide, p, out):
    """Write the derivative of the state."""
    f2, f3 = forces(t, y, upper, inclined, p)
    out[1], out[3], out[5], out[7], _ = accelerations(f2, f3, slide, ground, p)
    out[0], out[2], out[4], out[6] = y[1], y[3], y[5], y[7]


@_jit
def touches(position, speed, plate, k, c, p):
    """Whether a plate pushes the mass."""
    depth, push = _push(position, speed, plate, k, c)
    return depth > 0.0 and (p.adhesion or push > 0.0)


@_jit
def smooth_slope(t, y, width, p, out):
    """The derivative without modes: plates by the depth, friction mu max(N, 0) tanh(x'/width)."""
    upper, inclined = (touches(y[0], y[1], p.plate2, p.k4, p.c4, p), touches(y[2], y[3], p.plate3, p.k1, p.c1, p))
    f2, f3 = forces(t, y, upper, inclined, p)
    slide = math.tanh(y[5] / width)
    au, aw, ax, ay, normal = accelerations(f2, f3, slide, FORWARD, p)
    if p.rule != 0 and normal < 0.0:
        au, aw, ax, ay, normal = accelerations(f2, f3, 0.0, FREE, p)
    out[0], out[2], out[4], out[6] = y[1], y[3], y[5], y[7]
    out[1], out[3], out[5], out[7] = au, aw, ax, ay


@_jit
def guards(t, y, upper, inclined, ground, p, out):
    """Write four numbers that are positive within the mode: of each plate, then two of the ground."""
    for k in range(2):
        q, v, plate, stiff, damp = ((y[0], y[1], p.plate2, p.k4, p.c4) if k == 0
                                    else (y[2], y[3], p.plate3, p.k1, p.c1))
        depth, push = _push(q, v, plate, stiff, damp)
        pressing = upper if k == 0 else inclined
        inside = depth if p.adhesion else min(depth, push / max(stiff, 1.0))
        out[k] = inside if pressing else -inside
        if plate == math.inf:
            out[k] = 1.0
    out[2] = out[3] = 1.0
    f2, f3 = forces(t, y, upper, inclined, p)
    if ground == AIR:
        out[2] = y[6]
        return
    slide = float(ground) if ground != STICK else 0.0
    normal = accelerations(f2, f3, slide, ground, p)[4]
    if ground == STICK:
        out[2], out[3] = p.mu * normal + f3 * p.sine, p.mu * normal - f3 * p.sine
    elif ground == FREE:
        out[3] = -normal if p.mu > 0.0 and p.rule != 0 else 1.0
    else:
        out[2] = ground * y[5]
        out[3] = normal if p.rule != 0 else 1.0


@_jit
def settled(t, y, upper, inclined, p):
    """Return the ground's state (stick or slip) for a body on it, from its speed and the forces."""
    if p.mu == 0.0:
        return FREE
    f2, f3 = forces(t, y, upper, inclined, p)
    ground = FORWARD if y[5] > 0.0 else BACKWARD
    if y[5] == 0.0:
        if abs(f3 * p.sine) <= p.mu * accelerations(f2, f3, 0.0, STICK, p)[4]:
            return STICK
        ground = FORWARD if f3 * p.sine < 0.0 else BACKWARD
    if p.rule != 0 and accelerations(f2, f3, float(ground), ground, p)[4] < 0.0:
        return AIR if p.rule == 2 else FREE
    return ground


@_jit
def land(y, p):
    """Stop the fall by an impulse with friction (Routh's law: at most mu times the normal part, against x'); a body
    without masses bounces.
    """
    if p.restitution > 0.0 and -y[7] > p.slow:
        y[6], y[7] = 0.0, -p.restitution * y[7]
        return
    reacting_mass = p.reaction * p.m3
    along, across = p.total - reacting_mass * p.sine * p.sine, reacting_mass * p.sine * p.cosine
    high = p.total - p.reaction * p.m2 - reacting_mass * p.cosine * p.cosine
    fall, speed_before = y[7], y[5]
    speed_after, remaining_fall = speed_before, fall
    if speed_before != 0.0:
        sign = 1.0 if speed_before > 0.0 else -1.0
        rate = (across + sign * p.mu * high) / (along + sign * p.mu * across)
        speed_after = speed_before + rate * fall
        if sign * speed_after >= 0.0:
            remaining_fall = 0.0
        else:
            remaining_fall = fall + speed_before / rate
    if remaining_fall != 0.0:
        sign = -1.0 if across > 0.0 else 1.0
        rate = (across + sign * p.mu * high) / (along + sign * p.mu * across)
        speed_after = 0.0 if abs(across) <= p.mu * high else rate * remaining_fall
    y[1] += p.reaction * fall
    y[3] += p.reaction * (p.sine * (speed_after - speed_before) + p.cosine * fall)
    y[5], y[6], y[7] = speed_after, 0.0, 0.0


@_jit
def begin(t, y, p):
    """Return the mode just after a start, at which a mass may lie on its plate and be pressed on it."""
    f2, f3 = forces(t, y, False, False, p)
    upper = y[0] > p.plate2 or (y[0] == p.plate2 and f2 < 0.0)
    inclined = y[2] > p.plate3 or (y[2] == p.plate3 and f3 < 0.0)
    if y[6] > 0.0:
        return upper, inclined, AIR
    return upper, inclined, settled(t, y, upper, inclined, p)


@_jit
def crossed(t, y, upper, inclined, ground, which, p):
    """Return the mode after guard `which` has become zero, and apply the jump of speeds to `y`."""
    if which == 0:
        upper = not upper
    elif which == 1:
        inclined = not inclined
    elif which == 2 and ground == AIR:
        land(y, p)
        ground = AIR if y[7] > 0.0 else FREE
    elif which == 2 and ground != STICK:
        y[5] = 0.0
    elif ground == STICK:
        f2, f3 = forces(t, y, upper, inclined, p)
        forward = which == 2
        ground = FORWARD if forward else BACKWARD
        if p.rule != 0 and accelerations(f2, f3, float(ground), ground, p)[4] < 0.0:
            ground = AIR if p.rule == 2 else FREE
        return upper, inclined, ground
    elif which == 3 and ground != FREE:
        return upper, inclined, AIR if p.rule == 2 else FREE
    elif which == 3:
        ground = FORWARD if y[5] > 0.0 else BACKWARD
        if abs(y[5]) < 1e-14:
            y[5] = 0.0
            ground = settled(t, y, upper, inclined, p)
        return upper, inclined, ground
    if ground != AIR:
        ground = settled(t, y, upper, inclined, p)
    return upper, inclined, ground


class Callbacks:
    """The equations of one problem, as callbacks for a program that calls them from Python, at the least cost possible
    there.

    The equations are compiled with the numbers of the problem as constants, because passing the numbers takes 6 us a
    call and the equations take 0.04 us. Calls are counted, so that a page can state the cost of the callbacks
    separately.

    Attributes
    ----------
    slope, guards, smooth : callable
        Functions of time, state, shape (8,), and the array into which they write: the derivative within `mode`; the
        four guards within `mode`; and the derivative without modes, with friction smoothed over `width` [m/s].
    mode : ndarray, shape (5,)
        Whether each plate pushes, the state of the ground, the number of calls of `slope` or `smooth`, and that of
        `guards`.
    """

    def __init__(self, p: ProblemNumbers, width: float = 0.0) -> None:
        @numba.njit(error_model="numpy")
        def _slope(mode, t, y, out):
            mode[3] += 1
            slope(t, y, mode[0] != 0, mode[1] != 0, mode[2], float(mode[2]), p, out)

        @numba.njit(error_model="numpy")
        def _guards(mode, t, y, out):
            mode[4] += 1
            guards(t, y, mode[0] != 0, mode[1] != 0, mode[2], p, out)

        @numba.njit(error_model="numpy")
        def _smooth(mode, t, y, out):
            mode[3] += 1
            smooth_slope(t, y, width, p, out)

        self.numbers, self.mode = p, np.zeros(5, dtype=np.int64)
        self.slope: Callable[..., None] = partial(_slope, self.mode)
        self.guards: Callable[..., None] = partial(_guards, self.mode)
        self.smooth: Callable[..., None] = partial(_smooth, self.mode)
        for function, size in ((self.slope, 8), (self.guards, 4), (self.smooth, 8)):
            function(0.0, np.full(8, 0.1), np.empty(size))  # compiles it

    def begin(self, y: np.ndarray) -> None:
        """Set the mode of a start at t = 0, and reset the counters of calls."""
        self.mode[:] = *begin(0.0, y, self.numbers), 0, 0

    def cross(self, t: float, y: np.ndarray, which: int) -> None:
        """Set the mode after guard `which` has become zero, and apply the jump to the speeds in `y`."""
        upper, inclined, ground = self.mode[:3]
        self.mode[:3] = crossed(t, y, bool(upper), bool(inclined), int(ground), which, self.numbers)

    def seconds(self) -> float:
        """Return the time [s] of all counted calls, estimated from the quickest of some calls."""
        total, y, out = 0.0, np.full(8, 0.1), np.empty(8)
        for count, function in zip(self.mode[3:].copy(), (self.slope, self.guards), strict=True):
            total += count * min(timeit.repeat(lambda: function(0.0, y, out), number=100, repeat=20)) / 100  # noqa: B023
        return total
