"""A scene compiled to the tables that the event loop runs: the product of its effects' states.

What is off leaves no coordinate, no term, no guard and no mode behind.
"""

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.contact import Contact
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.friction import Friction
from vibro_ros.model.slider import Slider, signal_table
from vibro_ros.solver.system import NOTHING, System, flow_numbers, longest_steps

#: Kinds of events that a change of mode records, by their number.
MODE_EVENTS = ("stick", "slip_forward", "slip_backward", "unloaded", "loaded")

#: Linear outputs of a mode, in the order of `Model.output`'s rows.
OUTPUTS = ("body_position", "body_velocity", "upper_position", "upper_velocity", "inclined_position",
           "inclined_velocity", "upper_drive_force", "inclined_drive_force", "upper_plate_force",
           "inclined_plate_force", "upper_plate_position", "upper_plate_velocity", "inclined_plate_position",
           "inclined_plate_velocity", "normal_force", "friction_force")


@dataclass(frozen=True)
class Mode:
    """One state of every effect.

    Attributes
    ----------
    states : tuple of str
        States of the contacts, in the order of `Forms.plates`, then that of the friction.
    closed : frozenset of str
        Guides whose plates are in contact.
    """

    states: tuple[str, ...]
    closed: frozenset[str]


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


class ModeBuilder:
    """Builds the tables mode by mode.

    Parameters
    ----------
    scene : Scene
        What to compile.
    """

    def __init__(self, scene):
        self._scene = scene
        self.forms = Forms(scene)
        self.contacts = [Contact(scene, self.forms, side) for side in self.forms.plates]
        self.friction = Friction(scene, self.forms)
        # Where nothing can drive the body, it rests for good, and friction has no states.
        self.friction_states = self.friction.states if self.forms.body_moves else ("rest",)
        product = itertools.product(*(contact.states for contact in self.contacts), self.friction_states)
        self.modes = tuple(Mode(states, self._closed(states)) for states in product)
        self._number = {mode.states: m for m, mode in enumerate(self.modes)}

    def _closed(self, states: tuple[str, ...]) -> frozenset[str]:
        return frozenset(contact.side for contact, state in zip(self.contacts, states) if state == "closed")

    @property
    def initial_mode(self) -> int:
        """Number of the mode to start in."""
        friction = self.friction.initial if self.forms.body_moves else "rest"
        return self._number[(*(contact.initial for contact in self.contacts), friction)]

    def equations(self, mode: Mode) -> list[Form]:
        """Accelerations of the coordinates: m2 u'' = -F2, m3 w'' = -F3, M x'' = F_in - F_fr (eq. 1)."""
        masses = [-self.forms.guide_force(side, mode.closed) / self._scene[f"mass.{side}"]
                  for side in self.forms.guides]
        if not self.forms.body_moves:
            return masses
        resultant = self.forms.inertial_force() - self.friction_force(mode)
        return [*masses, resultant / self._scene.total_mass]

    def friction_force(self, mode: Mode) -> Form:
        """F_fr in `mode` [N]."""
        normal, inertial = self.forms.normal_force(), self.forms.inertial_force()
        return self.friction.force(mode.states[-1], normal, inertial)

    def guards(self, mode: Mode):
        """Guards of `mode` and, for each, the numbers of its target modes."""
        for k, contact in enumerate(self.contacts):
            for guard in contact.guards(mode.states[k]):
                yield guard, self._targets(mode, k, guard.targets)
        if self.forms.body_moves:
            normal, inertial = self.forms.normal_force(), self.forms.inertial_force()
            for guard in self.friction.guards(mode.states[-1], normal, inertial):
                yield guard, self._targets(mode, len(self.contacts), guard.targets)

    def _targets(self, mode: Mode, place: int, states: tuple[str, ...]) -> list[int]:
        return [self._number[mode.states[:place] + (state,) + mode.states[place + 1:]] for state in states]

    def outputs(self, mode: Mode) -> np.ndarray:
        """Rows of `OUTPUTS`; zero for what the scene does not have."""
        forms, rows = self.forms, {}
        if forms.body_moves:
            rows |= {"body_position": forms.position(forms.body), "body_velocity": forms.velocity(forms.body)}
        for i, side in enumerate(forms.guides):
            rows |= {f"{side}_position": forms.position(i), f"{side}_velocity": forms.velocity(i),
                     f"{side}_drive_force": -forms.drive_force(side)}
        for side in forms.plates:
            rows[f"{side}_plate_position"], rows[f"{side}_plate_velocity"] = forms.plate(side)
            if side in mode.closed:
                rows[f"{side}_plate_force"] = forms.plate_force(side)
        rows |= {"normal_force": forms.normal_force(), "friction_force": self.friction_force(mode)}
        return np.array([rows.get(name, forms.zero) for name in OUTPUTS])


