"""A scene compiled to the tables that the event loop runs."""

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.energy import audit_tables
from vibro_ros.model.forms import Forms
from vibro_ros.model.modes import Mode, ModeBuilder
from vibro_ros.model.slider import Slider, signal_table
from vibro_ros.solver.system import NOTHING, System, couplings, flow_numbers, longest_steps

#: Kinds of events that a change of mode records, by their number.
MODE_EVENTS = ("stick", "slip_forward", "slip_backward", "unloaded", "loaded")

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
    initial_mode : int
        Mode to start in.
    """

    forms: Forms
    sliders: tuple[Slider, ...]
    modes: tuple[Mode, ...]
    system: System
    output: np.ndarray
    initial_mode: int


@functools.lru_cache(maxsize=64)
def compile_scene(scene) -> Model:
    """Compile `scene`, a Scene, to its tables, which nobody may change."""
    builder = ModeBuilder(scene)
    forms, channels = builder.forms, builder.forms.channels
    sliders = tuple(Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], _tilt(scene, side))
                    for side in forms.guides)
    acceleration = np.array([builder.equations(mode) for mode in builder.modes])
    acceleration = acceleration.reshape(len(builder.modes), channels.coordinates, channels.count) + 0.0  # no -0.0
    system = System(
        sizes=np.array(channels),
        acceleration=acceleration,
        flow=flow_numbers(acceleration, channels.dynamic),
        coupled=couplings(acceleration, channels),
        longest_step=longest_steps(acceleration, channels),
        **_guard_tables(builder),
        event=_event_table(builder),
        **_monitor_tables(builder),
        **audit_tables(forms, scene, builder.modes, [builder.friction_force(mode) for mode in builder.modes]),
        signals=signal_table(list(sliders)),
    )
    output = np.array([builder.outputs(mode) for mode in builder.modes])
    return Model(forms, sliders, builder.modes, system, output, builder.initial_mode)


def _tilt(scene, side: str) -> float:
    return scene["guide.angle"] if side == "inclined" else 0.0


def _guard_tables(builder: ModeBuilder) -> dict[str, np.ndarray]:
    guards = [list(builder.guards(mode)) for mode in builder.modes]
    most = max(1, max(len(of_mode) for of_mode in guards))
    rows = {}
    guard = np.full((len(guards), most), NOTHING)
    halt = np.full((len(guards), most), NOTHING)
    candidate = np.full((len(guards), most, 3), NOTHING)
    for m, of_mode in enumerate(guards):
        for g, (condition, targets) in enumerate(of_mode):
            guard[m, g] = rows.setdefault(tuple(condition.form), len(rows))
            halt[m, g] = condition.halt
            candidate[m, g, :len(targets)] = targets
    row = np.array(list(rows)).reshape(len(rows), builder.forms.channels.count)
    return {"row": row, "driven": _reads_driven(row, builder.forms), "guard": guard, "candidate": candidate,
            "halt": halt}


def _reads_driven(row: np.ndarray, forms: Forms) -> np.ndarray:
    if not forms.body_moves:
        return np.zeros(len(row), dtype=bool)
    channels = [forms.channels.position(forms.body), forms.channels.velocity(forms.body)]
    return row[:, channels].any(axis=1)


def _event_table(builder: ModeBuilder) -> np.ndarray:
    """Kind of event by (mode before, mode after), from their friction states."""
    table = np.full((len(builder.modes), len(builder.modes)), NOTHING)
    for before, after in itertools.permutations(range(len(builder.modes)), 2):
        old, new = builder.modes[before].states[-1], builder.modes[after].states[-1]
        event = "loaded" if old == "unloaded" else new
        if old != new and event in MODE_EVENTS:
            table[before, after] = MODE_EVENTS.index(event)
    return table


def _monitor_tables(builder: ModeBuilder) -> dict[str, np.ndarray]:
    """One monitor a plate: its force while in contact, and the approach speed."""
    forms, modes = builder.forms, builder.modes
    shape = (len(modes), len(forms.plates))
    monitor = np.zeros((*shape, forms.channels.count))
    monitored = np.zeros(shape, dtype=bool)
    approach = np.zeros((len(forms.plates), forms.channels.count))
    for k, side in enumerate(forms.plates):
        monitor[:, k] = forms.plate_force(side)
        monitored[:, k] = [side in mode.closed for mode in modes]
        approach[k] = forms.penetration(side)[1]
    return {"monitor": monitor, "monitored": monitored, "approach": approach}
