"""A scene compiled to the tables that the event loop reads (`solver.system.System`)."""

import functools
import math
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.energy import account_table
from vibro_ros.model.forms import NO_EDGES, NO_PUSH, Forms
from vibro_ros.model.modes import MODE_EVENTS, Mode, ModeBuilder
from vibro_ros.model.scene import Scene
from vibro_ros.model.shock import NonlinearShock
from vibro_ros.model.slider import Slider, signal_table
from vibro_ros.solver.channels import counts_of
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
    # forms of the outputs, and of the forces that move the masses of `Forms.linkage`, shape (modes, len(OUTPUTS) +
    # linkage, channels)
    output: np.ndarray
    initial_mode: int  # number of the mode in which a run starts

    @functools.cached_property
    def laid(self) -> Laid:
        """The tables in the form that the event loop's kernels take."""
        return Laid(self.system)

    @functools.cached_property
    def output_by_channel(self) -> np.ndarray:
        """The forms `output`, each channel's coefficients as a vector; shape (modes, channels, LENGTH)."""
        modes, forms, channels = self.output.shape
        by_channel = np.zeros((modes, channels, LENGTH))
        by_channel[:, :, :forms] = self.output.transpose(0, 2, 1)
        return by_channel


def compile_scene(scene: Scene, push: tuple[float, float] = NO_PUSH, edges: tuple[float, float] = NO_EDGES) -> Model:
    """Compile `scene` to its tables, which all callers share and must not change.

    `push` is an external force on the body [N], along x and upwards; `edges` are positions of the body [m] between
    which the tables hold: a guard without a target ends the system there.
    """
    return _compile_machine(scene.machine, push, edges)


@functools.lru_cache(maxsize=64)
def _compile_machine(scene: Scene, push: tuple[float, float], edges: tuple[float, float]) -> Model:
    builder = ModeBuilder(scene, push, edges)
    forms, channels = builder.forms, builder.forms.channels
    sliders = _sliders(forms, scene)
    acceleration = builder.equations() + 0.0  # no -0.0
    # With the reaction a segment ends where the body's equation changes, because the masses feel the body.
    own = channels.coordinates if scene["effects.reaction"] else channels.dynamic
    rotor = _rotor(builder, scene)
    # The decaying term of Stribeck's law: the normal force of a slipping body times exp(-abs(x') / v_s).
    decaying = builder.modes if forms.friction_decays else ()
    rate = np.array([builder.ground.decay_rate(mode.ground) for mode in decaying])
    factor = (rate != 0.0)[:, None] * builder.ground_force("normal_force")[:len(decaying)] + 0.0
    equations = [acceleration[:, :own], *([rotor.current[:, None]] if builder.motor else [])]
    if forms.friction_decays:  # where the term moves the body, it is part of the flow
        equations += [factor[:, None], np.where((rate != 0.0)[:, None], acceleration[:, forms.body], 0.0)[:, None]]
    flow = flow_numbers(np.concatenate(equations, axis=1))
    first = np.unique(flow, return_index=True)[1]  # mode of each flow
    guards, shock = _guard_table(builder)
    system = System(
        counts=counts_of(channels),
        equations=acceleration,
        reads_all=terms(acceleration),
        reads_forcing=equation_terms(acceleration, channels),
        flow=flow,
        coupled=couplings(acceleration, channels),
        longest_segment=longest_segments(acceleration[first], channels)[flow],
        guards=guards,
        events=EventTable(
            builder.mode_set.event_kind,
            # The speed of the fall that a landing ends.
            np.array([-forms.body_velocity()[1] if kind == "landing" else forms.zero for kind in MODE_EVENTS]) + 0.0),
        monitors=_monitor_table(builder),
        mode_after_ramp_change=builder.mode_set.mode_after_ramp_change,
        accounts=account_table(builder, scene, guards),
        signals=signal_table(tuple(sliders)),
        decay=Decay(np.array([forms.body] * forms.friction_decays, np.int64), factor, terms(factor), rate),
        rotor=rotor,
        shock=shock,
    )
    return Model(forms, tuple(sliders), builder.modes, system, builder.outputs(), builder.initial_mode)


def _rotor(builder: ModeBuilder, scene: Scene) -> Rotor:
    """Return the tables of the crank as a coordinate, with its motor; empty if the crank's motion is known in time."""
    motor, at, modes = builder.motor, builder.forms.channels, len(builder.modes)
    if not motor:
        return no_rotor(at.count)
    sliders = [(slider.radius, cos(slider.angle), sin(slider.angle),
                (slider.rod - slider.radius) * (slider.rod + slider.radius) if slider.rod else -1.0)
               for slider in _sliders(builder.forms, scene)]
    current = np.zeros((modes, at.count))
    if motor.inductance == 0.0:
        current = builder.by_motor_state(lambda bearing, loop: motor.drawn_current(loop)) + 0.0
    law = {"voltage": BY_COMMAND, "speed_by_voltage": BY_VOLTAGE, "speed_by_current": BY_CURRENT}
    controller = (law[scene["motor.control"]], 1.0 / scene["motor.control_rate"], scene["motor.proportional_gain"],
                  scene["motor.integral_gain"], scene["motor.feed_forward"], motor.supply_voltage, motor.constant,
                  motor.resistance, scene["motor.current_limit"])
    loads = builder.signal_loads()
    return Rotor(np.array(sliders).reshape(-1, 4), loads, terms(loads), current, terms(current),
                 np.full(modes, motor.inductance == 0.0), np.array([controller], CONTROLLER))


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


