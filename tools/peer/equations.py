"""The equations of docs/robot.md as heyoka expressions, with run-time parameters where a mode switches a term.

Positions are counted from the plates, d = u - E and d = w - H. Near its zero a double resolves d without limit, so that
a guard can be put on either side of zero by less than any rounding error. Time is counted from the last command.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import heyoka as hy

from vibro_ros.model.scene import Scene
from vibro_ros.model.support import unsupported

#: Speed, in multiples of v_s, above which exp(-abs(x')/v_s) is less than 4e-18 and shows in no Taylor coefficient. A
#: step must end at this speed, because heyoka would otherwise step over the stop of the body that follows.
_FADED = 40.0
#: The first run-time parameters: they decide how the body moves (`Equations.body_parameters`).
BODY_PARAMETERS = ("slide", "direction", "mobility", "stick", "slip", "air")


class RunTimeParameters:
    """heyoka's run-time parameters by name; heyoka itself numbers them.

    Attributes
    ----------
    number : dict of str to int
        Number of each parameter that has been asked for.
    """

    def __init__(self):
        self.number = {name: number for number, name in enumerate(BODY_PARAMETERS)}

    def __getitem__(self, name: str) -> hy.expression:
        return hy.par[self.number.setdefault(name, len(self.number))]


@dataclass(frozen=True)
class Guide:
    """One mass on its guide."""

    side: str  # upper or inclined
    angle: float  # of the guide from the vertical [rad]
    mass: float  # [kg]
    kind: str  # of the contact: none, compliant or restitution
    rod: float  # length [m]
    plate_stiffness: float  # [N/m]
    plate_damping: float  # [N·s/m]
    restitution: float  # of a rigid plate, dimensionless
    watches_force: bool  # whether the plate lets go where its force is zero, instead of where the depth is zero
    has_kink: bool  # whether the slider's speed jumps, because crank and rod are equally long
    depth: hy.expression  # d [m]
    rate: hy.expression  # d' [m/s]
    load: hy.expression  # force along the guide [N] without the body's acceleration, that of the plate included
    push: hy.expression  # k d + c d' of the plate [N]
    crank: hy.expression  # cosine of the crank angle from the guide, whose zeros are the slider's kinks


class Equations:
    """Right-hand sides, ground forces and guards of one scene.

    Parameters
    ----------
    scene : Scene
        The scene, of which only parameters are read.

    Attributes
    ----------
    parameters : RunTimeParameters
        Run-time parameters: `<side>.spring`, `<side>.damper` (of a plate that acts, else 0), `<side>.free` (0 while the
        mass rests on a rigid plate, else 1), `<side>.plate`, `<side>.plate_speed`, `<side>.sign` (of the root with a
        kink), `<side>.watch` (1 while the plate's force is watched, else 0), `<side>.offset` (added to that force),
        `slide` (mu times direction), `direction` (1 or -1 of a body that slips, else 0), `mobility` (x'' per force; 0
        for a body that sticks), `stick`, `slip` and `air` (1 in that state, else 0), `normal_offset` (added to N as a
        guard), `angle`, `speed` and `change` (of the motor).
    guides : list of Guide
        The guides that have a mass.
    system : list of (expression, expression)
        Variables and their rates, for `heyoka.taylor_adaptive`: d, d' of each guide, then x, x' if the body can move,
        then y, y' if the body can leave the ground.
    body, height : int
        Indices of x and y in the state, if they are there.
    normal, inertial : expression
        N and all forces along the ground but dry friction [N], of a body on the ground.
    rise : expression
        y'' [m/s²] of a body in the air.
    forces : dict of str to expression
        Force along each guide [N] in the body's frame, which presses the mass on a rigid plate.
    frictions, static_frictions : dict of float to float
        Friction coefficients of a body that slips, and of one that sticks, forwards (1) and backwards (-1).
    pull, viscous : float
        Constant force against forward motion [N], of slope and drag, and the viscous resistance [N s/m].
    blow_share : float
        The ratio m3 sin(phi) / M: the part of a jump of w' by which a rigid blow changes x'.

    Raises
    ------
    ValueError
        For a parameter that the peer does not have (`model.support`).
    """

    def __init__(self, scene: Scene):
        if fault := unsupported(scene, "peer"):
            raise ValueError(f"scene {scene.name}: {fault}")
        self.scene, self.parameters = scene, RunTimeParameters()
        self._motor()
        tilt = {"upper": 0.0, "inclined": scene["guide.angle"]}
        sides = [side for side in tilt if scene[f"effects.{side}_mass"]]
        self.total = math.fsum([scene["mass.body"], *(scene[f"mass.{side}"] for side in sides)])
        self.sine, self.cosine = math.sin(tilt["inclined"]), math.cos(tilt["inclined"])
        slope = scene["ground.slope"]
        self.downhill, self.down = scene["gravity"] * math.sin(slope), scene["gravity"] * math.cos(slope)
        self.pull = self.total * self.downhill + scene["ground.drag"]
        self.viscous = scene["ground.viscous_friction"]
        self.body_moves = "inclined" in sides and self.sine != 0.0 or slope != 0.0 or any(
            scene[f"ground.{name}"] != 0.0 for name in ("drag", "viscous_friction"))
        law = scene["effects.friction"]
        forward, backward = scene["ground.friction"], scene["ground.friction_backward"]
        self.frictions = {1.0: forward, -1.0: backward if backward >= 0.0 else forward}
        static = scene["ground.static_friction"]
        self.static_frictions = {1.0: static, -1.0: static} if law in ("static", "stribeck") else self.frictions
        self.has_dry_friction = self.body_moves and law != "none" and max(self.static_frictions.values()) > 0.0
        self.rule = scene["effects.normal_force"]
        self.hops = self.rule == "hop" and bool(sides)
        self.blow_share = scene["mass.inclined"] * self.sine / self.total if "inclined" in sides else 0.0
        self.guides = [self._guide(side, tilt[side]) for side in sides]
        self.body = 2 * len(self.guides)
        self.height = self.body + 2 * self.body_moves
        self._body()

    def _motor(self) -> None:
        at, t, lag = self.parameters, hy.time, self.scene["motor.time_constant"]
        extra = {"ideal": (0.0, 0.0), "ramp": (0.5 * at["change"] * t * t, at["change"] * t)}
        if self.scene["effects.motor"] == "lag":
            decay = hy.exp(-t / lag)
            extra["lag"] = (at["change"] * lag * (1.0 - decay), at["change"] * decay)
        angle, speed = extra[self.scene["effects.motor"]]
        self.theta, self.omega = at["angle"] + at["speed"] * t + angle, at["speed"] + speed

    def _guide(self, side: str, angle: float) -> Guide:
        scene, at = self.scene, self.parameters
        depth, rate = hy.make_vars(f"{side}_d", f"{side}_v")
        kind, rod, mass = scene[f"effects.{side}_contact"], scene[f"crank.{side}_rod"], scene[f"mass.{side}"]
        slider, slope, crank = self._slider(side, rod, angle)
        load = -scene[f"{side}.spring.stiffness"] * (depth + (self._plate(side) - slider))
        if scene[f"{side}.spring.damping"] > 0.0:
            load -= scene[f"{side}.spring.damping"] * (rate + at[f"{side}.plate_speed"] - slope * self.omega)
        if scene["effects.mass_weight"]:
            load -= mass * (self.down * math.cos(angle) - self.downhill * math.sin(angle))
        spring, damper = scene[f"{side}.plate.stiffness"], scene[f"{side}.plate.damping"]
        if kind == "compliant":
            load -= at[f"{side}.spring"] * depth
            if damper > 0.0:
                load -= at[f"{side}.damper"] * rate
        return Guide(side, angle, mass, kind, rod, spring, damper, scene[f"{side}.plate.restitution"],
                     kind == "compliant" and damper > 0.0 and not scene["effects.adhesion"],
                     scene["crank.radius"] == rod, depth, rate, load, spring * depth + damper * rate, crank)

    def _slider(self, side: str, rod: float, angle: float):
        """Slider position, its slope by the crank angle, and cos of the crank angle from the guide; eqs. (2), (3)."""
        radius = self.scene["crank.radius"]
        sine, cosine = hy.sin(self.theta - angle), hy.cos(self.theta - angle)
        if radius == rod:  # the root is rod |cos|, and a guard switches the sign of the cosine
            both = radius + self.parameters[f"{side}.sign"] * rod
            return both * cosine, -both * sine, cosine
        root = hy.sqrt(rod * rod - radius * radius * sine * sine)
        return radius * cosine + root, -radius * sine * (1.0 + radius * cosine / root), cosine

    def _body(self) -> None:
        """Equations of the rows x, y, u, w of the mass matrix; on the ground y = 0, and row y gives N."""
        x, self.velocity = hy.make_vars("x", "x_v")
        others = hy.expression(-self.pull) - self.viscous * self.velocity
        self.normal, self.inertial = hy.expression(self.total * self.down), others
        inward, ground, at = others, self.normal, self.parameters
        share = {"upper": 0.0, "inclined": self.sine if self.body_moves else 0.0}
        upwards = {"upper": 1.0, "inclined": self.cosine}
        for guide in self.guides:
            load = self._unless_resting(guide, guide.load)
            inward += share[guide.side] * load
            ground += upwards[guide.side] * load
        misread = self.misread_load()
        inward, ground = inward + share["inclined"] * misread, ground + self.cosine * misread
        self.inertial += share["inclined"] * misread
        if self.rule == "weight":
            ground = self.normal
        else:
            self.normal += self.cosine * misread
        slide = at["slide"]  # F_fr as a multiple of N while the body slips
        if self.scene["effects.friction"] == "stribeck":
            extra = self.static_frictions[1.0] - self.frictions[1.0]
            slide = slide + extra * at["direction"] * hy.exp(
                -at["direction"] * self.velocity / self.scene["ground.stribeck_speed"])
        along, across, up = self.body_inertia({guide.side: self._unless_resting(guide, 1.0) for guide in self.guides})
        mobility = at["mobility"]
        if self.scene["effects.friction"] == "stribeck" and self.rule != "weight":  # given for the kinetic coefficient
            mobility = mobility * ((along + at["slide"] * across) / (along + slide * across))
        along_x = mobility * (inward - (slide * ground if self.has_dry_friction or self.hops else 0.0))
        self.rise = (across * inward + along * ground) / (across**2 - along * up)
        self.system, self.forces = [], {}
        for guide in self.guides:
            force = guide.load
            if self.scene["effects.reaction"] and share[guide.side]:
                force = force + guide.mass * self.sine * along_x
            if self.scene["effects.reaction"] and self.hops:
                force = force - guide.mass * upwards[guide.side] * at["air"] * self.rise
            inertia = self._unless_resting(guide, force)
            self.forces[guide.side] = force
            self.system += [(guide.depth, guide.rate), (guide.rate, inertia / guide.mass)]
            self.inertial += share[guide.side] * inertia
            if self.rule != "weight":
                self.normal += upwards[guide.side] * inertia
        if self.body_moves:
            self.system += [(x, self.velocity), (self.velocity, along_x)]
        if self.hops:
            self.altitude, climb = hy.make_vars("y", "y_v")
            self.system += [(self.altitude, climb), (climb, at["air"] * self.rise)]

    def misread_load(self) -> hy.expression | float:
        """What the paper's misprint adds to the inclined guide's load on the body [N]: -k1 (u - w) in contact."""
        if not self.scene["effects.misprint"]:
            return 0.0
        upper, inclined = (guide.depth + self._plate(guide.side) for guide in self.guides)
        return self.parameters["inclined.spring"] * (inclined - upper)

    def _plate(self, side: str) -> hy.expression:
        """Position of a plate [m]."""
        return self.parameters[f"{side}.plate"] + self.parameters[f"{side}.plate_speed"] * hy.time

    def _unless_resting(self, guide: Guide, force: hy.expression | float) -> hy.expression | float:
        """`force`, or 0 while the mass rests on a rigid plate and moves with the plate."""
        return self.parameters[f"{guide.side}.free"] * force if guide.kind == "restitution" else force

    def body_inertia(self, free: Mapping[str, hy.expression | float]) -> tuple:
        """M_xx, M_xy, M_yy [kg] of the body, from whose mass matrix the masses that feel the body move are eliminated.

        A mass whose `free` is 0 instead of 1 rests on a rigid plate and is a part of the body.
        """
        along, across, up = self.total, 0.0, self.total
        if self.scene["effects.reaction"]:
            for guide in self.guides:
                mass = free.get(guide.side, 1.0) * guide.mass
                if guide.side == "upper":
                    up -= mass
                else:
                    along -= mass * self.sine**2
                    across += mass * self.sine * self.cosine
                    up -= mass * self.cosine**2
        return along, across, up

    def body_parameters(self, state: str, resting: Collection[str]) -> tuple[float, ...]:
        """Values of `BODY_PARAMETERS` in a state of `body.Body`, with the masses of `resting` on rigid plates.

        In the air two parameters have another meaning, because x'' is as if the normal force that row y gives for
        y'' = 0 acted with the friction coefficient -M_xy / M_yy.
        """
        along, across, up = self.body_inertia(dict.fromkeys(resting, 0.0))
        if state == "stick":
            return 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
        if state == "airborne":
            return -across / up, 0.0, up / (along * up - across**2), 0.0, 0.0, 1.0
        direction = {"slip_forward": 1.0, "slip_backward": -1.0}.get(state, 0.0)
        slide = self.frictions[direction] * direction if direction else 0.0
        lift = 0.0 if self.rule == "weight" else slide * across
        return slide, direction, 1.0 / (along + lift), 0.0, abs(direction), 0.0

    def thrown_body_jumps(self, guide: Guide, change: float, resting: Collection[str]) -> tuple[float, float]:
        """Jumps of x' and y' [m/s] of a body that nothing holds when a blow changes d' of one mass by `change` [m/s].

        The body gains the momentum m e `change` that the mass loses along its guide. The mass itself and the masses of
        the guides `resting` count as parts of the body.
        """
        along, across, up = self.body_inertia(dict.fromkeys((guide.side, *resting), 0.0))
        lost = -guide.mass * change
        inward, upward = -lost * math.sin(guide.angle), lost * math.cos(guide.angle)
        area = along * up - across**2
        return (up * inward - across * upward) / area, (along * upward - across * inward) / area

    def speed_after_landing(self, speed: float, fall: float, resting: Collection[str]) -> tuple[float, bool]:
        """x' [m/s] after a landing at x' = `speed`, y' = `fall`, and whether the body sticks.

        While the body slips forwards (1) or backwards (-1), P_x = -direction mu P_y, where P_x and P_y follow from the
        changes of x' and y' by `body_inertia`. If the body stops, the rest of the fall meets a body at rest.
        """
        along, across, up = self.body_inertia(dict.fromkeys(resting, 0.0))
        def per_fall(direction: float) -> float:
            mu = self.frictions[direction] if self.has_dry_friction else 0.0
            return (across + direction * mu * up) / (along + direction * mu * across)

        after = speed
        if speed != 0.0:
            after = speed + per_fall(math.copysign(1.0, speed)) * fall
            if not self.has_dry_friction or after * speed > 0.0:
                return after, False
            fall *= after / (after - speed)
        if self.has_dry_friction and abs(across) <= self.static_frictions[-math.copysign(1.0, across)] * up:
            return 0.0, True
        return per_fall(-math.copysign(1.0, across)) * fall, False

    def free_mass_jumps(self, along_x: float, upwards: float, not_free: Collection[str]) -> list[float]:
        """Jumps of each d' [m/s] when x' and y' jump by `along_x` and `upwards` [m/s]; 0 for the guides `not_free`."""
        felt = [self.scene["effects.reaction"] and guide.side not in not_free for guide in self.guides]
        jumps = [-upwards if guide.side == "upper" else self.sine * along_x - self.cosine * upwards
                 for guide in self.guides]
        return [jump if feels else 0.0 for jump, feels in zip(jumps, felt, strict=True)]

    def guards(self) -> dict[str, hy.expression]:
        """Expressions whose zeros end a mode, by name; a guard that a mode does not have is switched to a constant."""
        at, found = self.parameters, {}
        for guide in self.guides:
            side = guide.side
            if guide.kind == "compliant":
                found[f"{side} depth"] = guide.depth
            if guide.watches_force:
                watch = at[f"{side}.watch"]
                found[f"{side} force"] = watch * (guide.push + at[f"{side}.offset"]) + (1.0 - watch)
            if guide.kind == "restitution":
                free = at[f"{side}.free"]
                found[f"{side} plate"] = free * guide.depth - (1.0 - free) * self.forces[side]
            if guide.has_kink:
                found[f"{side} kink"] = guide.crank
        if self.has_dry_friction:
            stick, slip = at["stick"], at["slip"]
            forward, backward = (self.static_frictions[sign] * self.normal for sign in (1.0, -1.0))
            found["body forward"] = (stick * (forward - self.inertial) + slip * self.velocity
                                     + (1.0 - stick - slip))
            if self.scene["effects.friction"] == "stribeck":
                faded = at["direction"] * self.velocity - _FADED * self.scene["ground.stribeck_speed"]
                found["decay"] = slip * faded + (1.0 - slip)
            found["body backward"] = stick * (backward + self.inertial) + (1.0 - stick)
        if self.hops:
            found["normal"] = at["air"] * self.altitude + (1.0 - at["air"]) * (self.normal + at["normal_offset"])
        elif self.has_dry_friction and self.rule == "unilateral":
            found["normal"] = self.normal + at["normal_offset"]
        return found
