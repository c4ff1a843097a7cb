"""Linear forms over the channels of a scene, written as the paper writes its terms; guards and targets made of them.

A form is an array, shape (channels,). The value of a form is its scalar product with the channels z (`solver.system`).
The symbols, with eq. numbers of the paper: u = zeta_2, w = xi_3 (positions of the masses), s = zeta_B or
xi_C (sliders, eqs. 2 and 3), E and H (plates), F2 and F3 (total force of spring and contact on a mass, eq. 1),
N (normal force, eq. 6 without the friction coefficient), F_in (eq. 7).

N and F_in are written with the accelerations, which are m2 u'' = -F2 and m3 w'' = -F3 in the paper, because these forms
hold whether a plate is in contact or not, and also with the reaction on the masses. Only the paper's misprint taken
literally (`effects.misprint`) changes them where the inclined plate is in contact: eqs. (1), (6) and (7) print
k1 (zeta_2 - xi_H) for k1 (xi_3 - xi_H), so that the body feels k1 (u - H) in place of k1 (w - H).
"""

import functools
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.solver.channels import Channels

Form = np.ndarray
StanceForms = np.ndarray  # a form for each stance of `modes.ModeSet`, shape (stances, channels)
NO_PUSH = (0.0, 0.0)  # push of zero [N], along x and upwards
NO_EDGES = (-math.inf, math.inf)  # edges of a ground that is the same everywhere [m]

# Symbols of the coordinates of the masses, of their sliders and of their plates
MASS = {"upper": "u", "inclined": "w"}
SLIDER = {"upper": "s_B", "inclined": "s_C"}
PLATE = {"upper": "E", "inclined": "H"}


def cached(method: Callable) -> Callable:
    """Return a method that stores its forms in the object's dict `_cache`, by name and arguments.

    Every mode of a scene asks for the same forms, so that without the cache most of them would be made many times.
    Callers must not change a form that they get.
    """
    name = method.__name__

    @functools.wraps(method)
    def stored(self, *arguments):
        key = (name, *arguments)
        if key not in self._cache:
            self._cache[key] = method(self, *arguments)
        return self._cache[key]

    return stored


class LinkageMass(NamedTuple):
    """A mass that the crank moves as it turns."""

    mass: float  # mass [kg]
    signal: int  # number of the signal that is the mass's position along `direction`
    direction: tuple[float, float]  # components along x and upwards of the unit vector along which the mass moves


