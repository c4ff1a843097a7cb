"""Linear forms over the channels of a scene, written as the paper writes its terms.

A form is an array, shape (channels,); its value is the scalar product with z (`solver.system`).
The symbols, with eq. numbers of the paper: u = zeta_2, w = xi_3 (positions of the masses), s = zeta_B or
xi_C (sliders, eqs. 2 and 3), E and H (plates), F2 and F3 (total force of spring and contact on a mass, eq. 1),
N (normal force, eq. 6 without the friction coefficient), F_in (eq. 7).

N and F_in are written with the accelerations, which m2 u'' = -F2 and m3 w'' = -F3 give in the paper: these forms
hold whether a plate is in contact or not, and with the reaction on the masses, too.
"""

import functools
import math
from collections.abc import Callable

import numpy as np

from vibro_ros.solver.system import Channels

Form = np.ndarray

#: Parts of a direction that are rounding of its angle, which is at most pi.
_ANGLE_ROUNDING = 2.0 * math.pi * np.finfo(float).eps


def kept(method: Callable) -> Callable:
    """Have an object keep in `_kept` what a method returns for its arguments, and nobody change it: every mode of a
    scene asks for the same forms."""
    @functools.wraps(method)
    def look_up(self, *arguments):
        key = (method.__name__, *arguments)
        if key not in self._kept:
            result = method(self, *arguments)
            for form in result if isinstance(result, tuple) else (result,):
                form.setflags(write=False)
            self._kept[key] = result
        return self._kept[key]

    return look_up


def direction(scene, side: str) -> tuple[float, float]:
    """Direction of a guide, outwards: its parts along x and upwards, e = (-sin(phi), cos(phi)) for the inclined.

    An angle of pi/2 is level and one of pi upright: what their rounding leaves of the other part is none.
    """
    angle = scene["guide.angle"] if side == "inclined" else 0.0
    parts = -math.sin(angle), math.cos(angle)
    return tuple(0.0 if abs(part) < _ANGLE_ROUNDING else part for part in parts)


