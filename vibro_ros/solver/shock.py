"""Shocks that are no linear jumps: of a rotor that is struck, and with friction that falls with the speed.

A shock changes the velocity V of the body, and with it the phase's rate and the speeds of the *free* coordinates, which
nothing strikes. With the phase held, the body has the inertia A_0, along the ground and upwards; c is the momentum of
the masses that the signals move, at a unit of the phase's rate. The phase changes its rate by -c . dV / J, so that the
body has the inertia

    A = A_0 - c c^T / J,        with c and J at the phase of the shock.

A *blow* throws a coordinate back and gives the body an impulse I: A dV = I, or A_xx dx' = I_x of a body that the ground
holds. A *landing* is a shock with friction, in E. J. Routh's two phases with S. D. Poisson's restitution (`model.shock`
has the law). While the body slips in the direction sigma, dP_x = -sigma mu dP_y, so that

    dx' = -c dy',    c(sigma) = (A_xy + sigma mu A_yy) / (A_xx + sigma mu A_xy)    if mu does not change.

If mu falls with the speed, mu(v) = mu + (mu_s - mu) exp(-v / v_s), use p = P_y / A_yy as independent variable. With
v = sigma x', q = sigma A_xy / A_yy and B = A_xx - A_xy² / A_yy,

    dv/dp = -(A_yy / B) (mu(v) + q)        dy' = dp - q dv,

and w = exp(v / v_s) obeys the linear equation

    w' = -alpha w - beta,    alpha = (A_yy / (B v_s)) (mu + q),    beta = (A_yy / (B v_s)) (mu_s - mu).

So p at a stop, where w = 1, and v at a given p have closed forms, and so has the rebound, which ends at a given p. The
compression ends where y' vanishes. This is an equation for p, whose curvature has one sign, and whose slope,
(A_xx + sigma mu(v) A_xy) / B, is positive unless the body jams.
"""

import math

from vibro_ros.solver.channels import first_ramp, first_signal
from vibro_ros.solver.elementary import exp, expm1, log, log1p
from vibro_ros.solver.rotor import slope_row
from vibro_ros.solver.state import State
from vibro_ros.solver.system import NOTHING, ShockNumbers, System
from vibro_ros.solver.taylor import evaluate
from vibro_ros.solver.typed import Row, part

_EPSILON = 2.220446049250313e-16
# Most steps, by Newton or by halving, that find the end of a compression.
_MOST_STEPS = 100
# exp of a larger number is near overflow, and 1 is negligible beside it.
_LARGE = 500.0
# Least argument of log1p; a smaller one is due to rounding.
_LEAST = -1.0 + 0.5 * _EPSILON


@part
def outcomes(system: System, mode: int, guard: int, candidate: int) -> int:
    """Return how many candidates of a guard, from `candidate` on, belong to one shock, which chooses one of them; 1
    without a shock."""
    if len(system.shock.numbers) == 0 or system.shock.candidate[mode, guard, candidate] == NOTHING:
        return 1
    shock = system.shock.numbers[system.shock.candidate[mode, guard, candidate]]
    return shock.states * (2 if shock.has_bearing else 1)


@part
def _slowed(start: float, rate: float, decay: float, unit: float, p: float) -> float:
    """Return the speed [m/s] of a body that has slipped for `p` from the speed `start`, with v = unit ln(w) and w' =
    -rate w - decay."""
    ratio, exponent = start / unit, rate * p
    fading = exp(-ratio)
    # exp(-ratio) (exp(exponent) - 1) / rate, in the form that neither overflows nor cancels
    if rate == 0.0:
        change = fading * p
    elif exponent > 1.0:
        change = (exp(exponent - ratio) - fading) / rate
    else:
        change = fading * expm1(exponent) / rate
    return max(0.0, start - unit * exponent + unit * log1p(max(-decay * change, _LEAST)))


