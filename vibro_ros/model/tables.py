"""A scene compiled to the tables that the event loop runs."""

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.energy import audit_tables
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.modes import Mode, ModeBuilder
from vibro_ros.model.slider import Slider, signal_table
from vibro_ros.solver.system import (
    NOTHING,
    UNCHECKED,
    Channels,
    Decay,
    System,
    acceleration_terms,
    couplings,
    flow_numbers,
    longest_steps,
    terms,
)

#: Kinds of events that a change of mode records, by their number.
MODE_EVENTS = ("stick", "slip_forward", "slip_backward", "unloaded", "loaded", "lift_off", "landing")
_ENTERING, _LEAVING = {"airborne": "lift_off"}, {"unloaded": "loaded", "airborne": "landing"}

@dataclass(frozen=True)
class Model:
    """A compiled scene.

    Attributes
    ----------
    forms : Forms
        Its linear forms.
    sliders : tuple of Slider
        Sliders of the simulated masses.
    modes : tuple of Mode
        What the system's modes stand for.
    system : System
        The tables of the event loop.
    output : ndarray, shape (modes, len(OUTPUTS), channels)
        Rows of the outputs.
    output_terms : ndarray of int, shape (modes, len(OUTPUTS), channels)
        Their channels; see `solver.system.terms`.
    initial_mode : int
        Mode to start in.
    """

    forms: Forms
    sliders: tuple[Slider, ...]
    modes: tuple[Mode, ...]
    system: System
    output: np.ndarray
    output_terms: np.ndarray
    initial_mode: int


def compile_scene(scene) -> Model:
    """Compile `scene`, a Scene, to its tables, which nobody may change."""
    return _compile_machine(scene.machine)


@functools.lru_cache(maxsize=64)
def _compile_machine(scene) -> Model:
    builder = ModeBuilder(scene)
    forms, channels = builder.forms, builder.forms.channels
    sliders = tuple(Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], _tilt(scene, side))
                    for side in forms.guides)
    acceleration = np.array([builder.equations(mode) for mode in builder.modes])
    acceleration = acceleration.reshape(len(builder.modes), channels.coordinates, channels.count) + 0.0  # no -0.0
    # With the reaction the body's energy is audited, too: a segment must then end where the body's equation changes.
    own = channels.coordinates if scene["effects.reaction"] else channels.dynamic
    system = System(
        sizes=np.array(channels),
        acceleration=acceleration,
        terms=acceleration_terms(acceleration, channels),
        flow=flow_numbers(acceleration, own),
        coupled=couplings(acceleration, channels),
        longest_step=longest_steps(acceleration, channels),
        **_guard_tables(builder),
        event=_event_table(builder),
        noted=_noted_table(builder),
        **_monitor_tables(builder),
        unheld=_unheld_table(builder),
        **audit_tables(builder, scene),
        signals=signal_table(sliders),
        decay=_decay_table(builder),
    )
    output = np.array([builder.outputs(mode) for mode in builder.modes])
    return Model(forms, sliders, builder.modes, system, output, terms(output), builder.initial_mode)


def _decay_table(builder: ModeBuilder) -> Decay:
    """The normal force of a slipping body, which Stribeck's law lets decay."""
    forms, modes = builder.forms, builder.modes if builder.forms.friction_decays else ()
    rate = np.array([builder.friction.decay_rate(mode.friction) for mode in modes])
    factor = np.array([builder.normal_force(mode) for mode in modes]).reshape(len(modes), forms.channels.count)
    return Decay(factor, terms(factor), rate)


def _tilt(scene, side: str) -> float:
    return scene["guide.angle"] if side == "inclined" else 0.0


