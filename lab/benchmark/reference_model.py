"""The robot's equations, integrated by Taylor series in 60-digit arithmetic: the reference of benchmark and tests.

Written from the equations of docs/robot.md and the paper alone, without code of vibro_ros. Every step expands the
crank, both masses, the forces and the body in powers of time. Which mode holds after an instant
(contact, normal force, stick or slip) is decided afresh at every step by the sign of the first
power that does not vanish, so an exact graze, as in the start at rest on a plate, needs no rule.
By the rule `hop` the body leaves the ground where N would be negative, and lands by Routh's law; only a body without
friction and reaction bounces.
"""

from dataclasses import dataclass, field

from flint import arb, arb_series, ctx

from benchmark.first_crossing import first_crossing, leading

SPEED_IS_ZERO = arb("1e-38")  # events are located to about 1e-50 s
NO_BOUNCE = arb("1e-36")  # m/s: least speed of a bounce, because `leading` does not see a slower flight


class ReferenceModel:
    """Event-driven Taylor integration of one scene, whose parameters by name are `values`.

    `commands` are pairs of a time [s, decimal text] and the commanded motor_speed [rad/s], upper_gap, inclined_gap [m].
    A step has `order` powers of time, in an arithmetic of so many decimal `digits`.
    """

    def __init__(self, values, commands=(), order=48, digits=64):
        ctx.dps, ctx.cap, self.order = digits, order, order
        self.truncation = arb(10) ** -(digits - 10)
        self.values = values
        self.guides = [self._guide("upper", "0.0"), self._guide("inclined", values["guide.angle"])]
        self.total_mass = sum((g.mass for g in self.guides), arb(values["mass.body"]))
        self.weight = self.total_mass * arb(values["gravity"])
        self.sine, self.cosine = exact(self.guides[1].angle.sin()), exact(self.guides[1].angle.cos())
        self.friction = arb(values["ground.friction"])
        static = values["effects.friction"] == "static"
        self.holding = arb(values["ground.static_friction"]) if static else self.friction
        self.time, self.crank_angle, self.speed, self.acceleration = arb(0), arb(0), arb(values["motor.speed"]), arb(0)
        self.commanded_speed = self.speed
        self.body_position, self.body_velocity = arb(0), arb(0)
        self.height, self.climb, self.hops = arb(0), arb(0), values["effects.normal_force"] == "hop"
        self.restitution = arb(values.get("ground.restitution", 0.0))
        self.body_mode, self.unloaded, self.natural_step = "", False, 1.0
        self.events = []
        self.steps = 0
        self.agenda = sorted(((arb(t), change) for t, change in commands), key=lambda entry: float(entry[0]))
        self._start()

    def _guide(self, side, angle):
        value = self.values
        rod = arb(value[f"crank.{side}_rod"])
        return PreciseGuide(side, arb(value[f"mass.{side}"]), rod, arb(angle),
                            *(arb(value[f"{side}.{part}.{kind}"]) for part in ("spring", "plate")
                              for kind in ("stiffness", "damping")),
                            has_contact=value[f"effects.{side}_contact"] == "compliant",
                            plate=exact(rod + arb(value[f"{side}.gap"])))

    def _start(self):
        if self.values["start.state"] == "zero":
            return
        self.height = arb(self.values.get("start.body_height", 0.0))
        for guide in self.guides:
            self._expand_slider(guide)
            slider = guide.slider[0]
            guide.position = guide.plate if guide.has_contact and slider > guide.plate else slider

    def _expand_slider(self, guide):
        radius = arb(self.values["crank.radius"])
        guide.expand_slider(radius, self.crank_angle, self.speed, self.acceleration, self.order)

    # -- the motion as power series ------------------------------------------------------------

    def _expand(self, touching, held=False, sliding=0, flying=False):
        """Series of all motion: rows x, u, w of the mass matrix for y = 0, and N from its row y.

        x: M x'' - m3 sin φ w'' = -F_fr; u: m2 u'' = -F2 (- m2 g); w: m3 w'' (- m3 sin φ x'') = -F3 (- m3 g cos φ);
        y: N = M g + m2 u'' + m3 cos φ w''. The body is `held`, x'' = 0, or F_fr = μ N times `sliding`, -1, 0 or 1.
        While it is `flying`, N = F_fr = 0, and its y'' acts on the masses where its x'' does.
        Sets F_in, the friction force that would hold the body, for the present x''.
        """
        upper, inclined = self.guides
        gravity, back = (arb(self.values["gravity"]) if self.values["effects.mass_weight"] else arb(0)), arb(0)
        if self.values["effects.reaction"]:
            back = exact(inclined.mass * self.sine)
        by_weight = self.values["effects.normal_force"] == "weight"
        along, across, up = self._inertia()
        climbs = []
        slide = sliding * self.friction
        resistance = self.total_mass - back * self.sine + (0 if by_weight else slide * back * self.cosine)
        self.normal, self.inward, self.friction_force, accelerations = [], [], [], []
        for guide in self.guides:
            guide.begin_series()
        for n in range(self.order - 2):
            for guide, touches in zip(self.guides, touching, strict=True):
                guide.extend_force(n, touches)
            constant = 1 if n == 0 else 0
            upper_load = -upper.force[n] - constant * upper.mass * gravity
            inclined_load = -inclined.force[n] - constant * inclined.mass * gravity * self.cosine
            normal = constant * self.weight + (0 if by_weight else upper_load + self.cosine * inclined_load)
            inward = self.sine * inclined_load
            acceleration, climb = arb(0) if held else exact((inward - slide * normal) / resistance), arb(0)
            if flying:
                acceleration = exact((up * inward + across * normal) / (along * up - across * across))
                climb = exact(-(along * normal + across * inward) / (along * up - across * across))
            felt = int(self.values["effects.reaction"]) * climb
            inertia = inclined_load + back * acceleration - inclined.mass * self.cosine * felt
            normal = arb(0) if flying else normal + (0 if by_weight else self.cosine * back * acceleration)
            climbs.append(climb)
            upper.extend_position(n, upper_load - upper.mass * felt)
            inclined.extend_position(n, inertia)
            self.normal.append(exact(normal))
            self.inward.append(exact(self.sine * inertia))
            self.friction_force.append(self.inward[n] if held else exact(slide * normal))
            accelerations.append(acceleration)
        self.velocity = [self.body_velocity] + [exact(a / (n + 1)) for n, a in enumerate(accelerations)]
        self.position = [self.body_position] + [exact(v / (n + 1)) for n, v in enumerate(self.velocity)]
        self.climbing = [self.climb] + [exact(a / (n + 1)) for n, a in enumerate(climbs)]
        self.above = [self.height] + [exact(v / (n + 1)) for n, v in enumerate(self.climbing)]

    def _inertia(self):
        """M_xx, M_xy and M_yy of the body with the masses that feel it, once u'' and w'' are eliminated."""
        felt = int(self.values["effects.reaction"])
        upper, inclined = (felt * guide.mass for guide in self.guides)
        return (self.total_mass - inclined * self.sine * self.sine, inclined * self.sine * self.cosine,
                self.total_mass - upper - inclined * self.cosine * self.cosine)

    def _touches(self, guide):
        """Whether the plate acts just after the present instant, from series expanded without its force."""
        step = self._step_limit([guide.series, guide.slider], [guide.force])
        touching = guide.has_contact and leading(guide.penetration, step)[0] > 0
        return touching and (self.values["effects.adhesion"] or leading(guide.compression, step)[0] > 0)

    def _settle(self, **body):
        """Expand all motion for one state of the body, with the plates that act in this state, and set the natural
        step.
        """
        self._expand((False, False), **body)
        touching = [self._touches(guide) for guide in self.guides]
        self._expand(touching, **body)
        lengths = [series for g in self.guides for series in (g.series, g.slider, g.kink) if series]
        self.natural_step = self._step_limit(lengths, [g.force for g in self.guides])
        return touching

    def _note(self, kind, time, **details):
        self.events.append({"kind": kind, "time": time, **details})

    def _note_contact(self, guide, touching):
        if touching and not guide.touching:
            guide.contact = {"time": self.time, "speed": exact(guide.velocity - guide.plate_velocity), "peak": arb(0)}
        if guide.touching and not touching:
            began = guide.contact["time"]
            self._note(f"{guide.side}_contact", began, duration=exact(self.time - began),
                       speed=guide.contact["speed"], peak_force=guide.contact["peak"])
        guide.touching = touching

    def _resolve_body(self):
        """Find the body's mode just after the present instant, expand all series in it, and return which plates act."""
        if abs(self.body_velocity) < SPEED_IS_ZERO:
            self.body_velocity = arb(0)
        sign = leading([self.body_velocity], 1.0)[0]
        if self.height > 0 or self.climb > 0:
            return "airborne", self._settle(flying=True)
        if self.values["effects.friction"] == "none" or self.friction == 0:
            return "free", self._settle()
        unilateral = self.hops or self.values["effects.normal_force"] == "unilateral"
        if sign == 0:
            touching = self._settle(held=True)
            if self._holds():
                return "stick", touching
            sign = leading(self.inward, self.natural_step)[0]
            if sign == 0 and not unilateral:
                return "stick", touching
        touching = self._settle(sliding=sign)
        if unilateral and self._sign_of_normal() < 0:
            return ("airborne", self._settle(flying=True)) if self.hops else ("free", self._settle())
        return {1: "forward", -1: "backward"}[sign], touching

    def _sign_of_normal(self):
        return leading(self.normal, self.natural_step)[0]

    def _margins(self):
        """Series of μN - F_in and μN + F_in, with the friction coefficient of a body at rest."""
        return ([self.holding * n - i for n, i in zip(self.normal, self.inward, strict=True)],
                [self.holding * n + i for n, i in zip(self.normal, self.inward, strict=True)])

    def _holds(self):
        """Whether |F_in| <= μN just after the present instant, for a body at rest."""
        return all(leading([exact(c) for c in margin], self.natural_step)[0] >= 0 for margin in self._margins())

    def _note_body(self, mode):
        unloaded = mode == "airborne" or self._sign_of_normal() < 0
        if unloaded != self.unloaded:
            kinds = ("lift_off", "landing") if self.hops else ("unloaded", "loaded")
            self._note(kinds[0 if unloaded else 1], self.time)
        if self.body_mode and mode not in (self.body_mode, "free", "airborne"):
            self._note({"forward": "slip_forward", "backward": "slip_backward"}.get(mode, mode), self.time)
        self.unloaded, self.body_mode = unloaded, mode

    def _guards(self):
        """Return the series whose first change of sign ends the present mode."""
        guards = []
        for guide in self.guides:
            if guide.kink:
                guards.append(guide.kink)
            if guide.has_contact:
                guards.append(guide.penetration)
                if not self.values["effects.adhesion"] and leading(guide.penetration, self.natural_step)[0] > 0:
                    guards.append(guide.compression)
        guards.append(self.above if self.body_mode == "airborne" else self.normal)
        if self.body_mode == "stick":
            guards.extend(self._margins())
        elif self.body_mode not in ("free", "airborne"):
            guards.append(self.velocity[:-1])
        return guards

    def _step_limit(self, lengths, forces):
        """Step [s] that keeps the last two powers of every series, in m (or 1) and in N, below the truncation limit."""
        limit = 1.0
        for group, scale in ((lengths, 0.1), (forces, 10.0)):
            for series in group:
                for n in (len(series) - 2, len(series) - 1):
                    if series[n] != 0:
                        ratio = self.truncation * arb(scale) / abs(series[n])
                        limit = min(limit, 0.9 * float(ratio ** (arb(1) / n)))
        return limit

    # -- advancing ------------------------------------------------------------------------------

    def resolve(self):
        """Expand everything at the present instant."""
        for guide in self.guides:
            self._expand_slider(guide)
        mode, touching = self._resolve_body()
        for guide, touches in zip(self.guides, touching, strict=True):
            self._note_contact(guide, touches)
        self._note_body(mode)

    def advance_to(self, time: arb):
        """Integrate up to `time` [s] and leave everything expanded there."""
        self._obey()
        self.resolve()
        while self.time < time:
            target = min((entry[0] for entry in self.agenda), default=time)
            target = target if target < time else time
            step = arb(self.natural_step)
            lands = not self.time + step < target
            if lands:
                step = exact(target - self.time)
            for guard in self._guards():
                crossing = first_crossing(guard, step, self.natural_step)
                if crossing is not None:
                    step, lands = crossing, False
            self._move(step)
            self.time = target if lands else exact(self.time + step)
            self._obey()
            self.resolve()

    def _move(self, step):
        for guide in self.guides:
            if guide.touching:
                self._follow_peak(guide, step)
            guide.position, guide.velocity = value(guide.series, step), value(derivative(guide.series), step)
            guide.plate = exact(guide.plate + guide.plate_velocity * step)
        self.body_position = value(self.position, step)
        self.body_velocity = arb(0) if self.body_mode == "stick" else value(self.velocity, step)
        if self.body_mode == "airborne":
            self.height, self.climb = value(self.above, step), value(self.climbing, step)
            if abs(self.height) < SPEED_IS_ZERO and self.climb < 0:
                self._land()
        self.crank_angle = exact(self.crank_angle + step * (self.speed + step * self.acceleration / 2))
        self.speed = exact(self.speed + step * self.acceleration)
        self.steps += 1

    def _land(self):
        """Stop the fall by an impulse P_y >= 0 with friction |P_x| <= μ P_y against x' (Routh's law), or bounce."""
        if self.restitution > 0 and -self.climb > NO_BOUNCE:
            self.height, self.climb = arb(0), exact(-self.restitution * self.climb)
            return
        along, across, up = self._inertia()
        fall, speed_before = self.climb, self.body_velocity
        slopes = {sign: exact((across + sign * self.friction * up) / (along + sign * self.friction * across))
                  for sign in (1, -1)}  # dx'/dy' while the body slips forwards or backwards
        sign = leading([speed_before], 1.0)[0]
        speed_after = exact(speed_before + slopes[sign] * fall) if sign else speed_before
        if sign == 0 or sign * speed_after < 0:
            left = exact(fall + speed_before / slopes[sign]) if sign else fall  # fall left when x' becomes 0
            holds = abs(across) <= self.friction * up
            speed_after = arb(0) if holds else exact(slopes[-1 if across > 0 else 1] * left)
        self.height, self.climb, self.body_velocity = arb(0), arb(0), speed_after
        if self.values["effects.reaction"]:
            upper, inclined = self.guides
            upper.velocity = exact(upper.velocity + fall)
            inclined.velocity = exact(inclined.velocity + self.sine * (speed_after - speed_before) + self.cosine * fall)

    def _follow_peak(self, guide, step):
        instants = [arb(0), step]
        turn = first_crossing(derivative(guide.compression), step, self.natural_step)
        if turn is not None:
            instants.append(turn)
        for instant in instants:
            push = value(guide.compression, instant)
            if push > guide.contact["peak"]:
                guide.contact["peak"] = push

    # -- commands -------------------------------------------------------------------------------

    def _obey(self):
        """Carry out the agenda's entries that are due: commands, ends of ramps and of plate motions."""
        due = [entry for entry in self.agenda if not entry[0] > self.time]
        self.agenda = [entry for entry in self.agenda if entry[0] > self.time]
        for _, change in due:
            for name, target in change.items():
                if name == "motor_speed":
                    self._set_speed(arb(target))
                elif name == "ramp_end":
                    self.speed, self.acceleration = self.commanded_speed, arb(0)
                elif name.endswith("_gap"):
                    self._set_gap(name.removesuffix("_gap"), arb(target))
                else:
                    guide = self._named(name.removesuffix("_plate_stop"))
                    guide.plate, guide.plate_velocity = target, arb(0)

    def _named(self, side):
        return self.guides[0] if side == "upper" else self.guides[1]

    def _set_speed(self, target):
        self.commanded_speed = target
        if self.values["effects.motor"] == "ideal":
            self.speed = target
            return
        self.agenda = [entry for entry in self.agenda if "ramp_end" not in entry[1]]
        limit = arb(self.values["motor.acceleration"])
        change = exact(target - self.speed)
        self.acceleration = limit if change > 0 else -limit if change < 0 else arb(0)
        if change != 0:
            self.agenda.append((exact(self.time + abs(change) / limit), {"ramp_end": None}))

    def _set_gap(self, side, gap):
        guide, stop = self._named(side), f"{side}_plate_stop"
        self.agenda = [entry for entry in self.agenda if stop not in entry[1]]
        target = exact(guide.rod + gap)
        limit = arb(self.values["gap_actuator.speed"])
        change = exact(target - guide.plate)
        guide.plate_velocity = limit if change > 0 else -limit if change < 0 else arb(0)
        if change != 0:
            self.agenda.append((exact(self.time + abs(change) / limit), {stop: target}))

    # -- results of a run ---------------------------------------------------------------------

    def sample(self):
        """Return the present values by the names of the fields of `Samples`."""
        upper, inclined = self.guides
        power = arb(0)
        for guide in self.guides:
            power -= guide.drive_force() * guide.slider[1]
        lifted = self.unloaded and self.values["effects.normal_force"] == "unilateral"
        return {
            "time": self.time, "body_position": self.body_position, "body_velocity": self.body_velocity,
            "upper_position": upper.position, "upper_velocity": upper.velocity,
            "inclined_position": inclined.position, "inclined_velocity": inclined.velocity,
            "crank_angle": self.crank_angle, "motor_speed": self.speed, "motor_power": exact(power),
            "normal_force": arb(0) if lifted else self.normal[0], "friction_force": self.friction_force[0],
        }


