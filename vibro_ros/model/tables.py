"""A scene compiled to the tables that the event loop reads (`solver.system.System`)."""

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibro_ros.model.energy import account_table
from vibro_ros.model.forms import NO_EDGES, NO_PUSH, Forms
from vibro_ros.model.modes import MODE_EVENTS, Mode, ModeBuilder, ModeSet
from vibro_ros.model.scene import Scene
from vibro_ros.model.shock import NonlinearShock
from vibro_ros.model.slider import Slider, signal_table
from vibro_ros.solver.channels import Channels, counts_of
from vibro_ros.solver.elementary import cos, sin
from vibro_ros.solver.equations import (
    couplings,
    equation_terms,
    flow_numbers,
    longest_segments,
    no_rotor,
    no_shock,
    terms,
)
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.system import (
    BY_COMMAND,
    BY_CURRENT,
    BY_VOLTAGE,
    CONTROLLER,
    NOTHING,
    UNCHECKED,
    Decay,
    EventTable,
    GuardTable,
    MonitorTable,
    Rotor,
    Shock,
    System,
)
from vibro_ros.solver.vector import LENGTH


@dataclass(frozen=True)
class Model:
    """A compiled scene."""

    forms: Forms  # linear forms of the scene
    sliders: tuple[Slider, ...]  # signals: sliders of the masses, and both directions of a crank pin with mass
    modes: tuple[Mode, ...]  # by their numbers in the system
    system: System  # tables of the event loop
    # forms of the outputs, and of the forces that move the masses of `Forms.linkage`, shape (stances, len(OUTPUTS) +
    # linkage, channels); and the number of each mode's stance
    output_of_stance: np.ndarray
    stance: np.ndarray
    initial_mode: int  # number of the mode in which a run starts

    @functools.cached_property
    def laid(self) -> Laid:
        """The tables in the form that the event loop's kernels take."""
        return Laid(self.system)

    @property
    def output(self) -> np.ndarray:
        """The forms of the outputs of every mode, shape (modes, len(OUTPUTS) + linkage, channels)."""
        return self.output_of_stance[self.stance]

    @functools.cached_property
    def output_by_channel(self) -> np.ndarray:
        """The forms `output`, each channel's coefficients as a vector; shape (modes, channels, LENGTH)."""
        stances, forms, channels = self.output_of_stance.shape
        by_channel = np.zeros((stances, channels, LENGTH))
        by_channel[:, :, :forms] = self.output_of_stance.transpose(0, 2, 1)
        return by_channel[self.stance]


def compile_scene(scene: Scene, push: tuple[float, float] = NO_PUSH, edges: tuple[float, float] = NO_EDGES) -> Model:
    """Compile `scene` to its tables, which all callers share and must not change.

    `push` is an external force on the body [N], along x and upwards; `edges` are positions of the body [m] between
    which the tables hold: a guard without a target ends the system there.
    """
    return _compile_machine(scene.machine, push, edges)