def _guard_tables(builder: ModeBuilder) -> dict[str, np.ndarray]:
    """Guards, what they lead to, and how velocities jump on the way; equal forms share a row."""
    guards = [list(builder.guards(mode)) for mode in builder.modes]
    channels = builder.forms.channels
    targets = [target for of_mode in guards for condition, _, _ in of_mode for target in condition.targets]
    most = max((len(condition.targets) for of_mode in guards for condition, _, _ in of_mode), default=1)
    entries = max((len(target.entries) for target in targets), default=0)
    shape = (len(guards), max(1, max(map(len, guards))))
    rows, jumps = {}, {}
    guard, owner, strike = (np.full(shape, NOTHING) for _ in range(3))
    candidate, jump = (np.full((*shape, most), NOTHING) for _ in range(2))
    entry = np.full((*shape, most, entries), NOTHING)
    for m, of_mode in enumerate(guards):
        for g, (condition, place, numbers) in enumerate(of_mode):
            guard[m, g] = rows.setdefault(tuple(condition.form), len(rows))
            owner[m, g] = UNCHECKED if condition.committed else place
            strike[m, g] = place if condition.strike else NOTHING
            for c, (target, number) in enumerate(zip(condition.targets, numbers, strict=True)):
                candidate[m, g, c] = number
                for e, form in enumerate(target.entries):
                    entry[m, g, c, e] = rows.setdefault(tuple(form), len(rows))
                if target.jumps:
                    jump[m, g, c] = jumps.setdefault(_jump(target.jumps, channels).tobytes(), len(jumps))
    row = np.array(list(rows)).reshape(len(rows), channels.count)
    matrices = np.array([np.frombuffer(matrix) for matrix in jumps])
    return {"row": row, "row_terms": terms(row), "driven": _reads_driven(row, builder.forms),
            "guard": guard, "owner": owner, "candidate": candidate, "entry": entry, "jump": jump, "strike": strike,
            "landing": matrices.reshape(len(jumps), 2 * channels.coordinates, channels.count)}


def _jump(jumps: tuple[tuple[int, Form], ...], channels: Channels) -> np.ndarray:
    """Rows that give positions and velocities after a jump from the channels before it."""
    rows = np.eye(2 * channels.coordinates, channels.count)
    for channel, form in jumps:
        rows[channel] = form
    return rows


def _reads_driven(row: np.ndarray, forms: Forms) -> np.ndarray:
    at, driven = forms.channels, range(forms.channels.dynamic, forms.channels.coordinates)
    return row[:, [channel(i) for channel in (at.position, at.velocity) for i in driven]].any(axis=1)


def _event_table(builder: ModeBuilder) -> np.ndarray:
    """Kind of event by (mode before, mode after), from their friction states."""
    table = np.full((len(builder.modes), len(builder.modes)), NOTHING)
    for before, after in itertools.permutations(range(len(builder.modes)), 2):
        old, new = builder.modes[before].friction, builder.modes[after].friction
        event = _LEAVING.get(old) or _ENTERING.get(new, new)
        if old != new and event in MODE_EVENTS:
            table[before, after] = MODE_EVENTS.index(event)
    return table


def _noted_table(builder: ModeBuilder) -> np.ndarray:
    """What is noted with each kind of event: the speed of the fall that a landing ends."""
    _, upwards = builder.forms.body_velocity()
    return np.array([-upwards if kind == "landing" else builder.forms.zero for kind in MODE_EVENTS]) + 0.0  # no -0.0


def _unheld_table(builder: ModeBuilder) -> np.ndarray:
    """Mode to continue in when a plate's speed changes, by (mode, plate): a mass that rests on it may part from it."""
    states = [mode.states for mode in builder.modes]
    table = np.empty((len(states), len(builder.forms.plates)), dtype=np.int64)
    for m, old in enumerate(states):
        for k in range(table.shape[1]):
            new = list(old)
            new[k] = "open" if old[k] == "resting" else old[k]
            table[m, k] = states.index(tuple(new))
    return table


def _monitor_tables(builder: ModeBuilder) -> dict[str, np.ndarray]:
    """One monitor a plate: its force while in contact, and the approach speed."""
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
