"""The modes of a scene: every combination of its effects' states, with equations, guards and outputs.

A *form* is a linear combination of the channels of z (`solver.system`); a *state* is a condition of an effect, such as
`stick` or `open`; a *mode* is one state of each effect. An effect that is off has no coordinate, term, guard or mode.

Places of a new effect
----------------------
Every effect needs places 1 to 3, 10 and 11. The others are for the effects that they name.

1. `model/parameters.py`: the choice, or each number with unit, limits and description. A default leaves the paper's
   robot as it is. A number that enters no equation is listed in `_OPERATION` of `model/scene.py` as well.
2. `model/parameter_checks.py`: a check refuses a value that contradicts another choice, by a ValueError
   "parameter: value ...; give ...": in `check_machine` or, for what enters no equation, in `check_operation`.
   `ParameterValues` says which parts the robot has.
3. `lab/benchmark/support.py`: a row of `SUPPORT` says whether the peer and the baseline have the parameter. They refuse
   a parameter without a row. Their equations: `lab/benchmark/heyoka_robot/equations.py` and
   `lab/benchmark/rk4_by_hand.py`.
4. `model/parameter_values.py`, for a force of the ground: a row of `GROUND_FORCES`, with its law F = F0 + c x' + k x.
   Equations, stick, energy and `Scene.describe()` follow from the row. In `model/ground.py`, a force with states of its
   own adds them to `GROUND_STATES`, and their guards to `Ground.guards`; a shock is a matter of `shock.py`.
5. `model/contact.py`, for a contact: a class as `RigidContact`, with the states of the plate, and with guards whose
   targets have the jumps.
6. `model/forms.py`, for a force along a guide (`Forms.drive_force`, `Forms.weight`) and for a coordinate, ramp or other
   channel (`Forms.channels`). A force that reads x or x', such as -c x', makes x a dynamic coordinate: `Forms.channels`
   counts it, and `ModeBuilder.equations` eliminates the masses' accelerations from its row. A force that is no linear
   form, such as Stribeck's friction, has a channel of its own, and a flow by Taylor series (`solver/taylor.py`).
7. `model/energy.py`, for a part that stores energy, and for the power of a force along a guide.
8. `simulation/readout.py`, for a contact or a friction law: the limits of the forces that a step of fixed length
   publishes (`cut_to_laws`).
9. `simulation/actuators.py` and `solver/drive.py`, for a motor law that is known in time: the speed of the crank's
   clock; `description.py` describes it. A motor that the masses slow down: `model/motor.py` has its forms and states,
   `solver/rotor.py` its signals and controller.
10. `tools/effects.py` and the tables of docs/robot.md: a row of `EFFECTS`. A new kind of event belongs into
    `MODE_EVENTS` and docs/guide/python.md.
11. Tests: the known answer (docs/known_answers.md), a scene of `EFFECTS` in `test_heyoka_robot.py`, `VARIANTS`
    of `test_description.py`. `test_thousand_random_scenes.py` draws every choice by itself.
"""

import functools
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.model.contact import CompliantContact, RigidContact, make_contact
from vibro_ros.model.forms import NO_EDGES, NO_PUSH, Form, Forms, Guard, LinkageMass, StanceForms, cached, solve
from vibro_ros.model.ground import GROUND_STATES, Ground
from vibro_ros.model.motor import BEARING, LIMITS, Bearing, CurrentLoop, Motor
from vibro_ros.model.scene import Scene
from vibro_ros.solver.equations import terms
from vibro_ros.solver.system import NOTHING

#: Outputs of a mode that are linear forms, in the order of the rows of `Model.output`.
OUTPUTS = ("body_position", "body_velocity", "body_height", "body_vertical_velocity", "upper_position",
           "upper_velocity", "inclined_position", "inclined_velocity", "upper_drive_force", "inclined_drive_force",
           "upper_plate_force", "inclined_plate_force", "upper_plate_position", "upper_plate_velocity",
           "inclined_plate_position", "inclined_plate_velocity", "normal_force", "friction_force", "motor_voltage",
           "motor_current")
