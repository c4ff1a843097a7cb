"""A landing, by steps of the impulse: shares no formula with the package."""

import math

import numpy as np


def struck(inertia, speed, fall, friction, static, restitution):
    """x' and y' after a landing, by Routh's method in small steps of the impulse P_y: no formula of the model.

    The body's velocity changes by A^-1 (P_x, P_y). A body that slips forwards gets P_x = -mu P_y, and so on; at a
    stop the friction that holds it decides.
    """
    inverse, velocity, given, end = np.linalg.inv(inertia), np.array([speed, -fall]), 0.0, math.inf
    hold = -inverse[0, 1] / inverse[0, 0]  # P_x for each P_y by which x' does not change
    while given < end:
        direction = np.sign(velocity[0])
        if direction == 0.0:
            pushed = -np.sign(hold)  # where x' would go without friction
            sticks = abs(hold) <= static[0 if pushed > 0.0 else 1]
            along = hold if sticks else -pushed * friction[0 if pushed > 0.0 else 1]
        else:
            along = -direction * friction[0 if direction > 0.0 else 1]
        change = inverse @ (along, 1.0)
        steps = [fall * 1e3 if end == math.inf else end - given]
        if change[0] * direction < 0.0:
            steps.append(-velocity[0] / change[0])
        if velocity[1] < 0.0:
            steps.append(-velocity[1] / change[1])
        step = min(steps)
        velocity_before, velocity, given = velocity, velocity + step * change, given + step
        if direction and velocity[0] * direction <= 1e-15 * abs(speed):
            velocity[0] = 0.0
        if velocity_before[1] < 0.0 <= velocity[1] + 1e-15 * fall:
            velocity[1], end = 0.0, (1.0 + restitution) * given
    return velocity