@functools.lru_cache(maxsize=64)
def compile_scene(scene) -> Model:
    """Compile `scene`, a Scene, to its tables, which nobody may change."""
    builder = ModeBuilder(scene)
    forms, channels = builder.forms, builder.forms.channels
    sliders = tuple(Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], _tilt(scene, side))
                    for side in forms.guides)
    acceleration = np.array([builder.equations(mode) for mode in builder.modes])
    acceleration = acceleration.reshape(len(builder.modes), channels.coordinates, channels.count)
    system = System(
        sizes=np.array(channels),
        acceleration=acceleration,
        flow=flow_numbers(acceleration, channels.dynamic),
        longest_step=longest_steps(acceleration, channels),
        **_guard_tables(builder),
        event=_event_table(builder),
        **_monitor_tables(builder),
        **_audit_tables(builder, scene),
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


def _audit_tables(builder: ModeBuilder, scene) -> dict[str, np.ndarray]:
    """Energy and power of the masses: m q'² / 2 + k (q - s)² / 2 + contact, and the work of sliders, dampers, plates."""
    channels = builder.forms.channels.count
    if not scene["solver.audit"]:
        none = np.zeros((len(builder.modes), 0, channels))
        return {"stretch": none, "stiffness": np.zeros((len(builder.modes), 0)), "power": np.zeros((len(builder.modes), 0, 2, channels))}
    stored = [[term for side in builder.forms.guides for term in _stored_energy(builder.forms, scene, side, mode.closed)]
              for mode in builder.modes]
    power = [[term for side in builder.forms.guides for term in _received_power(builder.forms, scene, side, mode.closed)]
             for mode in builder.modes]
    stretch = np.zeros((len(stored), max(map(len, stored)), channels))
    stiffness = np.zeros(stretch.shape[:2])
    pairs = np.zeros((len(power), max(map(len, power)), 2, channels))
    for m, (energies, powers) in enumerate(zip(stored, power)):
        for e, (weight, form) in enumerate(energies):
            stiffness[m, e], stretch[m, e] = weight, form
        for p, pair in enumerate(powers):
            pairs[m, p] = pair
    return {"stretch": stretch, "stiffness": stiffness, "power": pairs}


def _stored_energy(forms: Forms, scene, side: str, closed: frozenset[str]):
    """Weights and forms of the energy stored in one guide."""
    yield scene[f"mass.{side}"], forms.velocity(forms.guides.index(side))
    yield scene[f"{side}.spring.stiffness"], forms.stretch(side)[0]
    if side in closed:
        yield scene[f"{side}.plate.stiffness"], forms.penetration(side)[0]


def _received_power(forms: Forms, scene, side: str, closed: frozenset[str]):
    """Pairs of forms of the power that one guide receives from its slider, its dampers and its moving plate."""
    _, rate = forms.stretch(side)
    yield -forms.drive_force(side), forms.velocity(forms.guides.index(side)) - rate
    if scene[f"{side}.spring.damping"]:
        yield -scene[f"{side}.spring.damping"] * rate, rate
    if side in closed:
        yield -forms.plate_force(side), forms.plate(side)[1]
        if scene[f"{side}.plate.damping"]:
            depth_rate = forms.penetration(side)[1]
            yield -scene[f"{side}.plate.damping"] * depth_rate, depth_rate
