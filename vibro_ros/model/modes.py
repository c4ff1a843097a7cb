"""The modes of a scene: every combination of its effects' states, with equations, guards and outputs.

What is off leaves no coordinate, no term, no guard and no mode behind.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.automaton import Target
from vibro_ros.model.contact import contact
from vibro_ros.model.forms import Form, Forms, kept
from vibro_ros.model.friction import Friction

#: Linear outputs of a mode, in the order of `Model.output`'s rows.
OUTPUTS = ("body_position", "body_velocity", "body_height", "body_vertical_velocity", "upper_position",
           "upper_velocity", "inclined_position", "inclined_velocity", "upper_drive_force", "inclined_drive_force",
           "upper_plate_force", "inclined_plate_force", "upper_plate_position", "upper_plate_velocity",
           "inclined_plate_position", "inclined_plate_velocity", "normal_force", "friction_force")


@dataclass(frozen=True)
class Mode:
    """One state of every effect.

    Attributes
    ----------
    states : tuple of str
        States of the contacts, in the order of `Forms.plates`, then that of the friction.
    closed : frozenset of str
        Guides whose compliant plates are in contact.
    resting : frozenset of str
        Guides whose masses rest on rigid plates.
    """

    states: tuple[str, ...]
    closed: frozenset[str]
    resting: frozenset[str]

    @property
    def friction(self) -> str:
        """State of the friction."""
        return self.states[-1]

    @property
    def pressing(self) -> frozenset[str]:
        """Guides whose masses press on their plates."""
        return self.closed | self.resting


class ModeBuilder:
    """Builds the tables mode by mode.

    Parameters
    ----------
    scene : Scene
        What to compile.
    """

    def __init__(self, scene):
        self._kept = {}
        self._scene = scene
        self.forms = Forms(scene)
        self.contacts = [contact(scene, self.forms, side) for side in self.forms.plates]
        self.friction = Friction(scene, self.forms)
        product = itertools.product(*(contact.states for contact in self.contacts), self.friction.states)
        self.modes = tuple(Mode(states, self._in(states, "closed"), self._in(states, "resting")) for states in product)
        self._number = {mode.states: m for m, mode in enumerate(self.modes)}

    def _in(self, states: tuple[str, ...], wanted: str) -> frozenset[str]:
        contacts = zip(self.contacts, states, strict=False)  # the last state is the friction's
        return frozenset(contact.side for contact, state in contacts if state == wanted)

    @property
    def initial_mode(self) -> int:
        """Number of the mode to start in."""
        return self._number[(*(contact.initial for contact in self.contacts), self.friction.initial)]

    def equations(self, mode: Mode) -> list[Form]:
        """Accelerations of the coordinates: those of the masses, and the body's."""
        along_x, upwards = self.body_acceleration(mode)
        return [*self._mass_accelerations(mode), *[along_x] * self.forms.body_moves, *[upwards] * self.forms.body_hops]

    @kept
    def body_acceleration(self, mode: Mode) -> tuple[Form, Form]:
        """x'' and y'' as forms of the masses' accelerations: M x'' = F_in - F_fr (eq. 1); in the air, where N = 0,
        M y'' = -M g - m2 u'' - m3 w'' cos(phi)."""
        forms, total = self.forms, self._scene.total_mass
        along_x = (forms.inertial_force() - self.friction_force(mode)) / total if forms.body_moves else forms.zero
        return along_x, -forms.normal_force() / total if mode.friction == "airborne" else forms.zero

    def _mass_accelerations(self, mode: Mode) -> list[Form]:
        """m2 u'' = -F2 and m3 w'' = -F3 (eq. 1); the weight adds m2 g and m3 g cos(phi) to F2 and F3, the reaction
        makes it m2 (u'' + y'') and m3 (w'' - x'' sin(phi) + y'' cos(phi)), where x'' and y'', forms of u'' and w''
        themselves, are eliminated. A resting mass keeps its velocity."""
        scene, forms, body = self._scene, self.forms, self.body_acceleration(mode)
        accelerations = [forms.channels.acceleration(i) for i in range(len(forms.guides))]
        inertia = np.diag([scene[f"mass.{side}"] for side in forms.guides])
        loads = np.array([-forms.guide_force(side, mode.closed) for side in forms.guides])
        for i, side in enumerate(forms.guides):
            mass, along = scene[f"mass.{side}"], forms.along(side, body)
            loads[i] -= forms.weight(side)
            if scene["effects.reaction"]:
                inertia[i] += mass * along[accelerations]
                loads[i] -= mass * along[forms.channels.one] * forms.one
        # Only the others are solved for: an elimination that pivots would leave rounding in a resting mass's row.
        moving = [i for i, side in enumerate(forms.guides) if side not in mode.resting]
        solved = np.zeros_like(loads)
        if moving:
            solved[moving] = np.linalg.solve(inertia[np.ix_(moving, moving)], loads[moving])
        return list(solved)

    def normal_force(self, mode: Mode) -> Form:
        """N in `mode` [N]."""
        return self.forms.zero if mode.friction == "airborne" else self.forms.normal_force()

    def friction_force(self, mode: Mode) -> Form:
        """F_fr in `mode` [N]."""
        normal, inertial = self.forms.normal_force(), self.forms.inertial_force()
        return self.friction.force(mode.friction, normal, inertial)

    def contact_force(self, mode: Mode, side: str) -> Form:
        """Push of a mass on its plate [N], were they in contact."""
        if self._scene[f"effects.{side}_contact"] == "restitution":
            return self.forms.resting_force(side, self.body_acceleration(mode))
        return self.forms.plate_force(side)

    def guards(self, mode: Mode):
        """Guards of `mode`; for each, its effect's place in `Mode.states` and the numbers of its target modes."""
        for k, plate in enumerate(self.contacts):
            for guard in plate.guards(mode.states[k], mode.friction, mode.resting, self.body_acceleration(mode)):
                yield guard, k, self._targets(mode, k, guard.targets)
        normal, inertial = self.forms.normal_force(), self.forms.inertial_force()
        for guard in self.friction.guards(mode.friction, normal, inertial, mode.resting):
            yield guard, len(self.contacts), self._targets(mode, len(self.contacts), guard.targets)

    def _targets(self, mode: Mode, place: int, targets: tuple[Target, ...]) -> list[int]:
        numbers = []
        for target in targets:
            states = ["open" if target.parts and state == "resting" else state for state in mode.states]
            states[place] = target.state
            if target.friction:
                states[-1] = target.friction
            numbers.append(self._number[tuple(states)])
        return numbers

    def outputs(self, mode: Mode) -> np.ndarray:
        """Rows of `OUTPUTS`; zero for what the scene does not have."""
        forms, rows = self.forms, {}
        if forms.body_moves:
            rows |= {"body_position": forms.position(forms.body), "body_velocity": forms.velocity(forms.body)}
        if forms.body_hops:
            rows |= {"body_height": forms.position(forms.height),
                     "body_vertical_velocity": forms.velocity(forms.height)}
        for i, side in enumerate(forms.guides):
            rows |= {f"{side}_position": forms.position(i), f"{side}_velocity": forms.velocity(i),
                     f"{side}_drive_force": -forms.drive_force(side)}
        for side in forms.plates:
            rows[f"{side}_plate_position"], rows[f"{side}_plate_velocity"] = forms.plate(side)
            if side in mode.pressing:
                rows[f"{side}_plate_force"] = self.contact_force(mode, side)
        rows |= {"normal_force": self.normal_force(mode), "friction_force": self.friction_force(mode)}
        return np.array([rows.get(name, forms.zero) for name in OUTPUTS])