#: Kinds of events that a change of mode records, by their number.
MODE_EVENTS = ("stick", "slip_forward", "slip_backward", "unloaded", "loaded", "lift_off", "landing", "crank_stops",
               "crank_turns")
#: Class of an effect with states, except the ground.
Kind = type[CompliantContact | RigidContact | Bearing | CurrentLoop]
_OUTPUT_ROWS = {name: row for row, name in enumerate(OUTPUTS)}


@dataclass(frozen=True)
class Mode:
    """One state of every effect."""

    # states of the contacts, in the order of `Forms.plates`, then of a dc motor's effects, then of the ground
    states: tuple[str, ...]
    closed: frozenset[str]  # guides whose compliant plates are in contact
    resting: frozenset[str]  # guides whose masses rest on rigid plates

    @property
    def ground(self) -> str:
        """State of the body on the ground (`ground.GROUND_STATES`)."""
        return self.states[-1]

    @functools.cached_property
    def motor(self) -> tuple[str, str]:
        """States of a dc motor's bearing and of its current loop; "" for an absent one."""
        bearing = next((state for state in self.states if state in BEARING), "")
        return bearing, next((state for state in self.states if state in LIMITS), "")


class Context(NamedTuple):
    """States on which an effect's guards depend; modes with the same context have the same guards of the effect."""

    effect: int  # index of the effect in `Mode.states`
    state: str  # its state
    others: tuple[Any, ...]  # states of other effects on which the guards depend