@functools.lru_cache(maxsize=64)
def _compile_machine(scene: Scene, push: tuple[float, float], edges: tuple[float, float]) -> Model:
    builder = ModeBuilder(scene, push, edges)
    forms, channels, mode_set = builder.forms, builder.forms.channels, builder.mode_set
    stance, sliders = mode_set.stance, _sliders(forms, scene)
    acceleration = builder.equations() + 0.0  # no -0.0
    reads_all, reads_forcing = _equation_terms(mode_set, channels, (acceleration != 0.0).tobytes(), acceleration.shape)
    # With the reaction a segment ends where the body's equation changes, because the masses feel the body.
    flow_equations = [acceleration[:, :channels.coordinates if scene["effects.reaction"] else channels.dynamic]]
    if builder.motor:
        flow_equations.append(builder.algebraic_current()[:, None])
    decaying_term = _decaying_term(builder) if forms.friction_decays else None
    if decaying_term:  # where the decaying term moves the body, the term is part of the flow
        rate, factor = decaying_term
        slips = (rate != 0.0)[:, None]
        flow_equations += [factor[:, None], np.where(slips, acceleration[:, forms.body], 0.0)[:, None]]
    flow = flow_numbers(np.concatenate(flow_equations, axis=1))
    first = np.unique(flow, return_index=True)[1]  # stance of each flow
    on_themselves = acceleration[first, :channels.dynamic, :channels.velocity(channels.dynamic)]
    guards, shock = _guard_table(builder)
    quantities = np.zeros((len(MODE_EVENTS), channels.count))
    quantities[MODE_EVENTS.index("landing")] -= forms.body_velocity()[1]  # the speed of the fall that a landing ends
    system = System(
        counts=counts_of(channels),
        equations=acceleration[stance],
        reads_all=reads_all,
        reads_forcing=reads_forcing,
        flow=flow[stance],
        coupled=couplings(acceleration, channels)[stance],
        longest_segment=_longest_segments(channels, on_themselves.tobytes(), on_themselves.shape)[flow[stance]],
        guards=guards,
        events=EventTable(mode_set.event_kind, quantities),
        monitors=_monitor_table(builder),
        mode_after_ramp_change=mode_set.mode_after_ramp_change,
        accounts=account_table(builder, scene, guards),
        signals=signal_table(sliders),
        decay=_decay_table(builder, decaying_term),
        rotor=_rotor(builder, scene, sliders),
        shock=shock,
    )
    return Model(forms, sliders, builder.modes, system, builder.outputs(), stance, builder.initial_mode)


@functools.lru_cache(maxsize=64)
def _equation_terms(mode_set: ModeSet, channels: Channels, nonzeros: bytes,
                    shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return `System.reads_all` and `System.reads_forcing` of equations by stance; cached as `ModeSet.with_terms`."""
    acceleration = np.frombuffer(nonzeros, dtype=bool).reshape(shape)
    return terms(acceleration)[mode_set.stance], equation_terms(acceleration, channels)[mode_set.stance]


@functools.lru_cache(maxsize=64)
def _longest_segments(channels: Channels, rows: bytes, shape: tuple[int, ...]) -> np.ndarray:
    """Return `longest_segments` of the rows of dynamic coordinates, up to the channels of their own velocities; cached,
    because many parameters, such as those of guards and controller, do not change them."""
    return longest_segments(np.frombuffer(rows).reshape(shape), channels)


def _decaying_term(builder: ModeBuilder) -> tuple[np.ndarray, np.ndarray]:
    """Return the decaying term of Stribeck's law by stance, exp(-abs(x') / v_s) times the normal force of a slipping
    body: the rate [s/m] of the exponent, shape (stances,), and the normal force, shape (stances, channels)."""
    rate = np.array([builder.ground.decay_rate(mode.ground) for mode in builder.stances])
    return rate, (rate != 0.0)[:, None] * builder.normal_force() + 0.0


def _decay_table(builder: ModeBuilder, decaying_term: tuple[np.ndarray, np.ndarray] | None) -> Decay:
    """Return the table of the decaying friction; empty if no friction decays."""
    forms, count = builder.forms, builder.forms.channels.count
    if decaying_term is None:
        return Decay(np.empty(0, np.int64), np.empty((0, count)), np.empty((0, count), np.int64), np.empty(0))
    rate, factor = decaying_term
    return Decay(np.array([forms.body], np.int64), *builder.mode_set.with_terms(factor), rate[builder.mode_set.stance])


def _rotor(builder: ModeBuilder, scene: Scene, sliders: tuple[Slider, ...]) -> Rotor:
    """Return the tables of the crank as a coordinate, with its motor; empty if the crank's motion is known in time."""
    motor, mode_set = builder.motor, builder.mode_set
    if not motor:
        return no_rotor(builder.forms.channels.count)
    signals = [(slider.radius, cos(slider.angle), sin(slider.angle),
                (slider.rod - slider.radius) * (slider.rod + slider.radius) if slider.rod else -1.0)
               for slider in sliders]
    law = {"voltage": BY_COMMAND, "speed_by_voltage": BY_VOLTAGE, "speed_by_current": BY_CURRENT}
    controller = (law[scene["motor.control"]], 1.0 / scene["motor.control_rate"], scene["motor.proportional_gain"],
                  scene["motor.integral_gain"], scene["motor.feed_forward"], motor.supply_voltage, motor.constant,
                  motor.resistance, scene["motor.current_limit"])
    return Rotor(np.array(signals).reshape(-1, 4), *mode_set.with_terms(builder.signal_loads()),
                 *mode_set.with_terms(builder.algebraic_current()),
                 np.full(len(mode_set.modes), motor.inductance == 0.0), np.array([controller], CONTROLLER))