class Forms:
    """The linear forms of one scene.

    Parameters
    ----------
    scene : Scene
        Its effects decide which coordinates, signals and ramps exist.

    Attributes
    ----------
    guides : tuple of str
        Guides whose masses are simulated; guide i owns coordinate i and signal i.
    plates : tuple of str
        Guides that have a plate; plate k owns ramp k.
    body_moves : bool
        Whether x is a coordinate (after the masses): only an inclined mass drives the body.
    body_hops : bool
        Whether y, the body's height, is a coordinate (the last one): by the rule `hop`, a mass can lift the body.
    pressed_only : bool
        Whether a normal force below zero counts as zero: the rules `unilateral` and, for rounding, `hop`.
    friction_decays : bool
        Whether the friction coefficient falls with the speed: Stribeck's law, with a part that falls.
    channels : Channels
        Layout of z.
    """

    def __init__(self, scene):
        self._kept = {}
        self._scene = scene
        self.guides = scene.guides
        self.plates = scene.plates
        self.body_moves = "inclined" in self.guides and self.direction("inclined")[0] != 0.0
        self.body_hops = scene["effects.normal_force"] == "hop" and bool(self.guides)
        self.pressed_only = scene["effects.normal_force"] in ("unilateral", "hop")
        self.friction_decays = self.body_moves and scene.has_friction and scene["effects.friction"] == "stribeck" and (
            scene["ground.static_friction"] > scene["ground.friction"])
        self.channels = Channels(len(self.guides) + self.body_moves + self.body_hops, len(self.guides),
                                 len(self.guides), len(self.plates), int(self.friction_decays))

    @kept
    def _unit(self, channel: int) -> Form:
        form = np.zeros(self.channels.count)
        form[channel] = 1.0
        return form

    @property
    def one(self) -> Form:
        """The constant 1."""
        return self._unit(self.channels.one)

    @property
    @kept
    def zero(self) -> Form:
        """The constant 0."""
        return np.zeros(self.channels.count)

    @property
    def body(self) -> int:
        """Coordinate x."""
        return len(self.guides)

    @property
    def height(self) -> int:
        """Coordinate y."""
        return len(self.guides) + self.body_moves

    def position(self, coordinate: int) -> Form:
        """Coordinate [m]."""
        return self._unit(self.channels.position(coordinate))

    def velocity(self, coordinate: int) -> Form:
        """Rate of a coordinate [m/s]."""
        return self._unit(self.channels.velocity(coordinate))

    def body_velocity(self) -> tuple[Form, Form]:
        """x' and y' [m/s]; zero where they are no coordinates."""
        return (self.velocity(self.body) if self.body_moves else self.zero,
                self.velocity(self.height) if self.body_hops else self.zero)

    def direction(self, side: str) -> tuple[float, float]:
        """See `direction`."""
        return direction(self._scene, side)

    @kept
    def stretch(self, side: str) -> tuple[Form, Form]:
        """q - s [m] and its rate [m/s]: stretch of the drive spring."""
        i = self.guides.index(side)
        slider, slider_rate = self.channels.signal(i), self.channels.signal_rate(i)
        return self.position(i) - self._unit(slider), self.velocity(i) - self._unit(slider_rate)

    @kept
    def plate(self, side: str) -> tuple[Form, Form]:
        """E or H [m] and its rate [m/s]."""
        k = self.plates.index(side)
        return self._unit(self.channels.ramp(k)), self._unit(self.channels.ramp_rate(k))

    @kept
    def penetration(self, side: str) -> tuple[Form, Form]:
        """u - E or w - H [m] and its rate [m/s]."""
        i = self.guides.index(side)
        plate, plate_rate = self.plate(side)
        return self.position(i) - plate, self.velocity(i) - plate_rate

    @kept
    def drive_force(self, side: str) -> Form:
        """k (q - s) + c (q' - s') [N]: pull of the drive spring and damper on the slider, k2 c2 or k3 c3."""
        stretch, rate = self.stretch(side)
        return self._scene[f"{side}.spring.stiffness"] * stretch + self._scene[f"{side}.spring.damping"] * rate

    @kept
    def plate_force(self, side: str) -> Form:
        """k (q - E) + c (q' - E') [N]: push of the mass on its plate while in contact, k4 c4 or k1 c1."""
        depth, rate = self.penetration(side)
        return self._scene[f"{side}.plate.stiffness"] * depth + self._scene[f"{side}.plate.damping"] * rate

    @kept
    def guide_force(self, side: str, closed: frozenset[str]) -> Form:
        """F2 or F3 [N], with the compliant plates of `closed` in contact."""
        force = self.drive_force(side)
        return force + self.plate_force(side) if side in closed else force

    @kept
    def weight(self, side: str) -> Form:
        """Pull of the mass's own weight along its guide, inwards [N]; zero unless the scene has it."""
        if not self._scene["effects.mass_weight"]:
            return self.zero
        return self._scene[f"mass.{side}"] * self._scene["gravity"] * self.direction(side)[1] * self.one

    def resting_force(self, side: str, body: tuple[Form, Form]) -> Form:
        """Push of a mass on the rigid plate it rests on [N]: it holds q'' at 0 while the body accelerates by `body`."""
        force = -self.drive_force(side) - self.weight(side)
        if not self._scene["effects.reaction"]:
            return force
        return force - self._scene[f"mass.{side}"] * self.along(side, body)

    def along(self, side: str, vector: tuple[Form, Form]) -> Form:
        """Part along a guide of a vector, given by its parts along x and upwards."""
        along_x, upwards = self.direction(side)
        return along_x * vector[0] + upwards * vector[1]

    @kept
    def normal_force(self) -> Form:
        """N = M g + m2 u'' + m3 w'' cos(phi) [N], eq. (6); M g by the rule `weight`. In the air this is -M y''."""
        normal = self._scene.total_mass * self._scene["gravity"] * self.one
        if self._scene["effects.normal_force"] == "weight":
            return normal
        _, upwards = self.direction("inclined")
        return normal + self._inertia("upper") + upwards * self._inertia("inclined")

    def decayed_normal_force(self) -> Form:
        """N exp(-|x'| / v_s) [N] while the body slips, for Stribeck's law; v_s is `ground.stribeck_speed`."""
        return self._unit(self.channels.decay) if self.friction_decays else self.zero

    @kept
    def inertial_force(self) -> Form:
        """F_in = m3 w'' sin(phi) [N], eq. (7)."""
        along_x, _ = self.direction("inclined")
        return -along_x * self._inertia("inclined")

    @kept
    def _inertia(self, side: str) -> Form:
        """m2 u'' or m3 w'' [N]; zero without the mass."""
        if side not in self.guides:
            return self.zero
        acceleration = self._unit(self.channels.acceleration(self.guides.index(side)))
        return self._scene[f"mass.{side}"] * acceleration
