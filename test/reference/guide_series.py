"""One impact mass, its slider and its plate as power series in time."""

from dataclasses import dataclass, field

from first_crossing import leading
from flint import arb, arb_series


def exact(value: arb) -> arb:
    """The midpoint: a number without error radius."""
    return value.mid()


@dataclass
class Guide:
    """One impact mass with its slider and its plate; positions along the guide [m]."""

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
