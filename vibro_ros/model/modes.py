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
7. Energy. Audit and accounts must see what the effect stores and the power of its forces: `_stored_energy`,
   `_potential` and `_powers` in `energy.py`, `_stored`, `_potential` and `_powers` in `accounts.py`. What makes the
   masses lighter or stiffer enters `rates.py` by `Scene.yielding_masses`.
8. Steps of fixed length. `moreau` needs the law as numbers: `_plates`, `_coefficients`, `_swing` in `moreau_laws.py`.
   What a step publishes of an event that it has not seen is cut in `force_limits.py`; `Forms.pressed_only` says
   whether a negative N is reported as 0.
9. Motors. A motor law gives the crank's clock its speed in `Motion._command_speed` (`simulation/motion.py`), and
   `solver/drive.py` moves the clock: series, time to an angle, longest segment. `forcing` in `description.py`
   describes the law.
10. Events and words. A new kind of event belongs into `MODE_EVENTS` (`mode_set.py`) and the table of kinds in
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

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from vibro_ros.model.automaton import Guard
from vibro_ros.model.contact import make_contact
from vibro_ros.model.forms import Form, Forms, cached
from vibro_ros.model.friction import Friction
from vibro_ros.model.mode_set import Context, Mode, mode_set
from vibro_ros.model.scene import Scene

#: Outputs of a mode that are linear forms, in the order of the rows of `Model.output`.
OUTPUTS = ("body_position", "body_velocity", "body_height", "body_vertical_velocity", "upper_position",
           "upper_velocity", "inclined_position", "inclined_velocity", "upper_drive_force", "inclined_drive_force",
           "upper_plate_force", "inclined_plate_force", "upper_plate_position", "upper_plate_velocity",
           "inclined_plate_position", "inclined_plate_velocity", "normal_force", "friction_force")
#: A form for each mode, shape (modes, channels).
ModeForms = np.ndarray
_OUTPUT_ROWS = {name: row for row, name in enumerate(OUTPUTS)}


