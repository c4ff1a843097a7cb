"""The robot with a body that hops, integrated by SciPy from the full equations: shares no code with the package.

q = (x, y, u, w), A q'' = loads + ground forces (P, N) on x and y. Modes are told from the accelerations without the
ground and from the friction cone, contacts from penetrations; every event is a sign change of a guard.
"""

import numpy as np
from scipy.integrate import solve_ivp

AIR, STICK, FORWARD, BACKWARD = "air", "stick", "forward", "backward"
SIGN = {FORWARD: 1.0, BACKWARD: -1.0}


class HoppingBody:
    """A scene's machine, of its parameters. Dampers of plates may pull; no mass may rest on a rigid one."""

    def __init__(self, scene):
        self.p = scene
        m1, m2, m3 = (scene[f"mass.{part}"] for part in ("body", "upper", "inclined"))
        ex, ey = -np.sin(scene["guide.angle"]), np.cos(scene["guide.angle"])
        total = m1 + m2 + m3 + sum(scene[f"mass.{part}"] for part in ("upper_slider", "inclined_slider", "crank_pin"))
        self.inertia = np.array([[total, 0, 0, m3 * ex], [0, total, m2, m3 * ey],
                                 [0, m2, m2, 0], [m3 * ex, m3 * ey, 0, m3]])
        if not scene["effects.reaction"]:
            self.inertia[2:, :2] = 0.0
        self.inverse = np.linalg.inv(self.inertia)
        fall = -scene["gravity"] * np.array([np.sin(scene["ground.slope"]), np.cos(scene["ground.slope"])])
        weights = scene["effects.mass_weight"] * np.array([m2 * fall[1], m3 * np.dot((ex, ey), fall)])
        self.weight = np.array([*total * fall, *weights])
        self.weight[0] -= scene["ground.drag"]
        self.rigid = [scene[f"effects.{side}_contact"] == "restitution" for side in ("upper", "inclined")]
        self.friction = scene["ground.friction"] * (scene["effects.friction"] != "none")

    def slider(self, t, side):
        rate, angle = self.p["motor.speed"], self.p["guide.angle"] if side == "inclined" else 0.0
        radius, rod, theta = self.p["crank.radius"], self.p[f"crank.{side}_rod"], rate * t - angle
        root = np.sqrt(rod**2 - (radius * np.sin(theta)) ** 2)
        slope = -radius * np.sin(theta) - radius**2 * np.sin(theta) * np.cos(theta) / root
        return radius * np.cos(theta) + root, rate * slope

    def linkage(self, t):
        """Inertia of sliders and crank pin in the body's frame [N], along x and upwards, at a steady motor speed."""
        p, rate, radius = self.p, self.p["motor.speed"], self.p["crank.radius"]
        theta = rate * t
        force = -p["mass.crank_pin"] * radius * rate**2 * np.array([-np.sin(theta), np.cos(theta)])
        for side, angle in (("upper", 0.0), ("inclined", p["guide.angle"])):
            sine, cosine = np.sin(theta - angle), np.cos(theta - angle)
            root = np.sqrt(p[f"crank.{side}_rod"] ** 2 - (radius * sine) ** 2)
            bend = -radius * cosine - radius**2 * (cosine**2 - sine**2) / root
            bend -= (radius**2 * sine * cosine) ** 2 / root**3
            force += p[f"mass.{side}_slider"] * rate**2 * bend * np.array([-np.sin(angle), np.cos(angle)])
        return force

    def depth(self, z, i, side):
        return z[2 + i] - self.p[f"crank.{side}_rod"] - self.p[f"{side}.gap"]

    def accelerations(self, t, z, mode, closed):
        """q'' and the ground's forces."""
        loads = self.weight.copy()
        loads[:2] -= self.linkage(t)
        loads[0] -= self.p["ground.viscous_friction"] * z[4]
        for i, side in enumerate(("upper", "inclined")):
            s, rate = self.slider(t, side)
            loads[2 + i] -= self.p[f"{side}.spring.stiffness"] * (z[2 + i] - s)
            loads[2 + i] -= self.p[f"{side}.spring.damping"] * (z[6 + i] - rate)
            if closed[i]:
                loads[2 + i] -= self.p[f"{side}.plate.stiffness"] * self.depth(z, i, side)
                loads[2 + i] -= self.p[f"{side}.plate.damping"] * z[6 + i]
        # Rows x and y of the paper's equations have no drive or plate forces: these are inner forces of the whole.
        free = self.inverse @ loads
        ground = np.zeros(2)
        if mode == STICK:
            ground = -np.linalg.solve(self.inverse[:2, :2], free[:2])
        elif mode != AIR:
            direction = np.array([-SIGN[mode] * self.friction, 1.0])
            ground = -free[1] / (self.inverse[1, :2] @ direction) * direction
        return free + self.inverse[:, :2] @ ground, ground

    def ground_mode(self, t, z, closed):
        """Mode of a body on the ground that neither rises nor falls."""
        if self.accelerations(t, z, AIR, closed)[0][1] > 0.0:
            return AIR
        if z[4] != 0.0:
            return FORWARD if z[4] > 0.0 else BACKWARD
        _, (along, normal) = self.accelerations(t, z, STICK, closed)
        if abs(along) <= self.friction * normal:
            return STICK
        return FORWARD if along < 0.0 else BACKWARD  # the ground's pull is not enough to hold it back

    def land(self, z):
        """Velocities after the shock: at rest on the ground if the cone allows the impulse, else slipping on."""
        impulse = np.linalg.solve(self.inverse[:2, :2], -z[4:6])
        stops = abs(impulse[0]) <= self.friction * impulse[1]
        if not stops:
            direction = np.array([-np.sign(z[4]) * self.friction, 1.0])
            impulse = -z[5] / (self.inverse[1, :2] @ direction) * direction
        z[4:] += self.inverse[:, :2] @ impulse
        z[[1, 5]] = 0.0
        if stops:
            z[4] = 0.0

    def strike(self, z, i):
        """Velocities after a blow on a rigid plate: an impulse between mass i and the body; the ground gives none."""
        restitution = self.p[f"{('upper', 'inclined')[i]}.plate.restitution"]
        z[4:] -= (1.0 + restitution) * z[6 + i] / self.inverse[2 + i, 2 + i] * self.inverse[:, 2 + i]

    def guards(self, mode, closed):
        sign = [1.0 if on else -1.0 for on in closed]
        guards = [lambda t, z: sign[0] * self.depth(z, 0, "upper"), lambda t, z: sign[1] * self.depth(z, 1, "inclined")]
        if mode == AIR:
            return [*guards, lambda t, z: z[1]]
        guards.append(lambda t, z: self.accelerations(t, z, mode, closed)[1][1])
        if mode == STICK:
            for side in (1.0, -1.0):
                guards.append(lambda t, z, side=side: np.array([side, self.friction]) @ self.accelerations(
                    t, z, STICK, closed)[1])
        else:
            guards.append(lambda t, z: SIGN[mode] * z[4])
        return guards

    def run(self, times, step):
        """Positions and velocities at `times`, shape (8, n), and every lift-off and landing as (instant, kind)."""
        z = np.array([0, 0, *(self.slider(0.0, side)[0] for side in ("upper", "inclined")), 0, 0, 0, 0], dtype=float)
        t, closed = 0.0, [False, False]
        for i, side in enumerate(("upper", "inclined")):
            closed[i] = self.depth(z, i, side) > 0.0  # then it starts on the plate, pressed by its spring
            z[2 + i] -= max(0.0, self.depth(z, i, side))
        mode, samples, jumps = self.ground_mode(t, z, closed), [], []
        while True:
            guards = self.guards(mode, closed)
            for guard in guards:
                guard.terminal, guard.direction = True, -1.0
            flow = solve_ivp(lambda t, z, now=(mode, closed): np.append(z[4:], self.accelerations(t, z, *now)[0]),
                             (t, times[-1]), z, "DOP853", times[len(samples):], events=guards, rtol=1e-12, atol=1e-14,
                             max_step=step)
            samples += list(np.transpose(flow.y))
            if flow.status == 0:
                return np.array(samples).T, jumps
            [fired] = [k for k, instants in enumerate(flow.t_events) if len(instants)]
            t, z = flow.t_events[fired][0], flow.y_events[fired][0].copy()
            before = mode
            if fired < 2 and self.rigid[fired]:
                self.strike(z, fired)
                mode = AIR
            elif fired < 2:
                closed = [on != (k == fired) for k, on in enumerate(closed)]
                mode = mode if mode == AIR else self.ground_mode(t, z, closed)
            elif mode == AIR:
                self.land(z)
                mode = self.ground_mode(t, z, closed)
            elif fired == 2:
                mode = AIR
            elif mode == STICK:
                mode = (FORWARD, BACKWARD)[fired - 3]
            else:
                z[4] = 0.0
                mode = self.ground_mode(t, z, closed)
            if before == AIR and fired == 2:
                jumps.append((t, "landing"))
            if mode == AIR and (before != AIR or fired == 2):
                jumps.append((t, "lift_off"))