def _sliders(forms: Forms, scene: Scene) -> list[Slider]:
    """Return the signals: sliders of the guides, and the two directions of a crank pin that has a mass."""
    sliders = [Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], scene.guide_angle(side))
               for side in forms.guides]
    if "crank_pin" in scene.linkage:  # at l (-sin(theta), cos(theta))
        sliders += [Slider(scene["crank.radius"], 0.0, angle) for angle in (-0.5 * math.pi, 0.0)]
    return sliders


def _monitor_table(builder: ModeBuilder) -> MonitorTable:
    """Return the table of one monitor per plate: the force in contact, and the approach speed."""
    forms, modes = builder.forms, builder.modes
    shape = (len(modes), len(forms.plates))
    force = np.zeros((*shape, forms.channels.count))
    active = np.zeros(shape, dtype=bool)
    approach = np.zeros((len(forms.plates), forms.channels.count))
    for k, side in enumerate(forms.plates):
        force[:, k] = builder.contact_force(side)
        active[:, k] = builder.mode_set.pressing[side]
        approach[k] = forms.penetration(side)[1]
    return MonitorTable(force, terms(force), active, approach)


def _guard_table(builder: ModeBuilder) -> tuple[GuardTable, Shock]:
    """Return the guards, their candidates and their jumps, and the shocks that are no linear jumps; equal forms share
    a row.

    The tables are made by guard, a row for each guard of each context, and then taken by mode, because modes share
    contexts.
    """
    mode_set, forms, channels = builder.mode_set, builder.forms, builder.forms.channels
    of_context = [builder.guards_in(context) for context in mode_set.distinct_contexts]
    effects = [context.effect for context, guards in zip(mode_set.distinct_contexts, of_context, strict=True)
               for _ in guards]
    guards = [guard for of_one in of_context for guard in of_one]
    targets = [target for guard in guards for target in guard.targets]
    # Positions and velocities after a jump are its matrix, shape (2 coordinates, channels), times the channels before.
    matrix_of = {id(target): forms.units[:2 * channels.coordinates].copy() for target in targets if target.jumps}
    for target in targets:
        for channel, form in target.jumps:
            matrix_of[id(target)][channel] = form
    # The row after the last guard's pads modes with fewer guards.
    count = len(guards) + 1
    most_targets = max((len(guard.targets) for guard in guards), default=1)
    row_of, effect_of, event_of, blow_of = (np.full(count, NOTHING) for _ in range(4))
    jump, shock = (np.full((count, most_targets), NOTHING) for _ in range(2))
    candidate = np.full((count, most_targets, len(mode_set.modes)), NOTHING)
    entry = np.full((count, most_targets, max((len(target.entries) for target in targets), default=0)), NOTHING)
    rows, matrices, shocks = _Numbering(), _Numbering(), dict[int, tuple[int, NonlinearShock]]()
    for k, (effect, guard) in enumerate(zip(effects, guards, strict=True)):
        row_of[k] = rows.number(guard.form)
        effect_of[k] = UNCHECKED if guard.entries_decide else effect
        event_of[k] = MODE_EVENTS.index(guard.event) if guard.event else NOTHING
        blow_of[k] = effect if guard.is_blow else NOTHING
        for c, target in enumerate(guard.targets):
            candidate[k, c] = mode_set.target_modes(effect, target)
            for e, form in enumerate(target.entries):
                entry[k, c, e] = rows.number(form)
            if target.jumps:
                jump[k, c] = matrices.number(matrix_of[id(target)])
            if target.shock:
                shock[k, c], _ = shocks.setdefault(id(target.shock), (len(shocks), target.shock))
    at = mode_set.padded(tuple(map(len, of_context)))
    of_body = [channel(i) for channel in (channels.position, channels.velocity)
               for i in range(channels.dynamic, channels.coordinates)]
    form = np.array(rows.arrays).reshape(len(rows.arrays), channels.count)
    table = GuardTable(
        form=form, terms=terms(form), driven=np.any(form[:, of_body], axis=1), row=row_of[at], effect=effect_of[at],
        candidate=np.ascontiguousarray(candidate[at, :, np.arange(len(at))[:, None]]), entry=entry[at], jump=jump[at],
        jump_matrix=np.array(matrices.arrays).reshape(len(matrices.arrays), 2 * channels.coordinates, channels.count),
        blow_monitor=blow_of[at], event=event_of[at])
    return table, _shock_table(forms, [law for _, law in shocks.values()], shock[at])


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
