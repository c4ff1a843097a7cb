"""All forces of the device, from the equations of docs/robot.md and a state: no code of the solver or of heyoka.

The unknowns are x'', y'', u'', w'', N, F_fr, what a mass presses with on a rigid plate that it rests on, P2 and P3, and
theta'', in the four rows of the mass matrix, one law each for ground, friction and plates, and the row of the crank, a
linear system for each instant. A dc motor's current, and theta'' of another motor, belong to the state.
"""

from dataclasses import dataclass

import numpy as np

SIDES = ("upper", "inclined")
X, Y, U, W, NORMAL, FRICTION, PRESS, _, CRANK = range(9)


@dataclass(frozen=True)
class SampledMotion:
    """A scene's state at n instants: arrays of shape (n,) by the names of `Samples`."""

    scene: object
    at: dict

    def __len__(self):
        return len(self.at["crank_angle"])

    def has(self, side):
        return self.scene[f"effects.{side}_mass"]

    def tilt(self, side):
        return self.scene["guide.angle"] if side == "inclined" else 0.0

    def slider(self, side):
        """s, by eqs. (2) and (3), and ds/dθ [m, m/rad]."""
        angle, radius = self.at["crank_angle"] - self.tilt(side), self.scene["crank.radius"]
        rod = self.scene[f"crank.{side}_rod"]
        sine, cosine = np.sin(angle), np.cos(angle)
        if radius == rod:
            return radius * (cosine + np.abs(cosine)), -radius * sine * (1.0 + np.sign(cosine))
        root = np.sqrt(rod**2 - (radius * sine) ** 2)
        return radius * cosine + root, -radius * sine * (1.0 + radius * cosine / root)

    def bend(self, side):
        """d²s/dθ² [m]."""
        angle, radius = self.at["crank_angle"] - self.tilt(side), self.scene["crank.radius"]
        sine, cosine = np.sin(angle), np.cos(angle)
        root = np.sqrt(self.scene[f"crank.{side}_rod"] ** 2 - (radius * sine) ** 2)
        return (-radius * cosine - radius**2 * (cosine**2 - sine**2) / root
                - radius**4 * (sine * cosine) ** 2 / root**3)

    def linkage(self):
        """Return the masses that the crank moves: mass, direction, and first and second derivative of the position by
        the angle.
        """
        scene, angle, radius = self.scene, self.at["crank_angle"], self.scene["crank.radius"]
        for side in SIDES:
            if self.has(side) and scene[f"mass.{side}_slider"]:
                yield (scene[f"mass.{side}_slider"], (-np.sin(self.tilt(side)), np.cos(self.tilt(side))),
                       self.slider(side)[1], self.bend(side))
        if pin := scene["mass.crank_pin"]:
            yield pin, (1.0, 0.0), -radius * np.cos(angle), radius * np.sin(angle)
            yield pin, (0.0, 1.0), -radius * np.sin(angle), -radius * np.cos(angle)

    def drive(self, side):
        """Force of spring and damper on the mass, outwards."""
        if not self.has(side):
            return np.zeros(len(self))
        place, slope = self.slider(side)
        stretch = self.at[f"{side}_position"] - place
        rate = self.at[f"{side}_velocity"] - slope * self.at["motor_speed"]
        return -self.scene[f"{side}.spring.stiffness"] * stretch - self.scene[f"{side}.spring.damping"] * rate

    def depth(self, side):
        """u - E and its rate."""
        return tuple(self.at[f"{side}_{name}"] - self.at[f"{side}_plate_{name}"] for name in ("position", "velocity"))

    def push(self, side):
        """Compliant plate's force, compression positive."""
        if not self.has(side) or self.scene[f"effects.{side}_contact"] != "compliant":
            return np.zeros(len(self))
        depth, rate = self.depth(side)
        force = self.scene[f"{side}.plate.stiffness"] * depth + self.scene[f"{side}.plate.damping"] * rate
        return np.where((depth >= 0.0) & ((force >= 0.0) | self.scene["effects.adhesion"]), force, 0.0)

    def moves_with_plate(self, side):
        """Whether the mass rests on a rigid plate, so that it moves with the plate bit for bit and is pressed on it."""
        if not self.has(side) or self.scene[f"effects.{side}_contact"] != "restitution":
            return np.zeros(len(self), dtype=bool)
        depth, rate = self.depth(side)
        return (rate == 0.0) & (np.abs(depth) < 1e-15)

    def forces(self):
        """Every force [N], the motor's power [W] and torque [N m], by their names in `Samples`."""
        forces, torque = {}, np.zeros(len(self))
        solution = self._ground()
        for i, side in enumerate(SIDES):
            forces[f"{side}_drive_force"] = self.drive(side)
            forces[f"{side}_plate_force"] = self.push(side) + solution[:, PRESS + i]
            torque += self.drive(side) * self.slider(side)[1]
        torque += self._linkage_torque() + np.sum(self._torque_rows() * solution, axis=1)
        normal = solution[:, NORMAL]
        forces["normal_force"] = np.maximum(normal, 0.0) if self._rule == "unilateral" else normal
        forces["friction_force"] = solution[:, FRICTION]
        return forces | {"motor_torque": torque, "motor_power": torque * self.at["motor_speed"]}

    def _linkage_torque(self):
        """Torque [N m] that moves the linkage's masses while x'', y'' and theta'' are 0."""
        scene = self.scene
        gravity = scene["effects.mass_weight"] * scene["gravity"] * np.array(
            [np.sin(scene["ground.slope"]), np.cos(scene["ground.slope"])])
        square = self.at["motor_speed"] ** 2
        return np.zeros(len(self)) + sum(mass * slope * (bend * square + np.dot(direction, gravity))
                                         for mass, direction, slope, bend in self.linkage())

    def _torque_rows(self):
        """Return the contributions of the unknowns to the linkage's torque, shape (n, 9)."""
        rows, acts = np.zeros((len(self), 9)), self.scene["effects.reaction"]
        for mass, direction, slope, _ in self.linkage():
            rows[:, CRANK] += mass * slope**2
            for unknown, part in ((X, direction[0]), (Y, direction[1])):
                rows[:, unknown] += acts * mass * slope * part
        return rows

    @property
    def _rule(self):
        return self.scene["effects.normal_force"]

    def _ground(self):
        """Solve for the unknowns: a body at rest first as if it stuck, then slipping if friction cannot hold it, then
        unloaded.
        """
        scene, law = self.scene, self.scene["effects.friction"]
        moves = self.has("inclined") and np.sin(self.tilt("inclined")) != 0.0 or scene["mass.crank_pin"] or any(
            scene[f"ground.{name}"] for name in ("slope", "drag", "viscous_friction"))
        air = (self._rule == "hop") & ((self.at["body_height"] != 0.0) | (self.at["body_vertical_velocity"] != 0.0))
        if law == "none" or not moves:
            return self._solve(air, np.zeros(len(self), dtype=bool), np.zeros(len(self)))
        speed = self.at["body_velocity"]
        kinetic, static = self._frictions(speed)
        falling = (static - kinetic) * np.exp(-np.abs(speed) / scene["ground.stribeck_speed"]) * (law == "stribeck")
        slide, sticks = np.where(air, 0.0, np.sign(speed) * (kinetic + falling)), (speed == 0.0) & ~air
        solution = self._solve(air, sticks, slide)
        kinetic, static = self._frictions(np.where(speed == 0.0, solution[:, FRICTION], speed))
        breaks = sticks & (np.abs(solution[:, FRICTION]) > static * solution[:, NORMAL] * (1 + 1e-12) + 1e-12)
        at_first = static if law == "stribeck" else kinetic
        slide = np.where(breaks, np.sign(solution[:, FRICTION]) * at_first, slide)
        solution = self._solve(air, sticks & ~breaks, slide)
        if self._rule == "unilateral":
            loose = solution[:, NORMAL] < 0.0
            solution = self._solve(air, sticks & ~breaks & ~loose, np.where(loose, 0.0, slide))
        return solution

    def _frictions(self, direction):
        """Return the friction coefficients of a slipping and of a sticking body, in the directions of the signs of
        `direction`.
        """
        forward, backward = self.scene["ground.friction"], self.scene["ground.friction_backward"]
        kinetic = np.where(direction < 0.0, forward if backward == -1.0 else backward, forward)
        has_static = self.scene["effects.friction"] in ("static", "stribeck")
        return kinetic, np.full(len(self), self.scene["ground.static_friction"]) if has_static else kinetic

    def _solve(self, air, sticks, slide):
        """Solve with F_fr = `slide` N where the body does not stick; a mass that its rigid plate would have to pull is
        set free.
        """
        resting = [self.moves_with_plate(side) for side in SIDES]
        solution = self._solve_resting(air, sticks, slide, resting)
        pulled = [rests & (solution[:, PRESS + i] < 0.0) for i, rests in enumerate(resting)]
        if not np.any(pulled):
            return solution
        return self._solve_resting(air, sticks, slide, np.array(resting) & ~np.array(pulled))

    def _solve_resting(self, air, sticks, slide, resting):
        """Solve with the masses `resting` on their rigid plates; returns the unknowns, shape (n, 9)."""
        rows, known = np.zeros((len(self), 9, 9)), np.zeros((len(self), 9))
        self._fill_body_rows(rows, known)
        for i, side in enumerate(SIDES):
            self._fill_guide_rows(rows, known, i, side, resting[i])
        for mass, direction, slope, bend in self.linkage():
            for row, part in ((X, direction[0]), (Y, direction[1] * (self._rule != "weight"))):
                rows[:, row, CRANK] += part * mass * slope
                known[:, row] -= part * mass * bend * self.at["motor_speed"] ** 2
        rows[:, CRANK, CRANK], known[:, CRANK] = 1.0, self.at["given_acceleration"]
        if self.scene["effects.motor"] == "dc":
            self._fill_crank_row(rows[:, CRANK], known[:, CRANK])
        rows[:, NORMAL, NORMAL], rows[:, NORMAL, Y] = air, ~air
        rows[:, FRICTION, X] = sticks
        rows[:, FRICTION, FRICTION] = ~sticks
        rows[:, FRICTION, NORMAL] = np.where(sticks, 0.0, -slide)
        return np.linalg.solve(rows, known[..., None])[..., 0]

    def _fill_body_rows(self, rows, known):
        """The rows of x'' and y'', without what the masses add."""
        scene, slope = self.scene, self.scene["ground.slope"]
        total = scene["mass.body"] + scene["mass.crank_pin"] + sum(
            scene[f"mass.{part}"] * self.has(side) for side in SIDES for part in (side, f"{side}_slider"))
        rows[:, X, X] = rows[:, Y, Y] = total
        rows[:, X, FRICTION], rows[:, Y, NORMAL] = 1.0, -1.0
        known[:, Y] = -total * scene["gravity"] * np.cos(slope)
        known[:, X] = -total * scene["gravity"] * np.sin(slope) - scene["ground.drag"]
        known[:, X] -= scene["ground.viscous_friction"] * self.at["body_velocity"]
        if scene["effects.misprint"]:  # k1 (u - w) by which the printed force on the body differs from F3
            misread = np.where(self.push("inclined") != 0.0, scene["inclined.plate.stiffness"] * (
                self.at["upper_position"] - self.at["inclined_position"]), 0.0)
            known[:, X] -= np.sin(self.tilt("inclined")) * misread
            known[:, Y] += np.cos(self.tilt("inclined")) * misread * (self._rule != "weight")

    def _fill_guide_rows(self, rows, known, i, side, rests):
        """The rows of a mass and of the force on its rigid plate, and what the mass adds to the rows of the body."""
        scene, force, slope = self.scene, PRESS + i, self.scene["ground.slope"]
        acts, mass = float(scene["effects.reaction"]), scene[f"mass.{side}"] * self.has(side)
        across, up = -np.sin(self.tilt(side)), np.cos(self.tilt(side))
        rows[:, X, U + i], rows[:, Y, U + i] = mass * across, mass * up * (self._rule != "weight")
        rows[:, U + i, U + i] = mass if mass else 1.0
        rows[:, U + i, X], rows[:, U + i, Y] = acts * mass * across, acts * mass * up
        rows[:, U + i, force] = 1.0
        weight = scene["effects.mass_weight"] * mass * scene["gravity"]
        known[:, U + i] = self.drive(side) - self.push(side) - weight * (np.cos(slope) * up + np.sin(slope) * across)
        rows[:, force, U + i], rows[:, force, force] = rests, ~rests

    def _fill_crank_row(self, row, known):
        """The row of a dc motor's crank: J theta'' and the torques, or theta'' = 0 while the bearing is stuck."""
        scene, speed = self.scene, self.at["motor_speed"]
        ratio = scene["motor.gear_ratio"]
        turns = (speed != 0.0) | (scene["motor.static_friction"] == 0.0)
        row[:] = self._torque_rows()
        row[:, CRANK] += ratio**2 * scene["motor.rotor_inertia"] + scene["motor.crank_inertia"]
        known[:] = (ratio * scene["motor.torque_constant"] * self.at["motor_current"] - scene["motor.damping"] * speed
                    - scene["motor.friction"] * np.sign(speed) - self._linkage_torque()
                    - sum(self.drive(side) * self.slider(side)[1] for side in SIDES))
        row[~turns], known[~turns] = np.eye(9)[CRANK], 0.0