def _shock_table(forms: Forms, shocks: list[NonlinearShock], candidate: np.ndarray) -> Shock:
    """Return the shocks that no jump matrix gives; `candidate` is the shock's number for each guard's candidate."""
    if not shocks:
        return no_shock()
    mass, momentum = np.zeros(forms.channels.signals), np.zeros((forms.channels.signals, 2))
    for part in forms.linkage if forms.crank_is_struck else ():
        mass[part.signal] += part.mass
        momentum[part.signal] += part.mass * np.array(part.direction)
    numbers = np.zeros(len(shocks), shocks[0].numbers.dtype)
    for k, shock in enumerate(shocks):
        numbers[k] = shock.numbers[0]
    return Shock(numbers, np.array([shock.direction for shock in shocks]), mass, momentum, candidate)


def _sliders(forms: Forms, scene: Scene) -> tuple[Slider, ...]:
    """Return the signals: sliders of the guides, and the two directions of a crank pin that has a mass."""
    sliders = [Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], scene.guide_angle(side))
               for side in forms.guides]
    if "crank_pin" in scene.linkage:  # at l (-sin(theta), cos(theta))
        sliders += [Slider(scene["crank.radius"], 0.0, angle) for angle in (-0.5 * math.pi, 0.0)]
    return tuple(sliders)


def _monitor_table(builder: ModeBuilder) -> MonitorTable:
    """Return the table of one monitor per plate: the force in contact, and the approach speed."""
    forms, mode_set = builder.forms, builder.mode_set
    force = np.zeros((len(builder.stances), len(forms.plates), forms.channels.count))
    active = np.zeros((len(mode_set.modes), len(forms.plates)), dtype=bool)
    approach = np.zeros((len(forms.plates), forms.channels.count))
    for k, side in enumerate(forms.plates):
        force[:, k] = builder.contact_force(side)
        active[:, k] = mode_set.pressing[side][mode_set.stance]
        approach[k] = forms.penetration(side)[1]
    return MonitorTable(*mode_set.with_terms(force), active, approach)


class _GuardNumbers(NamedTuple):
    """A guard without the numbers of a scene: rows and jumps are those of `GuardTable`, by their numbers there."""

    row: int
    effect: int
    entries_decide: bool
    event: str
    is_blow: bool
    # each target as `ModeSet.target_mode` takes it, with its rows of entry, its jump and its shock
    targets: tuple[tuple[tuple, tuple[int, ...], int, int], ...]