class Forms:
    """The linear forms of one scene, whose effects decide which coordinates, signals and ramps exist.

    The mass of guide i is coordinate i, its slider is signal i. Where the crank pin has a mass, its places along x and
    upwards are the last two signals. The position of plate k is ramp k. After the masses come, if they are coordinates,
    x where it enters its own equation, θ and Q of a dc motor, x where it does not, and y, the body's height. `push` is
    a force from outside on the body [N], along x and upwards; upwards only where the body can hop.
    """

    def __init__(self, scene: Scene, push: tuple[float, float] = NO_PUSH):
        self._cache: dict[tuple, Any] = {}
        self._scene = scene
        self.push = push
        self.guides = scene.guides  # those whose masses are simulated
        self.plates = scene.plates  # guides that have a plate
        self.body_moves, self.body_hops = scene.body_moves, scene.body_hops  # whether x and y are coordinates
        # whether a negative N counts as zero: by the rule `unilateral`, and by `hop`, where it is rounding error
        self.pressed_only = scene["effects.normal_force"] in ("unilateral", "hop")
        self.has_misprint = scene["effects.misprint"]
        self.friction_decays = (  # by Stribeck's law, with a static coefficient above mu
            self.body_moves and scene.has_dry_friction and scene["effects.friction"] == "stribeck"
            and scene["ground.static_friction"] > scene["ground.friction"])
        self.body_is_dynamic, self.has_rotor = scene.body_is_dynamic, scene.has_rotor
        dynamic = len(self.guides) + self.body_is_dynamic + 2 * self.has_rotor
        self.phase, self.charge = dynamic - 2, dynamic - 1  # numbers of the coordinates θ and Q
        self.body = len(self.guides) if self.body_is_dynamic else dynamic
        self.height = dynamic + (self.body_moves and not self.body_is_dynamic)  # number of the coordinate y
        signals = len(self.guides) + 2 * ("crank_pin" in scene.linkage)
        self.channels = Channels(self.height + self.body_hops, dynamic, signals, len(self.plates),
                                 int(self.friction_decays), signals if scene.linkage else 0, int(self.has_rotor))
        self.linkage = tuple(self._linkage_masses())
        self.crank_is_struck = scene.crank_is_struck
        sticks = self.crank_is_struck and scene["motor.static_friction"] > 0.0
        # possible states of the bearing after a shock that strikes the crank; None means that the state stays
        self.bearings_after_shock = ("turns_forward", "turns_backward") if sticks else (None,)
        # row c of the units is the form whose value is channel c; the forms `zero` and `one` have the values 0 and 1
        self.units, self.zero = np.eye(self.channels.count), np.zeros(self.channels.count)
        for shared in (self.units, self.zero):
            shared.setflags(write=False)
        self.one = self.units[self.channels.one]

    def _linkage_masses(self) -> Iterator[LinkageMass]:
        """Yield the masses at the sliders, and the mass of the crank pin once for each of its two directions."""
        scene = self._scene
        for i, side in enumerate(self.guides):
            if f"{side}_slider" in scene.linkage:
                yield LinkageMass(scene[f"mass.{side}_slider"], i, scene.direction(side))
        if "crank_pin" in scene.linkage:
            for k, direction in enumerate(((1.0, 0.0), (0.0, 1.0))):
                yield LinkageMass(scene["mass.crank_pin"], len(self.guides) + k, direction)

    @cached
    def linkage_inertia(self) -> tuple[Form, Form]:
        """Sum of m e s'' of the linkage's masses [N], along x and upwards."""
        along_x, upwards = self.zero, self.zero
        for part in self.linkage:
            force = part.mass * self.units[self.channels.signal_acceleration(part.signal)]
            along_x, upwards = along_x + part.direction[0] * force, upwards + part.direction[1] * force
        return along_x, upwards

    def position(self, coordinate: int) -> Form:
        """A coordinate [m], by its number."""
        return self.units[self.channels.position(coordinate)]

    def velocity(self, coordinate: int) -> Form:
        """Rate of a coordinate [m/s], by the coordinate's number."""
        return self.units[self.channels.velocity(coordinate)]

    def body_velocity(self) -> tuple[Form, Form]:
        """x' and y' [m/s]; zero for a direction that has no coordinate."""
        return (self.velocity(self.body) if self.body_moves else self.zero,
                self.velocity(self.height) if self.body_hops else self.zero)

    @cached
    def stretch(self, side: str) -> tuple[Form, Form]:
        """Stretch of the drive, q - s [m], and its rate [m/s]."""
        i = self.guides.index(side)
        slider, slider_rate = self.channels.signal(i), self.channels.signal_rate(i)
        return self.position(i) - self.units[slider], self.velocity(i) - self.units[slider_rate]

    @cached
    def plate(self, side: str) -> tuple[Form, Form]:
        """Position of the plate, E or H [m], and its rate [m/s]."""
        k = self.plates.index(side)
        return self.units[self.channels.ramp(k)], self.units[self.channels.ramp_rate(k)]

    @cached
    def penetration(self, side: str) -> tuple[Form, Form]:
        """Penetration of the plate by the mass, u - E or w - H [m], and its rate [m/s]."""
        i = self.guides.index(side)
        plate, plate_rate = self.plate(side)
        return self.position(i) - plate, self.velocity(i) - plate_rate

    @cached
    def drive_force(self, side: str) -> Form:
        """Pull of the drive on the slider, k (q - s) + c (q' - s') [N], with k2, c2 or k3, c3."""
        stretch, rate = self.stretch(side)
        return self._scene[f"{side}.spring.stiffness"] * stretch + self._scene[f"{side}.spring.damping"] * rate

    @cached
    def plate_force(self, side: str) -> Form:
        """Push of the mass on its plate in contact, k (q - E) + c (q' - E') [N], with k4, c4 or k1, c1."""
        depth, rate = self.penetration(side)
        return self._scene[f"{side}.plate.stiffness"] * depth + self._scene[f"{side}.plate.damping"] * rate

    @cached
    def weight(self, side: str) -> Form:
        """Pull of a mass's weight along its guide, inwards [N]; zero without the weight of the masses."""
        if not self._scene["effects.mass_weight"]:
            return self.zero
        (downhill, down), (along_x, upwards) = self._scene.gravity, self._scene.direction(side)
        mass = self._scene[f"mass.{side}"]
        return (mass * down * upwards + mass * downhill * along_x) * self.one

    def resting_force(self, side: str, body: tuple[Form | StanceForms, Form | StanceForms]) -> Form | StanceForms:
        """Push of a mass on the rigid plate on which the mass rests [N], which holds q'' at 0.

        `body` is the body's acceleration along x and upwards [m/s²], in one mode or in every mode.
        """
        force = -self.drive_force(side) - self.weight(side)
        if not self._scene["effects.reaction"]:
            return force
        return force - self._scene[f"mass.{side}"] * self.along(side, body)

    def along(self, side: str, vector: tuple[Form | StanceForms, Form | StanceForms]) -> Form | StanceForms:
        """Component of a vector along a guide; `vector` has the components along x and upwards."""
        along_x, upwards = self._scene.direction(side)
        return along_x * vector[0] + upwards * vector[1]

    @cached
    def normal_force(self, inclined_closed: bool) -> Form:
        """N = M g + m2 u'' + m3 w'' cos(phi) [N], eq. (6); M g by the rule `weight`. In the air this form is -M y''.

        On a slope g cos(alpha) takes the place of g. A push upwards is subtracted.

        The misprint adds its term if `inclined_closed`: while the inclined mass presses on its compliant plate.
        """
        normal = self._scene.total_mass * self._scene.gravity[1] * self.one
        if self._scene["effects.normal_force"] == "weight":
            return normal
        _, upwards = self._scene.direction("inclined")
        normal = normal + self._inertia("upper") + upwards * self._inertia("inclined") + self.linkage_inertia()[1]
        normal = normal - self.push[1] * self.one
        return normal - upwards * self._misread_force() if inclined_closed and self.has_misprint else normal

    def decayed_normal_force(self) -> Form:
        """N exp(-|x'| / v_s) [N] while the body slips, for Stribeck's law; v_s is `ground.stribeck_speed`."""
        return self.units[self.channels.decay] if self.friction_decays else self.zero

    @cached
    def inertial_force(self, inclined_closed: bool) -> Form:
        """F_in = m3 w'' sin(phi) [N], eq. (7), with the forces of the linkage's masses and of a push, and with the
        misprint's term if `inclined_closed`."""
        along_x, _ = self._scene.direction("inclined")
        inertial = -along_x * self._inertia("inclined") - self.linkage_inertia()[0] + self.push[0] * self.one
        return inertial + along_x * self._misread_force() if inclined_closed and self.has_misprint else inertial

    def _misread_force(self) -> Form:
        """k1 (u - w) [N]: the term that eqs. (1), (6) and (7) as printed add to the F3 that the body feels."""
        upper, inclined = (self.position(self.guides.index(side)) for side in ("upper", "inclined"))
        return self._scene["inclined.plate.stiffness"] * (upper - inclined)

    @cached
    def _inertia(self, side: str) -> Form:
        """m2 u'' or m3 w'' [N]; zero without the mass."""
        if side not in self.guides:
            return self.zero
        acceleration = self.units[self.channels.acceleration(self.guides.index(side))]
        return self._scene[f"mass.{side}"] * acceleration


