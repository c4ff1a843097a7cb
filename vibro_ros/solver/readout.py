"""The readout: fields of samples from the channels at sampled instants.

Most are linear forms of the channels. Power and torque are products of them: power = sum of drive force times the
slider's speed, torque = power / the crank's speed; where the crank stands or changes its direction, torque = sum of
drive force times ds/dtheta.
"""

import math

from vibro_ros.solver.elementary import atan, cos, sin
from vibro_ros.solver.typed import Indices, Indices2, Row, Rows, Rows3, entry
from vibro_ros.solver.vector import repeated, store, vector

_TURN = 2.0 * math.pi
# A smaller value, of a motion that has died away, is reported as zero: below 2e-308 doubles lose their digits.
_LEAST_VALUE = 1e-290
#: A crank that turns more slowly [rad/s] counts as standing: this is rounding of the fastest speed, and power over
#: speed is meaningless.
STANDING = 1e-11

#: Fields that are no linear forms, or that the readout reads or limits, in the order of `read_samples`'s `special`.
SPECIAL = ("time", "crank_angle", "motor_speed", "motor_power", "motor_torque", "normal_force", "motor_voltage",
           "motor_current", "electrical_power")
_TIME, _ANGLE, _SPEED, _POWER, _TORQUE, _NORMAL, _VOLTAGE, _CURRENT, _ELECTRICAL = range(len(SPECIAL))


@entry
def read_samples(linear: Indices, special: Indices, forms: Rows3, pressed_only: bool, drives: Indices2,
                 linkage: Indices2, slopes: Rows, times: Row, points: Rows, modes: Indices, phases: Rows,
                 form_values: Row, values: Rows) -> None:
    """Compute the values of all fields of samples at sampled instants.

    Parameters
    ----------
    linear : ndarray of int, shape (outputs,)
        The field of each of the leading `forms`.
    special : ndarray of int, shape (len(SPECIAL),)
        The fields that `SPECIAL` names.
    forms : ndarray, shape (m, channels, LENGTH)
        Linear forms in each mode, outputs and then forces on the linkage, by channel: one vector has the coefficients
        of all forms. So no branch depends on the channels that a form reads, which differ from mode to mode.
    pressed_only : bool
        Whether a negative normal force is reported as 0.
    drives : ndarray of int, shape (sliders, 2)
        The field of each slider's drive force, and the channel of its speed.
    linkage : ndarray of int, shape (linkage, 3)
        The row of each force that moves a mass of the linkage, the channel of the mass's speed, and its signal.
    slopes : ndarray, shape (signals, n)
        ds/dtheta [m/rad] of each signal where the crank stands.
    times : ndarray, shape (n,)
        Instants [s].
    points, modes, phases : ndarray, shapes (n, channels), (n,) and (n, 3)
        The samples, as `event_loop.advance` fills them in.
    form_values : ndarray, shape (LENGTH,)
        Overwritten.
    values : ndarray, shape (fields, n)
        Receives the values.
    """
    normal = special[_NORMAL]
    for k in range(len(times)):
        mode, speed, power, torque = modes[k], phases[k, 2], 0.0, 0.0
        sums = repeated(0.0)
        for channel in range(points.shape[1]):
            sums = sums + points[k, channel] * vector(forms[mode, channel])
        store(form_values, sums)
        for f in range(len(linear)):
            value = form_values[f]
            values[linear[f], k] = value if abs(value) >= _LEAST_VALUE else 0.0
        if pressed_only and values[normal, k] < 0.0:
            values[normal, k] = 0.0
        for drive in range(len(drives)):
            force = values[drives[drive, 0], k]
            power += force * points[k, drives[drive, 1]]
            torque += force * slopes[drive, k]
        for n in range(len(linkage)):
            force = form_values[linkage[n, 0]]
            power += force * points[k, linkage[n, 1]]
            torque += force * slopes[linkage[n, 2], k]
        values[special[_TIME], k] = times[k]
        values[special[_SPEED], k] = speed
        values[special[_ANGLE], k] = phases[k, 1] + _TURN * phases[k, 0]
        values[special[_POWER], k] = power
        values[special[_TORQUE], k] = torque if abs(speed) <= STANDING else power / speed
        values[special[_ELECTRICAL], k] = values[special[_VOLTAGE], k] * values[special[_CURRENT], k]


@entry
def rod_angle(guide: float, radius: float, rod: float, theta: float) -> float:
    """Return the angle [rad] of a rod in the frame of the crank at crank angle theta [rad], from z towards -x.

    The rod, of length L, leads from the pin, at radius l, to the slider on a guide at the angle `guide` [rad]. In the
    guide's frame the pin is at l (-sin psi, cos psi) and the slider on the z axis, so that the rod leans back by
    asin(l sin(psi) / L); psi is the crank's angle from the guide.
    """
    psi = theta - guide
    along = radius * cos(psi)
    root = math.sqrt((rod - radius) * (rod + radius) + along * along)
    return -psi - 2.0 * atan(radius * sin(psi) / (rod + root))  # asin(z), by half its angle


@entry
def write_turns(rods: Rows, theta: float, turns: Row) -> None:
    """Write y and w of the quaternions of the crank and of each rod at crank angle theta [rad].

    `rods` has the arguments of `rod_angle` before theta, shape (n, 3); `turns` has the shape (2 + 2 n,). All rotations
    are about y, from z towards -x.
    """
    for k in range(len(turns) // 2):
        angle = theta
        if k > 0:
            angle = rod_angle(rods[k - 1, 0], rods[k - 1, 1], rods[k - 1, 2], theta)
        turns[2 * k], turns[2 * k + 1] = -sin(0.5 * angle), cos(0.5 * angle)
