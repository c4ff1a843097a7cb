"""A scene compiled to the tables that the event loop reads (`solver.system.System`)."""

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.energy import audit_tables
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.modes import Mode, ModeBuilder
from vibro_ros.model.scene import Scene
from vibro_ros.model.slider import Slider, signal_table
from vibro_ros.solver.channels import Channels, size_of
from vibro_ros.solver.system import (
    NOTHING,
    UNCHECKED,
    Decay,
    System,
    acceleration_terms,
    couplings,
    flow_numbers,
    longest_segments,
    terms,
)

#: Kinds of events that a change of mode records, by their number.
MODE_EVENTS = ("stick", "slip_forward", "slip_backward", "unloaded", "loaded", "lift_off", "landing")
# Events by the state of the friction that begins, and by the state that ends, where they are not the new state's name.
_ENTERING, _LEAVING = {"airborne": "lift_off"}, {"unloaded": "loaded", "airborne": "landing"}


@dataclass(frozen=True)
class Model:
    """A compiled scene.

    Attributes
    ----------
    forms : Forms
        The linear forms of the scene.
    sliders : tuple of Slider
        Sliders of the simulated masses.
    modes : tuple of Mode
        The modes of the scene, by their numbers in the system.
    system : System
        The tables of the event loop.
    output : ndarray, shape (modes, len(OUTPUTS), channels)
        Forms of the outputs.
    output_terms : ndarray of int, shape (modes, len(OUTPUTS), channels)
        Channels that the forms of the outputs read; see `solver.system.terms`.
    initial_mode : int
        Number of the mode in which a run starts.
    """

    forms: Forms
    sliders: tuple[Slider, ...]
    modes: tuple[Mode, ...]
    system: System
    output: np.ndarray
    output_terms: np.ndarray
    initial_mode: int


def compile_scene(scene: Scene) -> Model:
    """Compile `scene` to its tables, which are shared by all who ask for them and may not be changed."""
    return _compile_machine(scene.machine)


@functools.lru_cache(maxsize=64)
def _compile_machine(scene: Scene) -> Model:
    builder = ModeBuilder(scene)
    forms, channels = builder.forms, builder.forms.channels
    sliders = tuple(Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], scene.guide_angle(side))
                    for side in forms.guides)
    acceleration = np.array([builder.equations(mode) for mode in builder.modes])
    acceleration = acceleration.reshape(len(builder.modes), channels.coordinates, channels.count) + 0.0  # no -0.0
    # With the reaction the body's energy is audited as well, so that a segment ends where the body's equation changes.
    own = channels.coordinates if scene["effects.reaction"] else channels.dynamic
    system = System(
        size=size_of(channels),
        acceleration=acceleration,
        terms=acceleration_terms(acceleration, channels),
        flow=flow_numbers(acceleration, own),
        coupled=couplings(acceleration, channels),
        longest_segment=longest_segments(acceleration, channels),
        **_guard_tables(builder),
        event_kind=_event_kinds(builder),
        event_quantity=_event_quantities(builder),
        **_monitor_tables(builder),
        mode_after_ramp_change=_modes_after_ramp_changes(builder),
        **audit_tables(builder, scene),
        signals=signal_table(sliders),
        decay=_decay_table(builder),
    )
    output = np.array([builder.outputs(mode) for mode in builder.modes])
    return Model(forms, sliders, builder.modes, system, output, terms(output), builder.initial_mode)


def _decay_table(builder: ModeBuilder) -> Decay:
    """The decaying term of Stribeck's law: the normal force of a slipping body times exp(-abs(x') / v_s)."""
    forms, modes = builder.forms, builder.modes if builder.forms.friction_decays else ()
    rate = np.array([builder.friction.decay_rate(mode.friction) for mode in modes])
    factor = np.array([builder.normal_force(mode) for mode in modes]).reshape(len(modes), forms.channels.count)
    return Decay(factor, terms(factor), rate)


