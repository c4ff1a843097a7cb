"""The equations of docs/robot.md as heyoka expressions, with run-time parameters where a mode switches a term.

Positions are counted from the plates, d = u - E and d = w - H. Near its zero a double resolves d without limit, so that
a guard can be put on either side of zero by less than any rounding error. Time is counted from the last command.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import heyoka as hy

from benchmark.support import unsupported
from vibro_ros import Scene

#: Speed, in multiples of v_s, above which exp(-abs(x')/v_s) is less than 4e-18 and shows in no Taylor coefficient. A
#: step must end at this speed, because heyoka would otherwise step over the stop of the body that follows.
_FADED = 40.0
#: The first run-time parameters: they decide how the body moves (`Equations.body_parameters`).
BODY_PARAMETERS = ("slide", "direction", "mobility", "stick", "slip", "air")


class RunTimeParameters:
    """heyoka's run-time parameters by name; heyoka itself numbers them."""

    def __init__(self):
        # number of each parameter that has been asked for
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
    pull: hy.expression  # of spring and damper on the slider, outwards [N]
    slope: hy.expression  # of the slider's position by the crank angle [m]
    load: hy.expression  # force along the guide [N] without the body's acceleration, that of the plate included
    push: hy.expression  # k d + c d' of the plate [N]
    crank: hy.expression  # cosine of the crank angle from the guide, whose zeros are the slider's kinks