def _guard_table(builder: ModeBuilder) -> tuple[GuardTable, Shock]:
    """Return guards, candidates and jumps, and the shocks that are no linear jumps; equal forms share a row."""
    mode_set, forms, channels = builder.mode_set, builder.forms, builder.forms.channels
    rows, matrices, shocks = _Numbering(), _Numbering(), dict[int, tuple[int, NonlinearShock]]()
    numbers, counts = list[_GuardNumbers](), list[int]()
    for context in mode_set.distinct_contexts:
        guards = builder.guards_in(context)
        counts.append(len(guards))
        for guard in guards:
            row, targets = rows.number(guard.form), []
            for target in guard.targets:
                entries = tuple(map(rows.number, target.entries))
                jump = shock = NOTHING
                if target.jumps:
                    # Positions and velocities after a jump are this matrix times the channels before.
                    matrix = forms.units[:2 * channels.coordinates].copy()
                    for channel, form in target.jumps:
                        matrix[channel] = form
                    jump = matrices.number(matrix)
                if target.shock:
                    shock, _ = shocks.setdefault(id(target.shock), (len(shocks), target.shock))
                targets.append((target.leads_to, entries, jump, shock))
            numbers.append(_GuardNumbers(row, context.effect, guard.entries_decide, guard.event, guard.is_blow,
                                         tuple(targets)))
    form = np.array(rows.arrays).reshape(len(rows.arrays), channels.count)
    of_body = [channel(i) for channel in (channels.position, channels.velocity)
               for i in range(channels.dynamic, channels.coordinates)]
    indices, shock_of_candidate = _guard_indices(mode_set, tuple(counts), tuple(numbers))
    table = GuardTable(
        form=form, terms=terms(form), driven=np.any(form[:, of_body], axis=1), **indices,
        jump_matrix=np.array(matrices.arrays).reshape(len(matrices.arrays), 2 * channels.coordinates, channels.count))
    return table, _shock_table(forms, [law for _, law in shocks.values()], shock_of_candidate)


@functools.lru_cache(maxsize=64)
def _guard_indices(mode_set: ModeSet, counts: tuple[int, ...],
                   guards: tuple[_GuardNumbers, ...]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the fields of `GuardTable` that are indices, and `Shock.candidate`; cached, because all scenes of a sweep
    have the same. `counts` are the numbers of guards of `ModeSet.distinct_contexts`.

    The tables are made by guard, a row for each guard of each context, and then taken by mode, because modes share
    contexts. The row after the last guard's pads modes with fewer guards.
    """
    count = len(guards) + 1
    most_targets = max((len(guard.targets) for guard in guards), default=1)
    most_entries = max((len(entries) for guard in guards for _, entries, _, _ in guard.targets), default=0)
    row, effect, event, blow = (np.full(count, NOTHING) for _ in range(4))
    jump, shock = (np.full((count, most_targets), NOTHING) for _ in range(2))
    candidate = np.full((count, most_targets, len(mode_set.modes)), NOTHING)
    entry = np.full((count, most_targets, most_entries), NOTHING)
    for k, guard in enumerate(guards):
        row[k] = guard.row
        effect[k] = UNCHECKED if guard.entries_decide else guard.effect
        event[k] = MODE_EVENTS.index(guard.event) if guard.event else NOTHING
        blow[k] = guard.effect if guard.is_blow else NOTHING
        for c, (leads_to, entries, jump[k, c], shock[k, c]) in enumerate(guard.targets):
            candidate[k, c] = [mode_set.target_mode(mode, guard.effect, leads_to) for mode in mode_set.modes]
            entry[k, c, :len(entries)] = entries
    at = mode_set.padded(counts)
    indices = {"row": row[at], "effect": effect[at], "entry": entry[at], "jump": jump[at], "event": event[at],
               "candidate": np.ascontiguousarray(candidate[at, :, np.arange(len(at))[:, None]]),
               "blow_monitor": blow[at]}
    return indices, shock[at]


class _Numbering:
    """Different arrays, numbered in the order of their first use."""

    def __init__(self) -> None:
        self.arrays: list[np.ndarray] = []
        self._number_by_bytes: dict[bytes, int] = {}

    def number(self, array: np.ndarray) -> int:
        """Return the number of `array`."""
        array = array + 0.0  # no -0.0, whose bytes differ
        number = self._number_by_bytes.setdefault(array.tobytes(), len(self.arrays))
        if number == len(self.arrays):
            self.arrays.append(array)
        return number
