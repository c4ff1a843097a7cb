"""The modes of a scene: every combination of its effects' states, with equations, guards and outputs.

What is off leaves no coordinate, no term, no guard and no mode behind.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.contact import Contact
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.friction import Friction

#: Linear outputs of a mode, in the order of `Model.output`'s rows.
OUTPUTS = ("body_position", "body_velocity", "upper_position", "upper_velocity", "inclined_position",
           "inclined_velocity", "upper_drive_force", "inclined_drive_force", "upper_plate_force",
           "inclined_plate_force", "upper_plate_position", "upper_plate_velocity", "inclined_plate_position",
           "inclined_plate_velocity", "normal_force", "friction_force")


@dataclass(frozen=True)
class Mode:
    """One state of every effect.

    Attributes
    ----------
    states : tuple of str
        States of the contacts, in the order of `Forms.plates`, then that of the friction.
    closed : frozenset of str
        Guides whose plates are in contact.
    """

    states: tuple[str, ...]
    closed: frozenset[str]


class ModeBuilder:
    """Builds the tables mode by mode.

    Parameters
    ----------
    scene : Scene
        What to compile.
    """

    def __init__(self, scene):
        self._scene = scene
        self.forms = Forms(scene)
        self.contacts = [Contact(scene, self.forms, side) for side in self.forms.plates]
        self.friction = Friction(scene, self.forms)
        # Where nothing can drive the body, it rests for good, and friction has no states.
        self.friction_states = self.friction.states if self.forms.body_moves else ("rest",)
        product = itertools.product(*(contact.states for contact in self.contacts), self.friction_states)
        self.modes = tuple(Mode(states, self._closed(states)) for states in product)
        self._number = {mode.states: m for m, mode in enumerate(self.modes)}

    def _closed(self, states: tuple[str, ...]) -> frozenset[str]:
        contacts = zip(self.contacts, states, strict=False)  # the last state is the friction's
        return frozenset(contact.side for contact, state in contacts if state == "closed")

    @property
    def initial_mode(self) -> int:
        """Number of the mode to start in."""
        friction = self.friction.initial if self.forms.body_moves else "rest"
        return self._number[(*(contact.initial for contact in self.contacts), friction)]

    def equations(self, mode: Mode) -> list[Form]:
        """Accelerations of the coordinates: M x'' = F_in - F_fr (eq. 1), and those of the masses."""
        if not self.forms.body_moves:
            return self._mass_accelerations(mode, self.forms.zero)
        body = (self.forms.inertial_force() - self.friction_force(mode)) / self._scene.total_mass
        return [*self._mass_accelerations(mode, body), body]

    def _mass_accelerations(self, mode: Mode, body: Form) -> list[Form]:
        """m2 u'' = -F2 and m3 w'' = -F3 (eq. 1); the weight adds m2 g and m3 g cos(phi) to F2 and F3, the reaction
        makes it m3 (w'' - x'' sin(phi)), where x'' = `body`, a form of u'' and w'' itself, is eliminated."""
        scene, forms = self._scene, self.forms
        accelerations = [forms.channels.acceleration(i) for i in range(len(forms.guides))]
        inertia = np.diag([scene[f"mass.{side}"] for side in forms.guides])
        loads = np.array([-forms.guide_force(side, mode.closed) for side in forms.guides])
        for i, side in enumerate(forms.guides):
            mass, along_x, upwards = scene[f"mass.{side}"], *forms.direction(side)
            if scene["effects.mass_weight"]:
                loads[i] -= mass * scene["gravity"] * upwards * forms.one
            if scene["effects.reaction"]:
                inertia[i] += mass * along_x * body[accelerations]
                loads[i] -= mass * along_x * body[forms.channels.one] * forms.one
        if np.linalg.det(inertia) <= 0.0:
            raise ValueError(f"ground.friction: at {scene['ground.friction']:g} the reaction on the masses has no unique "
                             "solution while the body slips; lower it, or set effects.reaction to false")
        return list(np.linalg.solve(inertia, loads)) if len(loads) else []

    def friction_force(self, mode: Mode) -> Form:
        """F_fr in `mode` [N]."""
        normal, inertial = self.forms.normal_force(), self.forms.inertial_force()
        return self.friction.force(mode.states[-1], normal, inertial)

    def guards(self, mode: Mode):
        """Guards of `mode` and, for each, the numbers of its target modes."""
        for k, contact in enumerate(self.contacts):
            for guard in contact.guards(mode.states[k]):
                yield guard, self._targets(mode, k, guard.targets)
        if self.forms.body_moves:
            normal, inertial = self.forms.normal_force(), self.forms.inertial_force()
            for guard in self.friction.guards(mode.states[-1], normal, inertial):
                yield guard, self._targets(mode, len(self.contacts), guard.targets)

    def _targets(self, mode: Mode, place: int, states: tuple[str, ...]) -> list[int]:
        return [self._number[mode.states[:place] + (state,) + mode.states[place + 1:]] for state in states]

    def outputs(self, mode: Mode) -> np.ndarray:
        """Rows of `OUTPUTS`; zero for what the scene does not have."""
        forms, rows = self.forms, {}
        if forms.body_moves:
            rows |= {"body_position": forms.position(forms.body), "body_velocity": forms.velocity(forms.body)}
        for i, side in enumerate(forms.guides):
            rows |= {f"{side}_position": forms.position(i), f"{side}_velocity": forms.velocity(i),
                     f"{side}_drive_force": -forms.drive_force(side)}
        for side in forms.plates:
            rows[f"{side}_plate_position"], rows[f"{side}_plate_velocity"] = forms.plate(side)
            if side in mode.closed:
                rows[f"{side}_plate_force"] = forms.plate_force(side)
        rows |= {"normal_force": forms.normal_force(), "friction_force": self.friction_force(mode)}
        return np.array([rows.get(name, forms.zero) for name in OUTPUTS])