@dataclass(frozen=True)
class LinkagePart:
    """A mass that the crank moves along a fixed direction."""

    mass: float  # [kg]
    along: float  # part of the direction along x
    up: float  # part of the direction upwards
    slope: hy.expression  # first derivative of the position by the crank angle [m]
    bend: hy.expression  # second derivative [m]


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
        guard), `angle`, `speed` and `change` (of a motor that is given in time). Of a dc motor: `turns` (1, or 0 while
        the bearing sticks), `bearing` (direction in which friction is overcome), `held` (voltage or current), `within`
        (1, or 0 at a limit of the supply), `limit` (1 or -1, the limit that is met), `loop_offset` (added to a guard).
    guides : list of Guide
        The guides that have a mass.
    system : list of (expression, expression)
        Variables and their rates, for `heyoka.taylor_adaptive`: d, d' of each guide, then x, x' if the body can move,
        then y, y' if the body can leave the ground, then theta, theta' and, with an inductance, the current of a dc
        motor.
    body, height, crank : int
        Indices of x, y and theta in the state, if they are there.
    linkage : list of LinkagePart
        The masses of sliders and crank pin.
    has_rotor : bool
        Whether theta is in the state: with a dc motor.
    crank_is_struck : bool
        Whether a landing changes theta'.
    torque, wanted_voltage : expression
        Of a dc motor: K i + T [N m], and what a current loop would apply without limits [V].
    coupling : list of expression
        Momentum of the body along x and upwards from a unit of theta', and the crank's inertia [kg m, kg m, kg m²].
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
        For a parameter that the robot does not have (`benchmark.support`).
    """

    def __init__(self, scene: Scene):
        if fault := unsupported(scene, "heyoka_robot"):
            raise ValueError(f"scene {scene.name}: {fault}")
        if scene["effects.friction"] == "stribeck" and scene["effects.normal_force"] == "hop":
            raise ValueError(f"scene {scene.name}: effects.friction: 'stribeck' has no landing in the robot; give "
                             "'unilateral' for effects.normal_force")
        self.scene, self.parameters = scene, RunTimeParameters()
        self.has_rotor = scene["effects.motor"] == "dc"
        self._motor()
        tilt = {"upper": 0.0, "inclined": scene["guide.angle"]}
        sides = [side for side in tilt if scene[f"effects.{side}_mass"]]
        pin = scene["mass.crank_pin"]
        self.total = math.fsum([scene["mass.body"], pin, *(
            scene[f"mass.{side}{part}"] for side in sides for part in ("", "_slider"))])
        self.sine, self.cosine = math.sin(tilt["inclined"]), math.cos(tilt["inclined"])
        slope = scene["ground.slope"]
        self.downhill, self.down = scene["gravity"] * math.sin(slope), scene["gravity"] * math.cos(slope)
        self.pull = self.total * self.downhill + scene["ground.drag"]
        self.viscous = scene["ground.viscous_friction"]
        self.body_moves = "inclined" in sides and self.sine != 0.0 or slope != 0.0 or pin > 0.0 or any(
            scene[f"ground.{name}"] != 0.0 for name in ("drag", "viscous_friction"))
        law = scene["effects.friction"]
        forward, backward = scene["ground.friction"], scene["ground.friction_backward"]
        self.frictions = {1.0: forward, -1.0: backward if backward >= 0.0 else forward}
        static = scene["ground.static_friction"]
        self.static_frictions = {1.0: static, -1.0: static} if law in ("static", "stribeck") else self.frictions
        self.has_dry_friction = self.body_moves and law != "none" and max(self.static_frictions.values()) > 0.0
        self.rule = scene["effects.normal_force"]
        self.hops = self.rule == "hop" and bool(sides or pin)
        self.blow_share = scene["mass.inclined"] * self.sine / self.total if "inclined" in sides else 0.0
        self.linkage: list[LinkagePart] = []
        self.guides = [self._guide(side, tilt[side]) for side in sides]
        if pin > 0.0:
            sine, cosine = scene["crank.radius"] * hy.sin(self.theta), scene["crank.radius"] * hy.cos(self.theta)
            self.linkage += [LinkagePart(pin, 1.0, 0.0, -cosine, sine), LinkagePart(pin, 0.0, 1.0, -sine, -cosine)]
        self.body = 2 * len(self.guides)
        self.height = self.body + 2 * self.body_moves
        self.crank = self.height + 2 * self.hops
        self.crank_is_struck = bool(self.has_rotor and self.linkage and self.hops and scene["effects.reaction"])
        self._body()

    def _motor(self) -> None:
        """theta, its rate, and its acceleration; of a dc motor also the current, and what the current loop wants."""
        scene, at, t, lag = self.scene, self.parameters, hy.time, self.scene["motor.time_constant"]
        if self.has_rotor:
            self.theta, self.omega, self.current = hy.make_vars("theta", "theta_v", "current")
            self._winding()
            return
        extra = {"ideal": (0.0, 0.0, 0.0), "ramp": (0.5 * at["change"] * t * t, at["change"] * t, at["change"])}
        if scene["effects.motor"] == "lag":
            decay = hy.exp(-t / lag)
            extra["lag"] = (at["change"] * lag * (1.0 - decay), at["change"] * decay, -at["change"] / lag * decay)
        angle, speed, self._turning = extra[scene["effects.motor"]]
        self.theta, self.omega = at["angle"] + at["speed"] * t + angle, at["speed"] + speed

    def _winding(self) -> None:
        """L i' = V - R i - K theta'; without an inductance i follows from V, or is what the current loop holds."""
        scene, held, at = self.scene, self.parameters["held"], self.parameters
        self.constant = scene["motor.gear_ratio"] * scene["motor.torque_constant"]
        resistance, inductance = scene["motor.winding_resistance"], scene["motor.winding_inductance"]
        self.has_current_loop = scene["motor.control"] == "speed_by_current"
        supply, back = scene["motor.supply_voltage"] * at["limit"], self.constant * self.omega
        gain = inductance / scene["motor.current_time_constant"]
        current = self.current if inductance else held
        self.wanted_voltage = back + resistance * current + (gain * (held - current) if inductance else 0.0)
        voltage = (at["within"] * self.wanted_voltage + (1.0 - at["within"]) * supply if self.has_current_loop
                   else held)
        if inductance:
            self._current_rate = (voltage - resistance * self.current - back) / inductance
        else:
            self.current = (voltage - back) / resistance

    def _crank(self, body: tuple, felt: tuple) -> hy.expression:
        """theta'' [rad/s²] of a dc motor; sets `torque` and `coupling`.

        `body` has x'' and y'' [m/s²] for theta'' = 0, `felt` what a unit of theta'' adds to each.
        """
        scene, at = self.scene, self.parameters
        reaction, weighs = float(scene["effects.reaction"]), float(scene["effects.mass_weight"])
        inertia = scene["motor.gear_ratio"] ** 2 * scene["motor.rotor_inertia"] + scene["motor.crank_inertia"]
        crank_inertia, coupled, torque = hy.expression(inertia), hy.expression(0.0), self.constant * self.current
        for guide in self.guides:
            torque += guide.pull * guide.slope
        for part in self.linkage:
            torque -= part.mass * part.slope * (
                part.bend * self.omega * self.omega + reaction * (part.along * body[0] + part.up * body[1])
                + weighs * (part.along * self.downhill + part.up * self.down))
            crank_inertia += part.mass * part.slope * part.slope
            coupled += reaction * part.mass * part.slope * (part.along * felt[0] + part.up * felt[1])
        self.torque = torque
        self.coupling = [*(sum((getattr(part, way) * part.mass * part.slope for part in self.linkage),
                               hy.expression(0.0)) for way in ("along", "up")), crank_inertia]
        resisted = scene["motor.damping"] * self.omega + at["bearing"] * scene["motor.friction"]
        return at["turns"] * (torque - resisted) / (crank_inertia + coupled)

    def _guide(self, side: str, angle: float) -> Guide:
        scene, at = self.scene, self.parameters
        depth, rate = hy.make_vars(f"{side}_d", f"{side}_v")
        kind, rod, mass = scene[f"effects.{side}_contact"], scene[f"crank.{side}_rod"], scene[f"mass.{side}"]
        slider, slope, bend, crank = self._slider(side, rod, angle)
        if scene[f"mass.{side}_slider"] > 0.0:
            self.linkage.append(LinkagePart(scene[f"mass.{side}_slider"], -math.sin(angle), math.cos(angle), slope,
                                            bend))
        pull = scene[f"{side}.spring.stiffness"] * (depth + (self._plate(side) - slider))
        if scene[f"{side}.spring.damping"] > 0.0:
            pull += scene[f"{side}.spring.damping"] * (rate + at[f"{side}.plate_speed"] - slope * self.omega)
        load = -pull
        if scene["effects.mass_weight"]:
            load -= mass * (self.down * math.cos(angle) - self.downhill * math.sin(angle))
        spring, damper = scene[f"{side}.plate.stiffness"], scene[f"{side}.plate.damping"]
        if kind == "compliant":
            load -= at[f"{side}.spring"] * depth
            if damper > 0.0:
                load -= at[f"{side}.damper"] * rate
        return Guide(side, angle, mass, kind, rod, spring, damper, scene[f"{side}.plate.restitution"],
                     kind == "compliant" and damper > 0.0 and not scene["effects.adhesion"],
                     scene["crank.radius"] == rod, depth, rate, pull, slope, load, spring * depth + damper * rate,
                     crank)

    def _slider(self, side: str, rod: float, angle: float):
        """Slider position, its first and second derivative by the crank angle, and cos of the crank angle from the
        guide; eqs. (2), (3)."""
        radius = self.scene["crank.radius"]
        sine, cosine = hy.sin(self.theta - angle), hy.cos(self.theta - angle)
        if radius == rod:  # the root is rod |cos|, and a guard switches the sign of the cosine
            both = radius + self.parameters[f"{side}.sign"] * rod
            return both * cosine, -both * sine, -both * cosine, cosine
        root = hy.sqrt(rod * rod - radius * radius * sine * sine)
        slope = -radius * sine * (1.0 + radius * cosine / root)
        of_root = -radius * radius * sine * cosine / root
        bend = -radius * cosine - (radius * radius * (cosine * cosine - sine * sine) + of_root * of_root) / root
        return radius * cosine + root, slope, bend, cosine

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
        by_weight = self.rule == "weight"
        forces, coupling = self._linkage_forces()
        inward -= forces[0]
        if by_weight:
            ground, coupling[1] = self.normal, hy.expression(0.0)
        else:
            ground += forces[1]
            self.normal += self.cosine * misread
        slide = at["slide"]  # F_fr as a multiple of N while the body slips
        if self.scene["effects.friction"] == "stribeck":
            extra = self.static_frictions[1.0] - self.frictions[1.0]
            slide = slide + extra * at["direction"] * hy.exp(
                -at["direction"] * self.velocity / self.scene["ground.stribeck_speed"])
        feels = self.has_dry_friction or self.hops
        along, across, up = self.body_inertia({guide.side: self._unless_resting(guide, 1.0) for guide in self.guides})
        mobility = at["mobility"]
        if self.scene["effects.friction"] == "stribeck" and not by_weight:  # given for the kinetic coefficient
            mobility = mobility * ((along + at["slide"] * across) / (along + slide * across))
        along_x = mobility * (inward - (slide * ground if feels else 0.0))
        self.rise = (across * inward + along * ground) / (across**2 - along * up)
        felt = (mobility * (-coupling[0] - (slide * coupling[1] if feels else 0.0)),  # of a unit of theta''
                (along * coupling[1] - across * coupling[0]) / (across**2 - along * up))
        if self.has_rotor:
            moves, flies = float(self.body_moves), float(self.hops) * at["air"]
            self._turning = self._crank((moves * along_x, flies * self.rise), (moves * felt[0], flies * felt[1]))
        if self.linkage:
            along_x, self.rise = along_x + felt[0] * self._turning, self.rise + felt[1] * self._turning
            self.inertial -= forces[0] + coupling[0] * self._turning
            if not by_weight:
                self.normal += forces[1] + coupling[1] * self._turning
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
        if self.has_rotor:
            self.system += [(self.theta, self.omega), (self.omega, self._turning)]
            if self.scene["motor.winding_inductance"]:
                self.system.append((self.current, self._current_rate))

    def _linkage_forces(self) -> tuple[list, list]:
        """Sum of m e s'' of the linkage's masses for theta'' = 0 [N], and what a unit of theta'' adds [kg m]; each
        along x and upwards."""
        forces, coupling = [hy.expression(0.0)] * 2, [hy.expression(0.0)] * 2
        for part in self.linkage:
            for i, direction in enumerate((part.along, part.up)):
                if direction:
                    forces[i] += direction * part.mass * part.bend * self.omega * self.omega
                    coupling[i] += direction * part.mass * part.slope
        return forces, coupling

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

    def after_landing(self, speed: float, fall: float, resting: Collection[str], restitution: float,
                      coupling: tuple[float, float, float]) -> tuple[float, float, bool]:
        """x' and y' [m/s] after a landing at x' = `speed`, y' = `fall`, and whether the body sticks.

        The impulse P_y of the ground grows until y' = 0, and then by `restitution` times what it was. While the body
        slips forwards (1) or backwards (-1), P_x = -direction mu P_y. A body that stops meanwhile sticks, if friction
        can hold it, or slips the way in which the impulse drives it.

        Parameters
        ----------
        speed, fall : float
            Speeds before [m/s].
        resting : collection of str
            Guides whose masses are a part of the body.
        restitution : float
            Of the ground.
        coupling : (float, float, float)
            The values of `coupling`; the crank takes part in the shock.
        """
        along, across, up = self.body_inertia(dict.fromkeys(resting, 0.0))
        if self.crank_is_struck:
            of_x, of_y, inertia = coupling
            along, across, up = along - of_x**2 / inertia, across - of_x * of_y / inertia, up - of_y**2 / inertia
        way = -math.copysign(1.0, across)  # in which a body at rest is driven
        holds = self.has_dry_friction and abs(across) <= self.static_frictions[way] * up

        def changes(x: float) -> tuple[float, float]:
            """Of x' and y' by a unit of P_y."""
            if x == 0.0 and holds:
                return 0.0, 1.0 / up
            direction = math.copysign(1.0, x) if x else way
            push = -direction * self.frictions[direction] if self.has_dry_friction else 0.0
            area = along * up - across**2
            return (up * push - across) / area, (along - across * push) / area

        x, y, given = speed, fall, 0.0
        for rebounds in (False, True):
            left = restitution * given
            while True:
                of_x, of_y = changes(x)
                whole = left if rebounds else -y / of_y
                stop = -x / of_x if self.has_dry_friction and x * of_x < 0.0 else math.inf
                if stop >= whole:
                    break
                x, y, given, left = 0.0, y + of_y * stop, given + stop, left - stop
            x, y, given = x + of_x * whole, y + of_y * whole if rebounds else 0.0, given + whole
        return x, y, holds and x == 0.0

    def free_mass_jumps(self, along_x: float, upwards: float, not_free: Collection[str]) -> list[float]:
        """Jumps of each d' [m/s] when x' and y' jump by `along_x` and `upwards` [m/s]; 0 for the guides `not_free`."""
        felt = [self.scene["effects.reaction"] and guide.side not in not_free for guide in self.guides]
        jumps = [-upwards if guide.side == "upper" else self.sine * along_x - self.cosine * upwards
                 for guide in self.guides]
        return [jump if feels else 0.0 for jump, feels in zip(jumps, felt, strict=True)]

    def guards(self) -> dict[str, hy.expression]:
        """Expressions whose zeros end a mode, by name; a guard that a mode does not have is switched to a constant."""
        at, expressions = self.parameters, {}
        for guide in self.guides:
            side = guide.side
            if guide.kind == "compliant":
                expressions[f"{side} depth"] = guide.depth
            if guide.watches_force:
                watch = at[f"{side}.watch"]
                expressions[f"{side} force"] = watch * (guide.push + at[f"{side}.offset"]) + (1.0 - watch)
            if guide.kind == "restitution":
                free = at[f"{side}.free"]
                expressions[f"{side} plate"] = free * guide.depth - (1.0 - free) * self.forces[side]
            if guide.has_kink:
                expressions[f"{side} kink"] = guide.crank
        if self.has_dry_friction:
            stick, slip = at["stick"], at["slip"]
            forward, backward = (self.static_frictions[sign] * self.normal for sign in (1.0, -1.0))
            expressions["body forward"] = (stick * (forward - self.inertial) + slip * self.velocity
                                     + (1.0 - stick - slip))
            if self.scene["effects.friction"] == "stribeck":
                faded = at["direction"] * self.velocity - _FADED * self.scene["ground.stribeck_speed"]
                expressions["decay"] = slip * faded + (1.0 - slip)
            expressions["body backward"] = stick * (backward + self.inertial) + (1.0 - stick)
        if self.hops:
            expressions["normal"] = at["air"] * self.altitude + (1.0 - at["air"]) * (self.normal + at["normal_offset"])
        elif self.has_dry_friction and self.rule == "unilateral":
            expressions["normal"] = self.normal + at["normal_offset"]
        if self.has_rotor:
            expressions |= self._motor_guards()
        return expressions

    def _motor_guards(self) -> dict[str, hy.expression]:
        """Guards of the bearing and of the current loop."""
        at, scene, expressions = self.parameters, self.scene, {}
        if static := scene["motor.static_friction"]:
            turns = at["turns"]
            expressions["crank forward"] = turns * self.omega + (1.0 - turns) * (static - self.torque)
            expressions["crank backward"] = (1.0 - turns) * (static + self.torque) + turns
        if self.has_current_loop:
            within, supply = at["within"], scene["motor.supply_voltage"]
            expressions["upper limit"] = (within * (supply - self.wanted_voltage) + at["loop_offset"]
                                    + (1.0 - within) * (at["limit"] * self.wanted_voltage - supply))
            expressions["lower limit"] = within * (supply + self.wanted_voltage + at["loop_offset"]) + (1.0 - within)
        return expressions