class Target(NamedTuple):
    """A state that a guard may lead to."""

    state: str  # state of the guard's own effect
    # channels of the positions and velocities that change on the way to the target, each with a form, shape
    # (channels,), that gives the new value from the channels before the jump
    jumps: tuple[tuple[int, np.ndarray], ...] = ()
    # forms, shape (channels,), that must not be negative before the jump for the target to be entered
    entries: tuple[np.ndarray, ...] = ()
    ground: str | None = None  # new state of the body on the ground, if a blow changes it; else None
    bearing: str | None = None  # new state of the motor's bearing, if a shock changes it; else None
    # A shock of `model.shock` that gives the jumps in place of forms. The shock chooses one of the targets that share
    # it; these follow each other and have the same entries.
    shock: Any = None
    # whether the jump is a shock in which masses that rest on other plates part from these plates
    frees_resting_masses: bool = False

    @property
    def leads_to(self) -> tuple[str, str | None, str | None, bool]:
        """What decides the mode to which the target leads from each mode; see `modes.ModeSet.target_mode`."""
        return self.state, self.ground, self.bearing, self.frees_resting_masses


class Guard(NamedTuple):
    """A condition that holds while a state lasts: form >= 0."""

    form: np.ndarray  # shape (channels,): the linear form
    # the targets to try, in order, when the form turns negative; the last one is entered if none is valid. Empty if the
    # simulation continues with another system.
    targets: tuple[Target, ...]
    # the condition in the paper's symbols, with `{force}` for the force of a compliant plate, and `{voltage}` for the
    # voltage that a motor's current loop would apply without limits
    text: str
    is_blow: bool = False  # whether the guard ends in a blow without duration, which is recorded as a contact at once
    # whether a target is valid by its entries alone, even if its own guards fail after the jump. A landing is such a
    # guard, because the body has landed even if it lifts off again at once.
    entries_decide: bool = False
    event: str = ""  # kind of the event that is recorded if the state does not change, or empty


@functools.cache
def without_jump(*states: str) -> tuple[Target, ...]:
    """Return targets for these states, in this order, that change no position or velocity."""
    return tuple(Target(state) for state in states)


def solve(matrices: np.ndarray, forms: np.ndarray) -> np.ndarray:
    """Solve m systems of n linear equations between forms, by elimination with the largest pivots.

    `matrices` has the shape (m, n, n); none is singular. `forms`, the right sides, and the result, the unknowns, have
    the shape (m, n, channels). LAPACK's routines add in an order that depends on the processor; this elimination has
    the same bits everywhere.
    """
    matrix, solution, systems = matrices.copy(), forms.copy(), np.arange(len(matrices))
    unknowns = range(matrix.shape[1])
    for k in unknowns[:-1]:
        pivot = k + abs(matrix[:, k:, k]).argmax(axis=1)
        if (pivot != k).any():
            for rows in (matrix, solution):
                rows[systems, k], rows[systems, pivot] = rows[systems, pivot], rows[systems, k]
        for i in unknowns[k + 1:]:
            share = (matrix[:, i, k] / matrix[:, k, k])[:, None]
            matrix[:, i] -= share * matrix[:, k]
            solution[:, i] -= share * solution[:, k]
    for k in reversed(unknowns):
        for i in unknowns[k + 1:]:
            solution[:, k] -= matrix[:, k, i, None] * solution[:, i]
        solution[:, k] /= matrix[:, k, k, None]
    return solution
