"""Shocks that strike a rotor: the jump depends on the phase, so that it is no matrix of the tables.

`model.shock` has the laws, for an inertia that does not change.
"""

from vibro_ros.solver.compilation import called_kernel
from vibro_ros.solver.rotor import slope_row
from vibro_ros.solver.system import NOTHING, first_signal
from vibro_ros.solver.taylor import evaluate


@called_kernel
def strike(system, state, point, after):
    """Fill `after` with the channels after a landing at `point` that strikes the rotor; return the candidate's number.

    The inertia of the body along the ground and upwards is A = A_0 - c c^T / J(phase): A_0 while the phase is held, and
    c the body's momentum from a unit of the phase's rate. In the shock the phase's rate changes by -c . dV / J. The
    body slips, stops or sticks by Routh's law; `model.shock` has the rule, for an inertia that does not change.
    """
    size, numbers, shock = system.size[0], system.shock.numbers[0], system.shock
    evaluate(system, state, state.now[0].automaton.mode, point)
    series, coordinates, phase = state.scratch.room[0].series[:], size.coordinates, size.dynamic - 2
    inertia, of_speed, of_rise = numbers.rotor, 0.0, 0.0
    for k in range(size.signals):
        slope = series[slope_row(k), 0]
        inertia += shock.mass[k] * slope * slope
        of_speed += shock.momentum[k, 0] * slope
        of_rise += shock.momentum[k, 1] * slope
    along = numbers.along - of_speed * of_speed / inertia
    across, up = numbers.across - of_speed * of_rise / inertia, numbers.up - of_rise * of_rise / inertia
    fall = point[coordinates + numbers.height]
    speed = point[coordinates + numbers.body] if numbers.body != NOTHING else 0.0
    state_after, speed_after = 0, 0.0
    if not numbers.has_friction:
        speed_after = speed + across / along * fall
    else:
        forwards = (across + numbers.kinetic[0] * up) / (along + numbers.kinetic[0] * across)
        backwards = (across - numbers.kinetic[1] * up) / (along - numbers.kinetic[1] * across)
        if (speed + forwards * fall if forwards >= 0.0 else speed) >= 0.0:
            speed_after = speed + forwards * fall
        elif (speed + backwards * fall if backwards <= 0.0 else speed) <= 0.0:
            state_after, speed_after = 1, speed + backwards * fall
        elif -numbers.static[0] * up <= across <= numbers.static[1] * up:
            state_after = 2
        elif backwards > 0.0:  # friction is too weak: the body slips back after speed / forwards of the fall has ended
            state_after, speed_after = 1, backwards * (speed / forwards + fall)
        else:
            speed_after = forwards * (speed / backwards + fall)
    for channel in range(len(point)):
        after[channel] = point[channel]
    change = speed_after - speed if numbers.body != NOTHING else 0.0
    after[numbers.height], after[coordinates + numbers.height] = 0.0, 0.0
    if numbers.body != NOTHING:
        after[coordinates + numbers.body] = speed_after
    for i in range(phase):
        after[coordinates + i] -= shock.direction[i, 0] * change - shock.direction[i, 1] * fall
    rate = point[coordinates + phase] - (of_speed * change - of_rise * fall) / inertia
    after[coordinates + phase] = rate
    for k in range(size.signals):
        after[first_signal(size) + size.signals + k] = series[slope_row(k), 0] * rate
    if numbers.has_bearing:
        return 2 * state_after + (1 if rate < 0.0 else 0)
    return state_after