@part
def _until_stop(start: float, rate: float, decay: float, unit: float) -> float:
    """Return the p at which a slipping body stops; infinite if the shock drives the body on."""
    ratio = start / unit
    fading = exp(-ratio)
    if not (rate + decay > 0.0 and rate + decay * fading > 0.0):
        return math.inf
    if ratio > _LARGE:
        return (ratio + log((rate + decay * fading) / (rate + decay))) / rate
    stop = expm1(ratio) / (rate + decay)
    return stop if rate == 0.0 else log1p(rate * stop) / rate


@part
def _slip_by_decay(shock: ShockNumbers, along: float, across: float, up: float, sign: float, speed: float, rise: float,
                   impulse: float) -> tuple[float, float, float, bool]:
    """Return what `_slip` returns, with friction that falls with the speed."""
    side = 0 if sign > 0.0 else 1
    push, unit, start = sign * across / up, shock.decay_speed, sign * speed
    kinetic, static = shock.kinetic[side], shock.static[side]
    inertia = along - across * across / up
    scale = up / (inertia * unit)
    rate, decay = scale * (kinetic + push), scale * (static - kinetic)
    stop = _until_stop(start, rate, decay, unit)
    compressed: bool = impulse == math.inf
    if stop + push * start <= rise if compressed else up * stop <= impulse:
        return 0.0, stop + push * start, up * stop, True
    if not compressed:
        after = _slowed(start, rate, decay, unit, impulse / up)
        return sign * after, impulse / up - push * (after - start), impulse, False
    slope, steep = (along + sign * kinetic * across) / inertia, (along + sign * static * across) / inertia
    low, high = rise / max(slope, steep), min(stop, rise / min(slope, steep))
    p, after = low, start
    for _ in range(_MOST_STEPS):
        after = _slowed(start, rate, decay, unit, p)
        excess = p - push * (after - start) - rise
        if excess > 0.0:
            high = p
        else:
            low = p
        step = excess / (1.0 + push * unit * (rate + decay * exp(-after / unit)))
        if abs(step) <= 2.0 * _EPSILON * (p + abs(push) * start):
            break
        p = p - step if low < p - step < high else 0.5 * (low + high)
    return sign * after, rise, up * p, False


@part
def _slip(shock: ShockNumbers, along: float, across: float, up: float, sign: float, speed: float, rise: float,
          impulse: float) -> tuple[float, float, float, bool]:
    """Let a body slip in the direction `sign` from `speed` until it stops, or until y' has grown by `rise`, or P_y by
    `impulse`, one of which is infinite.

    Returns
    -------
    (float, float, float, bool)
        x' afterwards, by how much y' and P_y have grown, and whether the body has stopped.
    """
    if shock.decay_speed > 0.0:
        return _slip_by_decay(shock, along, across, up, sign, speed, rise, impulse)
    friction = sign * shock.kinetic[0 if sign > 0.0 else 1]
    slip = (across + friction * up) / (along + friction * across)
    of_rise = up - slip * across  # P_y per unit of y'
    if impulse < math.inf:
        rise = impulse / of_rise
    after = speed - slip * rise
    if sign * slip <= 0.0 or sign * after >= 0.0:  # a shock that drives the body on never stops it
        return after, rise, of_rise * rise, False
    until = speed / slip
    return 0.0, until, of_rise * until, True