class ModeBuilder:
    """The modes of a scene, with equations, guards and outputs as forms.

    Equations and outputs are made for all stances of `ModeSet` at once: row k of `StanceForms`, shape (stances,
    channels), is the form in stance k. `push` and `edges` are as `compile_scene` has them.
    """

    def __init__(self, scene: Scene, push: tuple[float, float] = NO_PUSH, edges: tuple[float, float] = NO_EDGES):
        self._cache: dict[tuple, Any] = {}
        self._scene = scene
        self.forms = Forms(scene, push)
        # in the order of `Forms.plates`
        self.contacts = [make_contact(scene, self.forms, side) for side in self.forms.plates]
        self.ground = Ground(scene, self.forms, edges)
        # None if the crank's motion is known in time
        self.motor = Motor(scene, self.forms) if self.forms.has_rotor else None
        inner = (*self.contacts, *(self.motor.effects if self.motor else ()))
        states = (*(effect.states for effect in inner), self.ground.states)
        self.mode_set = mode_set(self.forms.guides, self.forms.plates, tuple(map(type, inner)), states,
                                 self.forms.has_misprint)
        self.modes, self.stances = self.mode_set.modes, self.mode_set.stances
        self._shape = len(self.stances), self.forms.channels.count

    @property
    def initial_mode(self) -> int:
        """Number of the mode in which a run starts; if its guards do not hold, another mode follows at once."""
        motor = (effect.states[0] for effect in self.motor.effects) if self.motor else ()
        return self.mode_set.number((*("open" for _ in self.contacts), *motor, self.ground.states[0]))

    def equations(self) -> np.ndarray:
        """Accelerations of the coordinates [m/s²], shape (stances, coordinates, channels): the masses', then x'', y''.

        The rows of the solver's dynamic coordinates read no acceleration; the rows of driven coordinates may read
        accelerations of dynamic coordinates.
        """
        forms, (along_x, upwards) = self.forms, self.body_acceleration()
        rows = np.empty((len(self.stances), forms.channels.coordinates, forms.channels.count))
        masses = slice(len(forms.guides))
        rows[:, masses] = self._mass_accelerations()
        if forms.body_moves:
            rows[:, forms.body] = along_x
        if forms.body_is_dynamic:
            first = forms.channels.acceleration(0)
            of_masses = slice(first, first + len(forms.guides))
            rows[:, forms.body, of_masses] = 0.0
            for i in range(len(forms.guides)):
                rows[:, forms.body] += along_x[:, first + i, None] * rows[:, i]
        if forms.body_hops:
            rows[:, forms.height] = upwards
        if motor := self.motor:
            rows[:, forms.phase] = self.by_motor_state(lambda bearing, loop: motor.acceleration(bearing))
            rows[:, forms.charge] = 0.0 if motor.inductance == 0.0 else self.by_motor_state(
                lambda bearing, loop: motor.current_rate(loop))
        return rows

    def by_motor_state(self, form: Callable[[str, str], Form]) -> StanceForms:
        """Return `form(bearing, current loop)` in every stance, by the states of both; "" for an absent one."""
        return np.array([form(*states) for states in self.mode_set.motors])[self.mode_set.motor]

    @cached
    def algebraic_current(self) -> StanceForms:
        """Current [A] of a dc motor's winding without inductance, in every stance; zero with inductance."""
        assert (motor := self.motor)
        if motor.inductance:
            return np.zeros(self._shape)
        return self.by_motor_state(lambda bearing, loop: motor.drawn_current(loop)) + 0.0

    @cached
    def body_acceleration(self) -> tuple[StanceForms, StanceForms]:
        """x'' and y'' [m/s²] as forms of the masses' accelerations; y'' is zero on the ground.

        M x'' = F_in - F_fr (eq. 1), and every other force along the ground. In the air, where N = 0,
        M y'' = -M g - m2 u'' - m3 w'' cos(phi).
        """
        forms, total = self.forms, self._scene.total_mass
        along_x, upwards = np.zeros(self._shape), np.zeros(self._shape)
        if forms.body_moves:
            along_x += self.ground.driving_force(self.at_contact(forms.inertial_force))
            if self.ground.has_dry_friction:
                along_x -= self.friction_force()
            along_x /= total
        if forms.body_hops:
            upwards = np.where(self.mode_set.airborne[:, None], -self.at_contact(forms.normal_force) / total, 0.0)
        return along_x, upwards

    def _mass_accelerations(self) -> np.ndarray:
        """u'' and w'' [m/s²], shape (stances, guides, channels); zero for a mass that rests on a rigid plate.

        m2 u'' = -F2 and m3 w'' = -F3 (eq. 1). The weight adds m2 g and m3 g cos(phi) to F2 and F3. With the reaction
        the left sides are m2 (u'' + y'') and m3 (w'' - x'' sin(phi) + y'' cos(phi)), and x'' and y'', which are forms
        of u'' and w'', are eliminated.
        """
        scene, forms, body, n = self._scene, self.forms, self.body_acceleration(), len(self.forms.guides)
        inertia, loads = np.zeros((len(self.stances), n, n)), np.empty((len(self.stances), n, forms.channels.count))
        first = forms.channels.acceleration(0)
        accelerations = slice(first, first + n)  # of the masses
        for i, side in enumerate(forms.guides):
            mass = scene[f"mass.{side}"]
            inertia[:, i, i] = mass
            force = forms.drive_force(side)
            if self.has_compliant_plate(side):
                pressing = self.mode_set.pressing[side][:, None]
                force = np.where(pressing, force + forms.plate_force(side), force)
            loads[:, i] = -force - forms.weight(side)
            if scene["effects.reaction"]:
                of_body = mass * forms.along(side, body)
                inertia[:, i] += of_body[:, accelerations]
                of_body[:, accelerations] = 0.0
                loads[:, i] -= of_body
        # Only moving masses are solved for, because an elimination that pivots leaves rounding in a resting mass's row.
        solved = np.zeros_like(loads)
        for rows, blocks in self.mode_set.moving:
            solved[rows] = solve(inertia[blocks], loads[rows])
        return solved

    def has_compliant_plate(self, side: str) -> bool:
        """Whether the guide `side` has a compliant plate."""
        return side in self.forms.plates and self._scene[f"effects.{side}_contact"] == "compliant"

    def while_pressing(self, side: str, form: Form | StanceForms) -> StanceForms:
        """The form in the stances in which the mass of `side` presses on its plate, and zero in the others."""
        return np.where(self.mode_set.pressing[side][:, None], form, 0.0)

    @cached
    def normal_force(self) -> StanceForms:
        """N [N], which is 0 in the air."""
        return np.where(self.mode_set.airborne[:, None], 0.0, self.at_contact(self.forms.normal_force))

    @cached
    def friction_force(self) -> StanceForms:
        """F_fr [N], positive when F_fr opposes forward motion."""
        normal, inertial = self.at_contact(self.forms.normal_force), self.at_contact(self.forms.inertial_force)
        return self.ground.friction_force(self.mode_set.friction, normal, inertial)

    @cached
    def at_contact(self, force: Callable[[bool], Form]) -> StanceForms:
        """N or F_in [N] in every stance, or one row for all; `force` returns it by whether the inclined plate is in
        contact, which matters to the misprint alone."""
        if not self.forms.has_misprint:
            return force(False)[None]
        return np.array([force(False), force(True)])[self.mode_set.inclined_closed]

    @cached
    def contact_force(self, side: str) -> Form | StanceForms:
        """Push of a mass on its plate [N] if they are in contact."""
        if self.has_compliant_plate(side):
            return self.forms.plate_force(side)
        return self.forms.resting_force(side, self.body_acceleration())

    def guards(self, mode: Mode) -> Iterator[tuple[Guard, int, list[int]]]:
        """Yield the guards of `mode`, each with its effect's index in `Mode.states` and its target modes' numbers."""
        m = self.mode_set.number(mode.states)
        for context in self.mode_set.contexts[m]:
            for guard in self.guards_in(context):
                yield guard, context.effect, [self.mode_set.target_mode(mode, context.effect, target.leads_to)
                                              for target in guard.targets]

    def guards_in(self, context: Context) -> list[Guard]:
        """Return the guards of an effect's state."""
        m = self.mode_set.first_with[context]
        mode, stance = self.modes[m], self.mode_set.stance[m]
        if context.effect < len(self.contacts):
            along_x, upwards = self.body_acceleration()
            return self.contacts[context.effect].guards(
                context.state, mode.ground, mode.resting, (along_x[stance], upwards[stance]))
        if self.motor and context.effect < len(mode.states) - 1:
            return self.motor.effects[context.effect - len(self.contacts)].guards(context.state)
        closed = self.forms.has_misprint and "inclined" in mode.closed
        normal, inertial = self.forms.normal_force(closed), self.forms.inertial_force(closed)
        return self.ground.guards(context.state, normal, inertial, mode.resting)

    def outputs(self) -> np.ndarray:
        """Forms of the `OUTPUTS`, zero for parts that the scene does not have, and of the linkage's forces; shape
        (stances, len(OUTPUTS) + linkage, channels)."""
        forms, rows = self.forms, dict[str, Form | StanceForms]()
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
        rows["normal_force"] = self.normal_force()
        if forms.body_moves:
            rows["friction_force"] = self.friction_force()
        if motor := self.motor:
            rows |= {"motor_voltage": self.by_motor_state(lambda bearing, loop: motor.voltage(loop)),
                     "motor_current": motor.current}
        outputs = np.zeros((len(self.stances), len(OUTPUTS) + len(forms.linkage), forms.channels.count))
        for name, form in rows.items():
            outputs[:, _OUTPUT_ROWS[name]] = form
        for k, part in enumerate(forms.linkage, start=len(OUTPUTS)):
            outputs[:, k] = self.linkage_force(part)
        return outputs

    def signal_loads(self) -> np.ndarray:
        """Force on each signal along it [N], shape (stances, signals, channels): the pull of a drive on its slider,
        less the force that moves the masses of the linkage."""
        forms = self.forms
        loads = np.zeros((len(self.stances), forms.channels.signals, forms.channels.count))
        for i, side in enumerate(forms.guides):
            loads[:, i] = forms.drive_force(side)
        for part in forms.linkage:
            loads[:, part.signal] -= self.linkage_force(part)
        return loads

    def linkage_force(self, part: LinkageMass) -> StanceForms:
        """Force of the crank that moves a mass of the linkage in its direction [N]."""
        forms, scene, (along_x, upwards) = self.forms, self._scene, part.direction
        load = np.tile(forms.units[forms.channels.signal_acceleration(part.signal)], (len(self.stances), 1))
        if scene["effects.reaction"]:
            of_body = self.body_acceleration()
            load += along_x * of_body[0] + upwards * of_body[1]
        if scene["effects.mass_weight"]:
            load += (along_x * scene.gravity[0] + upwards * scene.gravity[1]) * forms.one
        return part.mass * load