class ModeBuilder:
    """The modes of a scene, with equations, guards and outputs as forms.

    Equations and outputs are made for all modes at once: row m of `ModeForms`, shape (modes, channels), is the form in
    mode m.

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
    mode_set : ModeSet
        What depends on the effects alone.
    modes : tuple of Mode
        All modes, by their numbers.
    """

    def __init__(self, scene: Scene):
        self._cache: dict[tuple, Any] = {}
        self._scene = scene
        self.forms = Forms(scene)
        self.contacts = [make_contact(scene, self.forms, side) for side in self.forms.plates]
        self.friction = Friction(scene, self.forms)
        states = (*(contact.states for contact in self.contacts), self.friction.states)
        self.mode_set = mode_set(self.forms.guides, self.forms.plates, tuple(map(type, self.contacts)), states,
                                 self.forms.has_misprint)
        self.modes = self.mode_set.modes
        self._shape = len(self.modes), self.forms.channels.count

    @property
    def initial_mode(self) -> int:
        """Number of the mode in which a run starts."""
        return self.mode_set.number((*(contact.initial for contact in self.contacts), self.friction.initial))

    def equations(self) -> np.ndarray:
        """Accelerations of the coordinates [m/s²]: those of the masses, then x'' and y'' of the body.

        Returns
        -------
        ndarray, shape (modes, coordinates, channels)
        """
        forms, (along_x, upwards) = self.forms, self.body_acceleration()
        rows = np.empty((len(self.modes), forms.channels.coordinates, forms.channels.count))
        rows[:, :len(forms.guides)] = self._mass_accelerations()
        if forms.body_moves:
            rows[:, forms.body] = along_x
        if forms.body_hops:
            rows[:, forms.height] = upwards
        return rows

    @cached
    def body_acceleration(self) -> tuple[ModeForms, ModeForms]:
        """x'' and y'' [m/s²] as forms of the masses' accelerations; y'' is zero on the ground.

        M x'' = F_in - F_fr (eq. 1). In the air, where N = 0, M y'' = -M g - m2 u'' - m3 w'' cos(phi).
        """
        forms, total = self.forms, self._scene.total_mass
        along_x, upwards = np.zeros(self._shape), np.zeros(self._shape)
        if forms.body_moves:
            along_x = (self.at_contact(forms.inertial_force) - self.friction_force()) / total
        airborne = self.mode_set.airborne
        upwards[airborne] = -self.at_contact(forms.normal_force)[airborne] / total
        return along_x, upwards

    def _mass_accelerations(self) -> np.ndarray:
        """u'' and w'' [m/s²], shape (modes, guides, channels); zero for a mass that rests on a rigid plate.

        m2 u'' = -F2 and m3 w'' = -F3 (eq. 1). The weight adds m2 g and m3 g cos(phi) to F2 and F3. With the reaction
        the left sides are m2 (u'' + y'') and m3 (w'' - x'' sin(phi) + y'' cos(phi)), and x'' and y'', which are forms
        of u'' and w'', are eliminated.
        """
        scene, forms, body, n = self._scene, self.forms, self.body_acceleration(), len(self.forms.guides)
        accelerations = slice(forms.channels.acceleration(0), forms.channels.acceleration(n))
        inertia, loads = np.zeros((len(self.modes), n, n)), np.empty((len(self.modes), n, forms.channels.count))
        for i, side in enumerate(forms.guides):
            mass = scene[f"mass.{side}"]
            inertia[:, i, i] = mass
            loads[:, i] = -self._guide_force(side) - forms.weight(side)
            if scene["effects.reaction"]:
                along = mass * forms.along(side, body)
                inertia[:, i] += along[:, accelerations]
                loads[:, i] -= along[:, forms.channels.one, None] * forms.one
        # Only moving masses are solved for, because an elimination that pivots leaves rounding in a resting mass's row.
        solved = np.zeros_like(loads)
        for rows, blocks in self.mode_set.moving:
            solved[rows] = np.linalg.solve(inertia[blocks], loads[rows])
        return solved

    def _guide_force(self, side: str) -> Form | ModeForms:
        """F2 or F3 [N]."""
        without = self.forms.guide_force(side, frozenset())
        if not self.has_compliant_plate(side):
            return without
        return np.where(self.mode_set.pressing[side][:, None], self.forms.guide_force(side, frozenset({side})), without)

    def has_compliant_plate(self, side: str) -> bool:
        """Whether the guide `side` has a plate that yields."""
        return side in self.forms.plates and self._scene[f"effects.{side}_contact"] == "compliant"

    def while_pressing(self, side: str, form: Form | ModeForms) -> ModeForms:
        """The form in the modes in which the mass of `side` presses on its plate, and zero in the others."""
        return np.where(self.mode_set.pressing[side][:, None], form, 0.0)

    @cached
    def normal_force(self) -> ModeForms:
        """N [N]."""
        return np.where(self.mode_set.airborne[:, None], 0.0, self.at_contact(self.forms.normal_force))

    @cached
    def friction_force(self) -> ModeForms:
        """F_fr [N]."""
        normal, inertial = self.at_contact(self.forms.normal_force), self.at_contact(self.forms.inertial_force)
        by_state = np.array([self.friction.force(state, normal, inertial) for state in self.friction.states])
        return by_state[self.mode_set.friction, np.arange(len(self.modes))]

    def at_contact(self, force: Callable[[bool], Form]) -> ModeForms:
        """N or F_in [N] in every mode; `force` makes it for an inclined plate that is not, or is, in contact."""
        return np.array([force(False), force(True)])[self.mode_set.inclined_closed]

    @cached
    def contact_force(self, side: str) -> Form | ModeForms:
        """Push of a mass on its plate [N] if they are in contact."""
        if self.has_compliant_plate(side):
            return self.forms.plate_force(side)
        return self.forms.resting_force(side, self.body_acceleration())

    def guards(self, mode: Mode) -> Iterator[tuple[Guard, int, list[int]]]:
        """Guards of `mode`; with each, the index in `Mode.states` of its effect and the numbers of its target modes."""
        for context in self.mode_set.contexts[self.mode_set.number(mode.states)]:
            for guard in self.guards_in(context):
                yield guard, context.effect, [self.mode_set.target_mode(mode, context.effect, target)
                                              for target in guard.targets]

    def guards_in(self, context: Context) -> list[Guard]:
        """Guards of an effect's state."""
        m = self.mode_set.first_with[context]
        mode, (along_x, upwards) = self.modes[m], self.body_acceleration()
        if context.effect < len(self.contacts):
            plate = self.contacts[context.effect]
            return plate.guards(context.state, mode.friction, mode.resting, (along_x[m], upwards[m]))
        closed = "inclined" in mode.closed
        normal, inertial = self.forms.normal_force(closed), self.forms.inertial_force(closed)
        return self.friction.guards(context.state, normal, inertial, mode.resting)

    def outputs(self) -> np.ndarray:
        """Forms of the `OUTPUTS`, shape (modes, len(OUTPUTS), channels); zero for what the scene does not have."""
        forms, rows = self.forms, dict[str, Form | ModeForms]()
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
            rows[f"{side}_plate_force"] = self.while_pressing(side, self.contact_force(side))
        rows |= {"normal_force": self.normal_force(), "friction_force": self.friction_force()}
        outputs = np.zeros((len(self.modes), len(OUTPUTS), forms.channels.count))
        for name, form in rows.items():
            outputs[:, _OUTPUT_ROWS[name]] = form
        return outputs
