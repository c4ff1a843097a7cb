"""An independent solution of the paper's equations with Stribeck's friction: scipy's DOP853, stopped at every event.

It shares no code with the package: the right-hand side is written out anew, in plain numbers.
"""

from math import copysign, cos, exp, sin, sqrt

import numpy as np
from scipy.integrate import solve_ivp

#: Longest steps [s], in contact and without: a tenth of a contact, so that no two crossings hide in a step.
_STEPS = (3e-5, 3e-4)
SIDES = ("upper", "inclined")


class Machine:
    """u, w, x and their speeds, in this order; friction is -1, 1 (slipping), 0 (sticking) or None (not pressed)."""

    def __init__(self, scene):
        value = scene.parameters
        self.rule, self.gravity, self.phi = value["effects.normal_force"], value["gravity"], value["guide.angle"]
        self.masses = [value[f"mass.{side}"] for side in SIDES]
        self.total = value["mass.body"] + sum(self.masses)
        self.speed, self.radius = value["motor.speed"], value["crank.radius"]
        self.rods = [value[f"crank.{side}_rod"] for side in SIDES]
        self.plates = [value[f"crank.{side}_rod"] + value[f"{side}.gap"] for side in SIDES]
        self.drive, self.plate = ([(value[f"{side}.{part}.stiffness"], value[f"{side}.{part}.damping"])
                                   for side in SIDES] for part in ("spring", "plate"))
        self.kinetic, self.static = value["ground.friction"], value["ground.static_friction"]
        self.decay = value["ground.stribeck_speed"]

    def slider(self, i, t):
        angle = self.speed * t - (0.0, self.phi)[i]
        root = sqrt(self.rods[i] ** 2 - (self.radius * sin(angle)) ** 2)
        rate = -self.radius * sin(angle) * (1.0 + self.radius * cos(angle) / root) * self.speed
        return self.radius * cos(angle) + root, rate

    def guide_force(self, i, t, y, closed):
        place, rate = self.slider(i, t)
        force = self.drive[i][0] * (y[i] - place) + self.drive[i][1] * (y[3 + i] - rate)
        if closed[i]:
            force += self.plate[i][0] * (y[i] - self.plates[i]) + self.plate[i][1] * y[3 + i]
        return force

    def loads(self, t, y, closed):
        """F2, F3, N and F_in."""
        upper, inclined = self.guide_force(0, t, y, closed), self.guide_force(1, t, y, closed)
        pressed = self.total * self.gravity
        if self.rule != "weight":
            pressed -= upper + inclined * cos(self.phi)
        return upper, inclined, pressed, -inclined * sin(self.phi)

    def rate(self, t, y, closed, friction):
        upper, inclined, pressed, pull = self.loads(t, y, closed)
        resisting = pull if friction == 0 else self.slipping_force(y[5], pressed, friction)
        return y[3], y[4], y[5], -upper / self.masses[0], -inclined / self.masses[1], (pull - resisting) / self.total

    def slipping_force(self, speed, pressed, friction):
        coefficient = self.kinetic + (self.static - self.kinetic) * exp(-abs(speed) / self.decay)
        return coefficient * pressed * (friction or 0)

    def friction_force(self, t, y, closed, friction):
        _, _, pressed, pull = self.loads(t, y, closed)
        return pull if friction == 0 else self.slipping_force(y[5], pressed, friction)

    def settled(self, t, y, closed):
        """The state of the friction by eq. (5) at a point that is on none of its bounds."""
        _, _, pressed, pull = self.loads(t, y, closed)
        if pressed < 0.0 and self.rule == "unilateral":
            return None
        if y[5] == 0.0 and abs(pull) <= self.static * pressed:
            return 0
        return int(copysign(1.0, y[5] if y[5] else pull))

    def conditions(self, closed, friction):
        """What ends the state: its name, the function that passes zero, and in which direction."""
        for i in range(2):
            yield i, (lambda t, y, i=i: y[i] - self.plates[i]), -1 if closed[i] else 1
        if friction == 0:
            for name, sign in (("forward", 1), ("backward", -1)):
                def bound(t, y, sign=sign):
                    _, _, pressed, pull = self.loads(t, y, closed)
                    return self.static * pressed - sign * pull
                yield name, bound, -1
        elif friction is not None:
            yield "stop", (lambda t, y: friction * y[5]), -1
        if self.rule == "unilateral":
            yield "pressure", (lambda t, y: self.loads(t, y, closed)[2]), 1 if friction is None else -1

    def after(self, name, t, y, closed, friction):
        """The state of the friction after the condition `name`; only a contact, whose damper may pull, can be any."""
        if name == "pressure":
            return int(copysign(1.0, y[5])) if friction is None else None
        return {"forward": 1, "backward": -1}.get(name) or self.settled(t, y, closed)


def _event(function, direction):
    def event(t, y, *_):
        return function(t, y)
    event.terminal, event.direction = True, direction
    return event


def solve(scene, start, times, tolerance):
    """Rows of y and F_fr at `times`, and the instants and new states of the friction's changes.

    Parameters
    ----------
    scene : Scene
        Without reaction, weight of the masses or moving plates.
    start : sequence of float
        u, w, x and their speeds, masses off their plates.
    times : ndarray, shape (n,)
        Instants [s], ascending from 0.
    tolerance : float
        Relative one of a step; a thousandth of it, in m and m/s, is the absolute one.
    """
    machine = Machine(scene)
    t, y, closed, rows, forces, changes = 0.0, np.array(start, dtype=float), [False, False], [], [], []
    friction = machine.settled(t, y, closed)
    while t < times[-1]:
        conditions = list(machine.conditions(closed, friction))
        part = solve_ivp(machine.rate, (t, times[-1]), y, method="DOP853", args=(closed, friction), dense_output=True,
                         events=[_event(*of) for _, *of in conditions], rtol=tolerance, atol=1e-3 * tolerance,
                         max_step=_STEPS[not any(closed)])
        assert part.success
        for at in times[(times >= t) & ((times < part.t[-1]) | (part.t[-1] == times[-1]))]:
            rows.append(part.sol(at))
            forces.append(machine.friction_force(at, rows[-1], closed, friction))
        t, y = part.t[-1], part.y[:, -1].copy()
        for (name, _, _), found in zip(conditions, part.t_events, strict=True):
            if len(found):
                before = friction
                if name in (0, 1):
                    closed[name] = not closed[name]
                if name == "stop":
                    y[5] = 0.0
                friction = machine.after(name, t, y, closed, friction)
                if friction != before:
                    changes.append((t, friction))
    return np.array(rows), np.array(forces), changes