def _guard_tables(builder: ModeBuilder) -> dict[str, np.ndarray]:
    """Fields of `System` for guards, their candidates and the jumps on the way; equal forms share a row."""
    guards = [list(builder.guards(mode)) for mode in builder.modes]
    channels = builder.forms.channels
    targets = [target for of_mode in guards for guard, _, _ in of_mode for target in guard.targets]
    most_targets = max((len(guard.targets) for of_mode in guards for guard, _, _ in of_mode), default=1)
    most_entries = max((len(target.entries) for target in targets), default=0)
    shape = (len(guards), max(1, max(map(len, guards))))
    number_by_form, number_by_matrix = dict[tuple, int](), dict[bytes, int]()
    guard_row, guard_effect, blow_monitor = (np.full(shape, NOTHING) for _ in range(3))
    candidate, jump = (np.full((*shape, most_targets), NOTHING) for _ in range(2))
    entry = np.full((*shape, most_targets, most_entries), NOTHING)
    for m, of_mode in enumerate(guards):
        for g, (guard, effect, modes) in enumerate(of_mode):
            guard_row[m, g] = number_by_form.setdefault(tuple(guard.form), len(number_by_form))
            guard_effect[m, g] = UNCHECKED if guard.entries_decide else effect
            blow_monitor[m, g] = effect if guard.is_blow else NOTHING
            for c, (target, mode) in enumerate(zip(guard.targets, modes, strict=True)):
                candidate[m, g, c] = mode
                for e, form in enumerate(target.entries):
                    entry[m, g, c, e] = number_by_form.setdefault(tuple(form), len(number_by_form))
                if target.jumps:
                    matrix = _jump_matrix(target.jumps, channels).tobytes()
                    jump[m, g, c] = number_by_matrix.setdefault(matrix, len(number_by_matrix))
    row = np.array(list(number_by_form)).reshape(len(number_by_form), channels.count)
    matrices = np.array([np.frombuffer(matrix) for matrix in number_by_matrix])
    return {"row": row, "row_terms": terms(row), "driven": _reads_driven(row, builder.forms),
            "guard": guard_row, "guard_effect": guard_effect, "candidate": candidate, "entry": entry, "jump": jump,
            "blow_monitor": blow_monitor,
            "jump_matrix": matrices.reshape(len(matrices), 2 * channels.coordinates, channels.count)}


def _jump_matrix(jumps: tuple[tuple[int, Form], ...], channels: Channels) -> np.ndarray:
    """Matrix of positions and velocities after a jump, shape (2 coordinates, channels), times the channels before."""
    rows = np.eye(2 * channels.coordinates, channels.count)
    for channel, form in jumps:
        rows[channel] = form
    return rows


def _reads_driven(row: np.ndarray, forms: Forms) -> np.ndarray:
    """Whether each row reads a coordinate of the body, shape (rows,)."""
    at, driven = forms.channels, range(forms.channels.dynamic, forms.channels.coordinates)
    return np.any(row[:, [channel(i) for channel in (at.position, at.velocity) for i in driven]], axis=1)


def _event_kinds(builder: ModeBuilder) -> np.ndarray:
    """Kinds of events, shape (modes before, modes after), by the states of the friction before and after."""
    table = np.full((len(builder.modes), len(builder.modes)), NOTHING)
    for before, after in itertools.permutations(range(len(builder.modes)), 2):
        old, new = builder.modes[before].friction, builder.modes[after].friction
        event = _LEAVING.get(old) or _ENTERING.get(new, new)
        if old != new and event in MODE_EVENTS:
            table[before, after] = MODE_EVENTS.index(event)
    return table


def _event_quantities(builder: ModeBuilder) -> np.ndarray:
    """Forms recorded with each kind of event, shape (kinds, channels): the speed of the fall that a landing ends."""
    _, upwards = builder.forms.body_velocity()
    return np.array([-upwards if kind == "landing" else builder.forms.zero for kind in MODE_EVENTS]) + 0.0  # no -0.0


def _modes_after_ramp_changes(builder: ModeBuilder) -> np.ndarray:
    """Modes that follow when a plate's speed changes, shape (modes, plates), because a mass may part from the plate."""
    states = [mode.states for mode in builder.modes]
    table = np.empty((len(states), len(builder.forms.plates)), dtype=np.int64)
    for m, old in enumerate(states):
        for k in range(table.shape[1]):
            new = list(old)
            new[k] = "open" if old[k] == "resting" else old[k]
            table[m, k] = states.index(tuple(new))
    return table


def _monitor_tables(builder: ModeBuilder) -> dict[str, np.ndarray]:
    """Fields of `System` for one monitor a plate: the force in contact, and the approach speed."""
    forms, modes = builder.forms, builder.modes
    shape = (len(modes), len(forms.plates))
    monitor = np.zeros((*shape, forms.channels.count))
    monitored = np.zeros(shape, dtype=bool)
    approach = np.zeros((len(forms.plates), forms.channels.count))
    for k, side in enumerate(forms.plates):
        monitor[:, k] = [builder.contact_force(mode, side) for mode in modes]
        monitored[:, k] = [side in mode.pressing for mode in modes]
        approach[k] = forms.penetration(side)[1]
    return {"monitor": monitor, "monitor_terms": terms(monitor), "monitored": monitored, "approach": approach}
