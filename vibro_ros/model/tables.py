"""A scene compiled to the tables that the event loop reads (`solver.system.System`)."""

import functools
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.accounts import account_table
from vibro_ros.model.energy import audit_tables
from vibro_ros.model.forms import Forms
from vibro_ros.model.guard_tables import guard_tables
from vibro_ros.model.mode_set import MODE_EVENTS, Mode
from vibro_ros.model.modes import ModeBuilder
from vibro_ros.model.scene import Scene
from vibro_ros.model.slider import Slider, signal_table
from vibro_ros.solver.kept import Kept
from vibro_ros.solver.system import (
    Decay,
    System,
    acceleration_terms,
    couplings,
    flow_numbers,
    longest_segments,
    size_of,
    terms,
)


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

    @functools.cached_property
    def kept(self) -> Kept:
        """The tables as the event loop's kernels take them."""
        return Kept(self.system)


def compile_scene(scene: Scene) -> Model:
    """Compile `scene` to its tables, which are shared by all who ask for them and may not be changed."""
    return _compile_machine(scene.machine)


@functools.lru_cache(maxsize=64)
def _compile_machine(scene: Scene) -> Model:
    builder = ModeBuilder(scene)
    forms, channels = builder.forms, builder.forms.channels
    sliders = tuple(Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], scene.guide_angle(side))
                    for side in forms.guides)
    acceleration = builder.equations() + 0.0  # no -0.0
    # With the reaction the body's energy is audited as well, so that a segment ends where the body's equation changes.
    own = channels.coordinates if scene["effects.reaction"] else channels.dynamic
    flow = flow_numbers(acceleration, own)
    first = np.unique(flow, return_index=True)[1]  # mode of each flow
    guards = guard_tables(builder)
    system = System(
        size=size_of(channels),
        acceleration=acceleration,
        terms=acceleration_terms(acceleration, channels),
        flow=flow,
        coupled=couplings(acceleration, channels),
        longest_segment=longest_segments(acceleration[first], channels)[flow],
        **guards,
        event_kind=builder.mode_set.event_kind,
        event_quantity=_event_quantities(builder),
        **_monitor_tables(builder),
        mode_after_ramp_change=builder.mode_set.mode_after_ramp_change,
        **audit_tables(builder, scene),
        accounts=account_table(builder, scene, guards),
        signals=signal_table(sliders),
        decay=_decay_table(builder),
    )
    output = builder.outputs()
    return Model(forms, sliders, builder.modes, system, output, terms(output), builder.initial_mode)


def _decay_table(builder: ModeBuilder) -> Decay:
    """The decaying term of Stribeck's law: the normal force of a slipping body times exp(-abs(x') / v_s)."""
    modes = builder.modes if builder.forms.friction_decays else ()
    rate = np.array([builder.friction.decay_rate(mode.friction) for mode in modes])
    factor = builder.normal_force()[:len(modes)].copy()
    return Decay(factor, terms(factor), rate)


def _event_quantities(builder: ModeBuilder) -> np.ndarray:
    """Forms recorded with each kind of event, shape (kinds, channels): the speed of the fall that a landing ends."""
    _, upwards = builder.forms.body_velocity()
    return np.array([-upwards if kind == "landing" else builder.forms.zero for kind in MODE_EVENTS]) + 0.0  # no -0.0


def _monitor_tables(builder: ModeBuilder) -> dict[str, np.ndarray]:
    """Fields of `System` for one monitor a plate: the force in contact, and the approach speed."""
    forms, modes = builder.forms, builder.modes
    shape = (len(modes), len(forms.plates))
    monitor = np.zeros((*shape, forms.channels.count))
    monitored = np.zeros(shape, dtype=bool)
    approach = np.zeros((len(forms.plates), forms.channels.count))
    for k, side in enumerate(forms.plates):
        monitor[:, k] = builder.contact_force(side)
        monitored[:, k] = builder.mode_set.pressing[side]
        approach[k] = forms.penetration(side)[1]
    return {"monitor": monitor, "monitor_terms": terms(monitor), "monitored": monitored, "approach": approach}