class ModeSet:
    """The modes of a choice of effects; made by `mode_set`, once for all scenes with these effects.

    Modes with the same *stance*, which are the plates in contact and the states of motor and ground, have the same
    equations and outputs.
    """

    def __init__(self, guides: tuple[str, ...], plates: tuple[str, ...],
                 kinds: tuple[Kind, ...], states: tuple[tuple[str, ...], ...],
                 contact_changes_ground_force: bool):
        self.modes = tuple(Mode(of_mode, *(
            frozenset(side for side, state in zip(plates, of_mode, strict=False) if state == wanted)
            for wanted in ("closed", "resting"))) for of_mode in itertools.product(*states))
        self._number_by_states = {mode.states: m for m, mode in enumerate(self.modes)}
        self._set_stances(guides, plates)
        self._set_contexts(kinds, contact_changes_ground_force)
        self._set_changes_of_mode(plates)

    def _set_stances(self, guides: tuple[str, ...], plates: tuple[str, ...]) -> None:
        """Set what depends on the stance alone, and the stance of each mode."""
        # number of each mode's stance, in the order of the modes that have a stance first; and the first mode of each
        stances = [(mode.closed, mode.resting, mode.motor, mode.ground) for mode in self.modes]
        distinct = list(dict.fromkeys(stances))
        self.stance = np.array([distinct.index(stance) for stance in stances])
        self.stances = tuple(self.modes[stances.index(stance)] for stance in distinct)
        # by guide with a plate: the stances in which its mass presses on the plate
        self.pressing = {side: np.array([side in mode.closed | mode.resting for mode in self.stances])
                         for side in plates}
        # `GroundState.friction` in each stance, shape (stances, 1); NaN for None
        self.friction = np.array([[GROUND_STATES[mode.ground].friction] for mode in self.stances], dtype=float)
        self.airborne = np.array([mode.ground == "airborne" for mode in self.stances])
        # different states of a dc motor's bearing and current loop, and the index of those of each stance
        self.motors = tuple(dict.fromkeys(mode.motor for mode in self.stances))
        self.motor = np.array([self.motors.index(mode.motor) for mode in self.stances])
        # 1 in the stances in which the inclined mass presses on its compliant plate, else 0
        self.inclined_closed = np.array([int("inclined" in mode.closed) for mode in self.stances])
        # For each set of masses that move together in some stances, as indices of arrays by stance and guide: the rows
        # of these masses, shape (stances, masses), and the blocks that couple them, shape (stances, masses, masses).
        self.moving = []
        for resting in dict.fromkeys(mode.resting for mode in self.stances):
            moving = [i for i, side in enumerate(guides) if side not in resting]
            rows = [k for k, mode in enumerate(self.stances) if mode.resting == resting]
            if moving:
                self.moving.append((np.ix_(rows, moving), np.ix_(rows, moving, moving)))

    def _set_contexts(self, kinds: tuple[Kind, ...], contact_changes_ground_force: bool) -> None:
        """Set the contexts of each mode, and their numbers."""
        self.contexts = tuple(tuple(_contexts(mode, kinds, contact_changes_ground_force)) for mode in self.modes)
        # the first mode with a context
        self.first_with = {context: m for m, contexts in reversed(list(enumerate(self.contexts)))
                           for context in contexts}
        # every context once, in the order of the modes that have them first
        self.distinct_contexts = tuple(dict.fromkeys(itertools.chain.from_iterable(self.contexts)))
        numbers = {context: k for k, context in enumerate(self.distinct_contexts)}
        self._context_numbers = [[numbers[context] for context in contexts] for contexts in self.contexts]

    def _set_changes_of_mode(self, plates: tuple[str, ...]) -> None:
        """Set the events that changes of mode record, and the modes that follow when a plate's speed changes."""
        # kinds of events, by mode before and mode after
        ground_and_bearing = [(mode.ground, mode.motor[0]) for mode in self.modes]
        pairs = list(dict.fromkeys(ground_and_bearing))
        number = np.array([pairs.index(states) for states in ground_and_bearing])
        self.event_kind = np.array([[_event_kind(old, new) for new in pairs] for old in pairs])[
            number[:, None], number]
        # the modes that follow when a plate's speed changes, because a mass may part from the plate
        self.mode_after_ramp_change = np.empty((len(self.modes), len(plates)), dtype=np.int64)
        for (m, mode), k in itertools.product(enumerate(self.modes), range(len(plates))):
            parted = ["open" if i == k and state == "resting" else state for i, state in enumerate(mode.states)]
            self.mode_after_ramp_change[m, k] = self.number(tuple(parted))

    def number(self, states: tuple[str, ...]) -> int:
        """Number of the mode with these states."""
        return self._number_by_states[states]

    def padded(self, counts: tuple[int, ...]) -> np.ndarray:
        """Return the numbers of each mode's guards, shape (modes, most guards of a mode), if the guards are numbered
        context by context in the order of `distinct_contexts`, of which each has so many; padded with their sum."""
        firsts = [0, *itertools.accumulate(counts)]
        of_mode = [[k for number in numbers for k in range(firsts[number], firsts[number + 1])]
                   for numbers in self._context_numbers]
        most = max(1, max(map(len, of_mode)))
        return np.array([guards + [firsts[-1]] * (most - len(guards)) for guards in of_mode])

    def target_mode(self, mode: Mode, effect: int, leads_to: tuple[str, str | None, str | None, bool]) -> int:
        """Number of the mode to which a target of an effect leads from `mode`; `NOTHING` if it has no such target."""
        state, ground, bearing, frees_resting_masses = leads_to
        states = ["open" if frees_resting_masses and old == "resting" else old for old in mode.states]
        states[effect] = state
        if ground:
            states[-1] = ground
        if bearing:
            states[next(k for k, old in enumerate(states) if old in BEARING)] = bearing
        return self._number_by_states.get(tuple(states), NOTHING)

    def with_terms(self, forms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return forms by stance, shape (stances, ..., channels), as forms by mode, and their channels (`terms`)."""
        return forms[self.stance], _terms_by_mode(self, (forms != 0.0).tobytes(), forms.shape)


@functools.lru_cache(maxsize=64)
def _terms_by_mode(mode_set: ModeSet, nonzeros: bytes, shape: tuple[int, ...]) -> np.ndarray:
    """Return `terms` by mode of forms by stance with these entries other than 0, which a sweep's scenes share."""
    return terms(np.frombuffer(nonzeros, dtype=bool).reshape(shape))[mode_set.stance]


def _event_kind(old: tuple[str, str], new: tuple[str, str]) -> int:
    """Return the kind of event that a change of the states of ground and bearing records, or `NOTHING`."""
    (old_ground, old_bearing), (ground, bearing) = old, new
    if old_ground != ground:
        event = GROUND_STATES[old_ground].ends or GROUND_STATES[ground].begins
    else:
        event = "" if old_bearing == bearing else "crank_stops" if bearing == "stuck" else "crank_turns"
    return MODE_EVENTS.index(event) if event else NOTHING


def _contexts(mode: Mode, kinds: tuple[Kind, ...],
              contact_changes_ground_force: bool) -> Iterator[Context]:
    for k, kind in enumerate(kinds):
        on_others = kind is RigidContact  # the guards of all other kinds depend on the effect's own state alone
        yield Context(k, mode.states[k], RigidContact.context(mode.ground, mode.resting) if on_others else ())
    closed = mode.closed & {"inclined"} if contact_changes_ground_force else frozenset[str]()
    yield Context(len(kinds), mode.ground, Ground.context(mode.ground, mode.resting, closed))


#: The `ModeSet` of guides, plates, classes of the effects except the ground, states of each effect (the ground last),
#: and whether the forms of N and F_in depend on the contact of the inclined plate.
mode_set = functools.lru_cache(maxsize=64)(ModeSet)
