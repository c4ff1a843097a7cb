"""The modes of a scene: every combination of its effects' states, with equations, guards and outputs.

A *form* is a linear combination of the channels of z (`solver.system`); a *state* is what an effect can be in, such as
`stick` or `open`; a *mode* is one state of each effect. What is off leaves no coordinate, term, guard or mode behind.

Rules for a new effect
----------------------
Each effect needs rules 1 to 3 and 10 to 12. A motor law needs rule 9 besides; a contact, a friction law and a rule of
the normal force need those of rules 4 to 8 that concern them.

1. Parameters. The choice is a word among the `choices` of an `effects.` parameter in `parameters.py`, and each number
   that the effect needs is a parameter with unit, limits and description. A default leaves the paper's robot as it is.
   A number that enters no equation, such as a motor's, is listed in `_OPERATION` of `scene.py`, so that it does not
   compile the scene anew.
2. Refusals. What has no meaning together with another choice is refused by a method of `Scene` such as `_check_blows`,
   with a ValueError "parameter: value ...; give ..." (or "choose ...").
3. Absence. `Scene` (`guides`, `plates`, `has_friction`, `resting_friction`) says which parts the robot has, and
   `Forms.__init__` (`forms.py`) which coordinates, ramps and other channels exist. A scene without the effect compiles
   to the tables that it had before the effect was written.
4. States. The effect's class, `Friction` (`friction.py`) or one that `make_contact` (`contact.py`) picks, names its
   states: `states`, the `initial` one, and of a contact the one that is `pressing`. Every mode has one state of the
   friction, and one of each plate's contact.
5. Guards. The class's `guards` give, for each state, forms that are not negative while the state lasts, each with the
   `Target` states to try, in order, when the form turns negative; the last target is entered if none is valid. A
   target brings its jumps of positions and velocities: `Blow` (`shock.py`) makes those of a blow, `Landing`
   (`landing.py`) those of a landing. `Friction._normal_force_guards` says what follows where N turns negative.
6. Forces. Each state has its force as a form: `Friction.force`, `ModeBuilder.contact_force`, `Forms.normal_force`. A
   contact whose state is called `closed` puts `Forms.plate_force` on its mass. A force that is no linear form needs a
   channel of its own in the solver, as Stribeck's friction has with `Forms.friction_decays` and `solver/decay.py`.
7. Energy. The audit must see what the effect stores and the power of its forces: `_stored_energy`, `_potential` and
   `_power` in `energy.py`. What makes the masses lighter or stiffer enters `rates.py` by `Scene.yielding_masses`.
8. Steps of fixed length. `moreau` needs the law as numbers: `_plates`, `_coefficients`, `_swing` in `moreau_laws.py`.
   What a step publishes of an event that it has not seen is cut in `force_limits.py`; `Forms.pressed_only` says
   whether a negative N is reported as 0.
9. Motors. A motor law gives the crank's clock its speed in `Motion._command_speed` (`simulation/motion.py`), and
   `solver/drive.py` moves the clock: series, time to an angle, longest segment. `forcing` in `description.py`
   describes the law.
10. Events and words. A new kind of event belongs into `MODE_EVENTS` (`tables.py`) and the table of kinds in
    docs/guide/python.md. `Scene.describe()` reads the tables; only `effects` in `description.py` names effects itself.
11. Who else simulates scenes must have the effect or refuse it. `KNOWN` in `peer/known.py` lists what the peer has,
    and the peer refuses the rest. `_KNOWN` in `accuracy/baseline.py` does the same, but only for the parameters that
    it lists. `accuracy/tables_by_scipy.py` reads the compiled tables, and refuses modes that need jumps where the
    search for events is off. The method `auto` needs a weight in `simulation/counted_work.py` for a motor law or a
    term that makes segments more expensive; `VARIED` in `project/work_weights.py` gets a scene, and that module
    measures the weight.
12. Tests and documents. `test_thousand_random_scenes.py` draws every choice by itself. These fail until the choice has
    its place: `test_peer.py` (`KNOWN` and a scene), `test_effects.py` (a row of `EFFECTS` in `project/effects.py`) and
    `test_documents.py` (the table of effects in docs/robot.md, and `make docs`). By hand the choice goes into
    `VARIANTS` of `test_description.py` and the scenes of `test_every_effect_converges_to_the_exact_motion`, and its
    known answer into docs/known_answers.md.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibro_ros.model.automaton import Guard, Target
from vibro_ros.model.contact import make_contact
from vibro_ros.model.forms import Form, Forms, cached
from vibro_ros.model.friction import Friction
from vibro_ros.model.scene import Scene

#: Outputs of a mode that are linear forms, in the order of the rows of `Model.output`.
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
    """The modes of a scene, with equations, guards and outputs as forms.

    Parameters
    ----------
    scene : Scene
        The scene.

    Attributes
    ----------
    forms : Forms
        The forms of the scene.
    contacts : list of CompliantContact or RigidContact
        One contact a plate, in the order of `Forms.plates`.
    friction : Friction
        The friction.
    modes : tuple of Mode
        All modes, by their numbers.
    """

    def __init__(self, scene: Scene):
        self._cache: dict[tuple, Any] = {}
        self._scene = scene
        self.forms = Forms(scene)
        self.contacts = [make_contact(scene, self.forms, side) for side in self.forms.plates]
        self.friction = Friction(scene, self.forms)
        product = itertools.product(*(contact.states for contact in self.contacts), self.friction.states)
        self.modes = tuple(Mode(states, self._sides_in(states, "closed"), self._sides_in(states, "resting"))
                           for states in product)
        self._number_by_states = {mode.states: m for m, mode in enumerate(self.modes)}

    def _sides_in(self, states: tuple[str, ...], wanted: str) -> frozenset[str]:
        """Guides whose contacts are in the state `wanted`."""
        contacts = zip(self.contacts, states, strict=False)  # the last state is the friction's
        return frozenset(contact.side for contact, state in contacts if state == wanted)

    @property
    def initial_mode(self) -> int:
        """Number of the mode in which a run starts."""
        return self._number_by_states[(*(contact.initial for contact in self.contacts), self.friction.initial)]

    def equations(self, mode: Mode) -> list[Form]:
        """Accelerations of the coordinates in `mode` [m/s²]: those of the masses, then x'' and y'' of the body."""
        along_x, upwards = self.body_acceleration(mode)
        return [*self._mass_accelerations(mode), *[along_x] * self.forms.body_moves, *[upwards] * self.forms.body_hops]

    @cached
    def body_acceleration(self, mode: Mode) -> tuple[Form, Form]:
        """x'' and y'' [m/s²] as forms of the masses' accelerations; y'' is zero on the ground.

        M x'' = F_in - F_fr (eq. 1). In the air, where N = 0, M y'' = -M g - m2 u'' - m3 w'' cos(phi).
        """
        forms, total = self.forms, self._scene.total_mass
        along_x = (forms.inertial_force() - self.friction_force(mode)) / total if forms.body_moves else forms.zero
        return along_x, -forms.normal_force() / total if mode.friction == "airborne" else forms.zero

    def _mass_accelerations(self, mode: Mode) -> list[Form]:
        """u'' and w'' [m/s²] in `mode`; zero for a mass that rests on a rigid plate.

        m2 u'' = -F2 and m3 w'' = -F3 (eq. 1). The weight adds m2 g and m3 g cos(phi) to F2 and F3. With the reaction
        the left sides are m2 (u'' + y'') and m3 (w'' - x'' sin(phi) + y'' cos(phi)), and x'' and y'', which are forms
        of u'' and w'', are eliminated.
        """
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
        # Only moving masses are solved for, because an elimination that pivots leaves rounding in a resting mass's row.
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
        """Push of a mass on its plate [N] in `mode` if they are in contact."""
        if self._scene[f"effects.{side}_contact"] == "restitution":
            return self.forms.resting_force(side, self.body_acceleration(mode))
        return self.forms.plate_force(side)

    def guards(self, mode: Mode) -> Iterator[tuple[Guard, int, list[int]]]:
        """Guards of `mode`; with each, the index in `Mode.states` of its effect and the numbers of its target modes."""
        for k, plate in enumerate(self.contacts):
            for guard in plate.guards(mode.states[k], mode.friction, mode.resting, self.body_acceleration(mode)):
                yield guard, k, self._targets(mode, k, guard.targets)
        normal, inertial = self.forms.normal_force(), self.forms.inertial_force()
        for guard in self.friction.guards(mode.friction, normal, inertial, mode.resting):
            yield guard, len(self.contacts), self._targets(mode, len(self.contacts), guard.targets)

    def _targets(self, mode: Mode, effect: int, targets: tuple[Target, ...]) -> list[int]:
        """Numbers of the modes to which the targets of an effect lead from `mode`."""
        numbers = []
        for target in targets:
            states = ["open" if target.frees_resting_masses and state == "resting" else state for state in mode.states]
            states[effect] = target.state
            if target.friction:
                states[-1] = target.friction
            numbers.append(self._number_by_states[tuple(states)])
        return numbers

    def outputs(self, mode: Mode) -> np.ndarray:
        """Forms of the `OUTPUTS` in `mode`, shape (len(OUTPUTS), channels); zero for what the scene does not have."""
        forms, rows = self.forms, dict[str, Form]()
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