def exact(value: arb) -> arb:
    """Return the midpoint of a ball, as a number without error radius."""
    return value.mid()


@dataclass
class PreciseGuide:
    """One impact mass with its slider and its plate, in arbitrary precision; positions along the guide [m]."""

    side: str
    mass: arb
    rod: arb
    angle: arb
    stiffness: arb
    damping: arb
    plate_stiffness: arb
    plate_damping: arb
    has_contact: bool
    position: arb = arb(0)
    velocity: arb = arb(0)
    plate: arb = arb(0)
    plate_velocity: arb = arb(0)
    touching: bool = False
    contact: dict = field(default_factory=dict)
    slider: list = field(default_factory=list)
    series: list = field(default_factory=list)
    penetration: list = field(default_factory=list)
    compression: list = field(default_factory=list)
    force: list = field(default_factory=list)
    kink: list = field(default_factory=list)

    def expand_slider(self, radius, crank_angle, speed, acceleration, order):
        """Set the series of s = l cos + sqrt(L² - l² sin²) at the guide's angle."""
        angle = arb_series([crank_angle - self.angle, speed, acceleration / 2], order)
        cosine, sine = angle.cos(), angle.sin()
        if radius == self.rod:  # s = l cos + l |cos|
            self.kink = _coefficients(cosine, order)
            folded = leading(self.kink, 1e-4)[0] if any(c != 0 for c in self.kink) else 0
            self.slider = _coefficients(cosine * (radius * (1 + folded)), order)
            return
        root = (arb_series([self.rod * self.rod], order) - sine * sine * (radius * radius)).sqrt()
        self.slider = _coefficients(cosine * radius + root, order)

    def begin_series(self):
        """Start the series of position, penetration, plate compression force and total force."""
        self.series, self.force, self.penetration, self.compression = [self.position, self.velocity], [], [], []

    def extend_force(self, n, touching):
        """Coefficient n of the spring and contact force, appended, with or without the plate."""
        position, slider, plate = self.series, self.slider, [self.plate, self.plate_velocity] + [arb(0)] * (n + 1)
        depth = position[n] - plate[n]
        push = self.plate_stiffness * depth + self.plate_damping * ((n + 1) * (position[n + 1] - plate[n + 1]))
        total = self.stiffness * (position[n] - slider[n])
        total += self.damping * ((n + 1) * (position[n + 1] - slider[n + 1]))
        if touching:
            total += push
        self.force.append(exact(total))
        self.penetration.append(exact(depth))
        self.compression.append(exact(push))

    def extend_position(self, n, inertia):
        """Coefficient n + 2 of the position, appended; `inertia` is coefficient n of mass times acceleration."""
        self.series.append(exact(inertia / (self.mass * ((n + 2) * (n + 1)))))

    def drive_force(self):
        """Present force of the drive spring and damper on the slider [N]."""
        return self.stiffness * (self.position - self.slider[0]) + self.damping * (self.velocity - self.slider[1])


def _coefficients(series, order):
    return [exact(series[n]) for n in range(order)]


def value(series: list, at: arb) -> arb:
    """The series' value, by Horner."""
    total = arb(0)
    for coefficient in reversed(series):
        total = exact(total * at + coefficient)
    return total


def derivative(series: list) -> list:
    """The series of the derivative."""
    return [n * c for n, c in enumerate(series)][1:]