@part
def land(shock: ShockNumbers, along: float, across: float, up: float, speed: float,
         fall: float) -> tuple[float, float, int]:
    """Return the body's velocity after a landing.

    Parameters
    ----------
    shock : SHOCK
        Friction and restitution of the landing.
    along, across, up : float
        A [kg].
    speed, fall : float
        x' and y' [m/s] before the landing, y' < 0.

    Returns
    -------
    (float, float, int)
        x' and y' [m/s] afterwards, and how the body moves along the ground: 0 forwards, 1 backwards, 2 sticks.
    """
    if not shock.has_friction:
        bounce = -shock.restitution * fall
        return speed - across / along * (bounce - fall), bounce, 0
    sticks: bool = -shock.static[0] * up <= across <= shock.static[1] * up
    sign = 0.0 if speed == 0.0 else math.copysign(1.0, speed)
    # First the compression, until y' = 0; then the rebound, in which P_y grows by e times that of the compression.
    given, rise = 0.0, -fall
    rebounds: bool = False
    left = math.inf  # P_y that the rebound still adds
    bounce = 0.0
    while True:
        stopped: bool = False
        if sign == 0.0 and sticks:
            change = left / up if rebounds else rise
            impulse = up * change
        else:
            if sign == 0.0:  # friction is too weak
                sign = -1.0 if across > 0.0 else 1.0
            speed, change, impulse, stopped = _slip(shock, along, across, up, sign, speed, rise, left)
        given += impulse
        if rebounds:
            bounce += change
            left = max(0.0, left - impulse)
        else:
            rise = max(0.0, rise - change)
        if stopped:
            sign = 0.0
        elif rebounds or shock.restitution == 0.0:
            return speed, bounce, 2 if sign == 0.0 else (0 if sign > 0.0 else 1)
        else:
            rebounds = True
            rise, left = math.inf, shock.restitution * given


@part
def strike(system: System, state: State, number: int, point: Row, after: Row) -> int:
    """Fill `after` with the channels after a shock at `point`; return the number of the candidate that it chooses."""
    counts, table = system.counts[0], system.shock
    shock, coordinates, phase = table.numbers[number], counts.coordinates, counts.dynamic - 2
    inertia, of_speed, of_rise, series = shock.rotor, 0.0, 0.0, state.scratch.series
    if counts.rotors > 0:
        evaluate(system, state, state.automaton.mode, point)
        for k in range(counts.signals):
            slope = series[slope_row(k), 0]
            inertia += table.mass[k] * slope * slope
            of_speed += table.momentum[k, 0] * slope
            of_rise += table.momentum[k, 1] * slope
    along = shock.along - of_speed * of_speed / inertia
    across, up = shock.across - of_speed * of_rise / inertia, shock.up - of_rise * of_rise / inertia
    for channel in range(len(point)):
        after[channel] = point[channel]
    change, drop, outcome = 0.0, 0.0, 0  # changes of x', and of y' downwards
    if shock.struck == NOTHING:
        speed = point[coordinates + shock.body] if shock.body != NOTHING else 0.0
        fall = point[coordinates + shock.height]
        speed_after, bounce, outcome = land(shock, along, across, up, speed, fall)
        change = speed_after - speed if shock.body != NOTHING else 0.0
        drop = fall - bounce
        after[shock.height], after[coordinates + shock.height] = 0.0, bounce
        if shock.body != NOTHING:
            after[coordinates + shock.body] = speed_after
    else:
        plate, struck = first_ramp(counts) + shock.plate, coordinates + shock.struck
        approach = point[struck] - point[plate + counts.ramps]
        after[shock.struck] = point[plate]
        after[struck] = point[plate + counts.ramps] - shock.restitution * approach
        impulse = (1.0 + shock.restitution) * approach
        if shock.lifts:
            area = along * up - across * across
            change = (up * shock.impulse[0] - across * shock.impulse[1]) / area * impulse
            drop = (across * shock.impulse[0] - along * shock.impulse[1]) / area * impulse
            after[coordinates + shock.height] -= drop
        else:
            change = shock.impulse[0] / along * impulse
        if shock.body != NOTHING:
            after[coordinates + shock.body] += change
            outcome = 1 if after[coordinates + shock.body] < 0.0 else 0
    for i in range(counts.dynamic):
        after[coordinates + i] -= table.direction[number, i, 0] * change - table.direction[number, i, 1] * drop
    outcome = min(outcome, shock.states - 1)
    if counts.rotors == 0:
        return outcome
    rate = point[coordinates + phase] - (of_speed * change - of_rise * drop) / inertia
    after[coordinates + phase] = rate
    for k in range(counts.signals):
        after[first_signal(counts) + counts.signals + k] = series[slope_row(k), 0] * rate
    return 2 * outcome + (1 if rate < 0.0 else 0) if shock.has_bearing else outcome
